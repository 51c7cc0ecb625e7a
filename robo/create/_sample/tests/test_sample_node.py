"""The node sample_node: what it decides, and what it sends and answers."""

import pytest
from robo.testing import Clock, RunNode
from robo_messages import LaserScan, Trigger

from sample_robot.sample_node import SampleNode
from sample_robot.sample_node_logic import about_sample_input, answer_sample_service, next_sample_output


# each publisher
def test_what_comes_next_on_sample_output() -> None:
    message = next_sample_output(3)
    assert message.data == "sample_output 3"


# end
# each subscription
def test_what_is_said_of_a_message_on_sample_input() -> None:
    text = about_sample_input(LaserScan())
    assert text.startswith("LaserScan")


# end
# each service
def test_what_is_answered_to_sample_service() -> None:
    answer = answer_sample_service(Trigger.Request())
    assert isinstance(answer, Trigger.Response)


# end
# each publisher
def test_it_publishes_sample_output(run_node: RunNode, clock: Clock) -> None:
    node = run_node(SampleNode, rate=10.0)
    clock.advance(0.25)
    assert len(node.published("sample_output")) == 2


# end
# each subscription
def test_it_hears_sample_input(run_node: RunNode, caplog: pytest.LogCaptureFixture) -> None:
    node = run_node(SampleNode)
    node.send("sample_input", LaserScan())
    assert "sample_input: LaserScan" in caplog.text


# end
# each service
def test_it_answers_sample_service(run_node: RunNode) -> None:
    node = run_node(SampleNode)
    answer = node.call("sample_service", Trigger.Request())
    assert isinstance(answer, Trigger.Response)


# end
