"""Actions between robo and ROS 2, both ways: goals, feedback, status, results, and cancelling."""

from collections.abc import Generator, Iterator
from contextlib import ExitStack

import msgspec
import pytest

import robo_messages
from robo import ActionClient, Node, action
from robo.launch.plan import CrossingPlan
from robo_messages import Fibonacci, Message
from robo_messages._types import Int8
from robo_messages.action import UUID, CancelGoal, GoalInfo, GoalStatusArray
from robo_messages.std import Time
from tests.support import eventually

pytest.importorskip("xxhash", reason="the extra ros2 is not installed")

from robo.bridges.ros2.forms import action_form
from tests.ros2 import Both, RosNode

pytestmark = pytest.mark.timeout(120)


# What ROS makes of the action example_interfaces/action/Fibonacci, written down by hand.
@robo_messages.message("test_ros/SendGoal_Request")
class SendGoal(Message):
    goal_id: UUID = msgspec.field(default_factory=UUID)
    goal: Fibonacci.Goal = msgspec.field(default_factory=Fibonacci.Goal)


@robo_messages.message("test_ros/SendGoal_Response")
class Sent(Message):
    accepted: bool = False
    stamp: Time = msgspec.field(default_factory=Time)


@robo_messages.message("test_ros/GetResult_Request")
class GetResult(Message):
    goal_id: UUID = msgspec.field(default_factory=UUID)


@robo_messages.message("test_ros/GetResult_Response")
class Got(Message):
    status: Int8 = 0
    result: Fibonacci.Result = msgspec.field(default_factory=Fibonacci.Result)


@robo_messages.message("test_ros/FeedbackMessage")
class Told(Message):
    goal_id: UUID = msgspec.field(default_factory=UUID)
    feedback: Fibonacci.Feedback = msgspec.field(default_factory=Fibonacci.Feedback)


FORM = action_form("example/Fibonacci")
ID = UUID(bytes(range(16)))


class Counter(Node):
    """Counts."""

    @action("count", rate=100.0)
    def count(self, goal: Fibonacci.Goal) -> Generator[Fibonacci.Feedback, None, Fibonacci.Result]:
        found = [0, 1]
        while goal.order < 0 or len(found) < goal.order + 2:
            found = [*found[-40:], (found[-1] + found[-2]) % 1000]
            yield Fibonacci.Feedback(found)
        return Fibonacci.Result(found)


class Client(Node):
    count = ActionClient(Fibonacci.Goal, Fibonacci.Result, Fibonacci.Feedback, "count", timeout=30.0)


@pytest.fixture
def both() -> Iterator[Both]:
    with ExitStack() as stack:
        yield Both(stack)


def is_announced(ros: RosNode) -> bool:
    return all(any(f"/SS/%/%r1/counter/%count%_action%{part}/" in one for one in ros.tokens()) for part in
               ("send_goal", "cancel_goal", "get_result"))  # fmt: skip


def test_ros_sends_goals_to_an_action_of_robos(both: Both) -> None:
    both.bridge(actions={"*": CrossingPlan(ros="/*")})
    ros = both.ros("client")
    feedback = ros.hear_raw(Told, "/count/_action/feedback", FORM.feedback.type, FORM.feedback.hash)
    status = ros.hear(GoalStatusArray, "/count/_action/status", latched=1)
    with Counter(name="counter", namespace="r1", session=both.robo):
        eventually(lambda: is_announced(ros), "it is announced")
        send, get = FORM.send_goal, FORM.get_result
        where = "/count/_action/send_goal"
        sent = ros.call("", where, SendGoal(ID, Fibonacci.Goal(5)), Sent, type_=send.type, hash_=send.hash)
        assert sent.accepted
        got = ros.call("", "/count/_action/get_result", GetResult(ID), Got, type_=get.type, hash_=get.hash)
        assert got == Got(4, Fibonacci.Result([0, 1, 1, 2, 3, 5, 8]))
        assert feedback.wait(1)[0].goal_id == ID
        eventually(lambda: bool(status.messages) and status.messages[-1].status_list[-1].status == 4, "its state")
        endless = UUID(bytes(16)[:-1] + b"\1")
        ros.call("", where, SendGoal(endless, Fibonacci.Goal(-1)), Sent, type_=send.type, hash_=send.hash)
        asked = CancelGoal.Request(GoalInfo(endless))
        answer = ros.call("action/CancelGoal", "/count/_action/cancel_goal", asked, CancelGoal.Response)
        assert [one.goal_id for one in answer.goals_canceling] == [endless]
        got = ros.call("", "/count/_action/get_result", GetResult(endless), Got, type_=get.type, hash_=get.hash)
        assert got.status == 5


def test_robo_sends_goals_to_an_action_of_ross(both: Both) -> None:
    both.bridge(actions={"count": CrossingPlan(ros="/count", direction="from_ros")})
    ros = both.ros("server")
    told = ros.publisher_raw(Told, "/count/_action/feedback", FORM.feedback.type, FORM.feedback.hash)
    goals: list[SendGoal] = []

    def send(request: SendGoal) -> Sent:
        goals.append(request)
        return Sent(True)

    def get(request: GetResult) -> Got:
        told.publish(Told(request.goal_id, Fibonacci.Feedback([7])))
        return Got(4, Fibonacci.Result([0, 1, 1]))

    ros.serve_raw("/count/_action/cancel_goal", FORM.cancel_goal, CancelGoal.Request, lambda _: CancelGoal.Response())
    ros.serve_raw("/count/_action/get_result", FORM.get_result, GetResult, get)
    ros.serve_raw("/count/_action/send_goal", FORM.send_goal, SendGoal, send)
    feedback: list[Fibonacci.Feedback] = []
    with Client(name="client", namespace="r1", session=both.robo) as client:
        result = client.count(Fibonacci.Goal(1), feedback=feedback.append)
        assert result == Fibonacci.Result([0, 1, 1])
        assert [one.goal.order for one in goals] == [1]
        eventually(lambda: [one.sequence for one in feedback] == [[7]], "feedback")
