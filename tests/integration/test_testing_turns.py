"""Nodes under test whose callbacks have turns of their own, or give theirs away."""

from robo import Node, Publisher, service, subscribe
from robo.testing import Clock, RunNode
from robo_messages import String, Trigger


class Crane(Node):
    """Lifts for two seconds, in the node's turn; two callbacks share another one."""

    command = Publisher(String, "command")

    @subscribe("lift")
    def on_lift(self, _lift: String) -> None:
        for _ in range(20):
            self.command.publish(String(f"up at {self.clock.monotonic():.1f}"))
            self.sleep(0.1)

    @service("height")
    def height(self, _request: Trigger.Request) -> Trigger.Response:
        return Trigger.Response(message="2 m")

    @service("emergency_stop", turn="stop")
    def stop(self, _request: Trigger.Request) -> Trigger.Response:
        self.command.publish(String(f"stop at {self.clock.monotonic():.2f}"))
        return Trigger.Response(message="stopped")

    @service("brake", turn="stop")
    def brake(self, _request: Trigger.Request) -> Trigger.Response:
        self.sleep(0.5)
        return Trigger.Response(message="braked")


def test_a_callback_with_a_turn_of_its_own_waits_for_no_other(run_node: RunNode, clock: Clock) -> None:
    crane = run_node(Crane)
    crane.send("lift", String())
    clock.advance(0.25)
    height = crane.begin_call("height", Trigger.Request())
    assert crane.call("emergency_stop", Trigger.Request()).message == "stopped"
    assert not height.done()
    told = crane.published(Crane.command)
    assert told[-2:] == [String("up at 0.2"), String("stop at 0.25")]
    clock.advance(1.74)
    assert not height.done()
    clock.advance(0.01)
    assert height.result().message == "2 m"


def test_callbacks_that_share_a_turn_wait_for_each_other(run_node: RunNode, clock: Clock) -> None:
    crane = run_node(Crane)
    brake = crane.begin_call("brake", Trigger.Request())
    stop = crane.begin_call("emergency_stop", Trigger.Request())
    assert crane.call("height", Trigger.Request()).message == "2 m"
    clock.advance(0.4)
    assert not stop.done()
    clock.advance(0.1)
    assert (brake.result().message, stop.result().message) == ("braked", "stopped")
    assert crane.published(Crane.command) == [String("stop at 0.50")]
    assert crane.node.status.turns["stop"].callbacks == ["stop", "brake"]


class Slow(Node):
    """Takes a second for each message."""

    done = Publisher(String, "done")

    @subscribe("work")
    def on_work(self, work: String) -> None:
        self.sleep(1.0)
        self.done.publish(work)


def test_what_comes_while_a_callback_waits_for_the_time_is_taken_when_it_returns(
    run_node: RunNode, clock: Clock
) -> None:
    slow = run_node(Slow)
    for work in "abc":
        slow.send("work", String(work))
    clock.advance(2.5)
    assert slow.published(Slow.done) == [String("a"), String("b")]
    clock.advance(0.5)
    assert slow.published(Slow.done)[-1] == String("c")
