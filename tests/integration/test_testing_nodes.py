"""The fixtures for nodes under test: what comes of the nodes is exactly what the test makes happen."""

import logging
import threading
import time
from typing import Annotated

import pytest
import zenoh
from msgspec import Meta

import robo
from robo import Client, MessageInfo, Node, Publisher, service, subscribe, timer
from robo.testing import Clock, Hung, NodeEnded, NodeUnderTest, NotThere, RunNode, StillWaiting
from robo_messages import Odometry, SetBool, String, Trigger, Twist, Vector3
from robo_services.safety_monitor import SafetyMonitor
from tests.support import eventually


class Gripper(Node):
    """Closes by steps."""

    class Parameters(robo.Parameters):
        rate: Annotated[float, Meta(gt=0, description="steps a second")] = 1.0

    parameters: Parameters

    steps = Publisher(String, "steps")
    heard = Publisher(String, "heard")
    count = 0

    @timer(rate="rate")
    def step(self) -> None:
        self.count += 1
        self.steps.publish(String(f"{self.count} at {self.clock.monotonic():.3f}"))

    @subscribe("order")
    def on_order(self, order: String, info: MessageInfo) -> None:
        self.logger.info("ordered to %s", order.data)
        match order.data:
            case "fail":
                raise ValueError("no such order")
            case "die":
                raise SystemExit(3)
            case "hang":
                released.wait()
            case _:
                self.heard.publish(String(f"{order.data}, {info.age:.2f} s old, of {info.source or 'nobody'}"))

    @service("close")
    def on_close(self, _request: Trigger.Request) -> Trigger.Response:
        if not self.count:
            raise ValueError("there is nothing to close")
        return Trigger.Response(message=f"after {self.count} steps")


released = threading.Event()
"""Ends what hangs, so that nothing of it is left."""


def texts(node: NodeUnderTest[Gripper], topic: str) -> list[str]:
    return [message.data for message in node.published(topic)]


def test_timers_run_when_the_time_has_come(run_node: RunNode, clock: Clock) -> None:
    node = run_node(Gripper, rate=10.0)
    clock.advance(0.0999)
    assert texts(node, "steps") == []
    clock.advance(0.0001)
    assert texts(node, "steps") == ["1 at 0.100"]
    clock.advance(0.25)
    assert texts(node, "steps") == ["1 at 0.100", "2 at 0.200", "3 at 0.300"]
    assert clock.monotonic() == pytest.approx(0.35)
    assert clock.now() == node.node.now()


@pytest.mark.parametrize("seconds", [-0.1, float("nan"), float("inf")])
def test_time_does_not_step_back(clock: Clock, seconds: float) -> None:
    with pytest.raises(ValueError, match="time goes on by 0 to"):
        clock.advance(seconds)


def test_a_changed_rate_counts_at_once(run_node: RunNode, clock: Clock) -> None:
    node = run_node(Gripper)
    clock.advance(0.5)
    node.set(rate=4.0)
    clock.advance(0.5)
    assert [text.partition(" ")[2] for text in texts(node, "steps")] == ["at 0.500", "at 0.750", "at 1.000"]
    with pytest.raises(robo.ParameterError, match="rate"):
        node.set(rate=-1.0)
    assert node.node.parameters.rate == 4.0


def test_a_message_is_handled_when_send_returns(
    run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    node = run_node(Gripper, namespace="r1", remap={"order": "work"})
    node.send("order", String("open"))
    clock.advance(10.0)
    node.send("order", String("wait"), age=0.25, source="boss")
    node.send("/r1/work", String("rest"), age=0.5, source=None)
    assert [message.data for message in node.published(Gripper.heard)] == [
        "open, 0.00 s old, of /r1/test",
        "wait, 0.25 s old, of /r1/boss",
        "rest, 0.50 s old, of nobody",
    ]
    assert "ordered to wait" in caplog.messages
    assert [record.msg for record in node.published("log")] == [f"ordered to {one}" for one in ("open", "wait", "rest")]
    node.clear()
    assert node.published("heard") == []


def test_services_answer(run_node: RunNode, clock: Clock) -> None:
    node = run_node(Gripper)
    for _ in range(2):
        with pytest.raises(robo.ServiceError, match="nothing to close") as told:
            node.call("close", Trigger.Request())
        assert isinstance(told.value.__cause__, ValueError)
    clock.advance(3.0)
    assert node.call("close", Trigger.Request()).message == "after 3 steps"


def test_what_is_not_there_is_named_with_what_is(run_node: RunNode) -> None:
    node = run_node(Gripper)
    with pytest.raises(NotThere, match="/gripper does not subscribe to orders; did you mean order"):
        node.send("orders", String())
    with pytest.raises(NotThere, match="/gripper does not publish step; did you mean steps"):
        node.published("step")
    with pytest.raises(NotThere, match="/gripper has no service clos; did you mean close"):
        node.call("clos", Trigger.Request())
    with pytest.raises(TypeError, match="order takes std/String, not Twist"):
        node.send("order", Twist())
    with pytest.raises(TypeError, match="service close takes std/Trigger_Request, not String"):
        node.call("close", String())


def test_what_a_callback_raises_reaches_the_test(run_node: RunNode) -> None:
    node = run_node(Gripper)
    for _ in range(3):
        with pytest.raises(ValueError, match="no such order"):
            node.send("order", String("fail"))
    node.send("order", String("go on"))
    assert len(node.published("heard")) == 1


def test_a_node_that_ends_has_an_exit_code(run_node: RunNode) -> None:
    node = run_node(Gripper)
    node.send("order", String("die"))
    assert node.has_ended()
    assert node.exit_code == 3
    with pytest.raises(NodeEnded, match="/gripper has ended, with exit code 3"):
        node.send("order", String("wake up"))


def test_a_callback_that_hangs_is_named(run_node: RunNode, clock: Clock) -> None:
    node = run_node(Gripper)
    clock.patience = 1.0
    with pytest.raises(Hung, match=r"/gripper: on_order has been running for .*\n.*order has not come back") as told:
        node.send("order", String("hang"))
    assert "released.wait()" in str(told.value)
    released.set()


def test_what_fails_at_the_start_leaves_nothing(run_node: RunNode) -> None:
    class Unfit(Gripper):
        def on_start(self) -> None:
            raise OSError("no gripper is connected")

    with pytest.raises(OSError, match="no gripper"):
        run_node(Unfit)
    with pytest.raises(robo.ParameterError, match="rate"):
        run_node(Gripper, rate=0.0)


# -- several nodes -----------------------------------------------------------------------------------------------------


class Relay(Node):
    """Says again what it hears, of each side."""

    out = Publisher(String, "heard")

    @subscribe("steps")
    def on_step(self, step: String) -> None:
        self.out.publish(String(f"{self.name}: {step.data}"))

    @subscribe("heard")
    def on_heard(self, heard: String) -> None:
        if self.name == "last" and heard.data.startswith("first"):
            self.out.publish(String(f"{self.name} heard {heard.data}"))


def conversation(run_node: RunNode, clock: Clock) -> list[str]:
    """What two relays say of two grippers whose steps coincide."""
    run_node(Gripper, name="left", rate=10.0)
    relays = [run_node(Relay, name=name) for name in ("first", "last")]
    run_node(Gripper, name="right", rate=5.0)
    heard: list[str] = []
    clock.advance(1.0)
    for relay in relays:
        heard += [message.data for message in relay.published("heard")]
    return heard


@pytest.mark.parametrize("run", range(100))
def test_the_same_happens_each_time(run_node: RunNode, clock: Clock, run: int) -> None:
    del run
    heard = conversation(run_node, clock)
    assert len(heard) == 15 * 3
    assert heard[:4] == ["first: 1 at 0.100", "first: 2 at 0.200", "first: 1 at 0.200", "first: 3 at 0.300"]
    assert heard[15:19] == [
        "last: 1 at 0.100",
        "last heard first: 1 at 0.100",
        "last: 2 at 0.200",
        "last heard first: 2 at 0.200",
    ]


class Driver(Node):
    """Drives for a while."""

    velocity = Publisher(Twist, "cmd_vel")

    @service("drive")
    def drive(self, _request: Trigger.Request) -> Trigger.Response:
        for _ in range(5):
            self.velocity.publish(Twist(Vector3(x=1.0)))
            self.sleep(0.1)
        return Trigger.Response(message=f"done at {self.clock.monotonic():.1f}")


class Boss(Node):
    """Has somebody drive."""

    drive = Client(Trigger.Request, Trigger.Response, "drive")
    lights = Client(SetBool.Request, SetBool.Response, "lights")
    told = Publisher(String, "told")
    ticks = 0

    @service("lights")
    def on_lights(self, request: SetBool.Request) -> SetBool.Response:
        return SetBool.Response(message=f"{request.data}")

    @timer(rate=10.0)
    def tick(self) -> None:
        self.ticks += 1

    @subscribe("go")
    def on_go(self, _go: String) -> None:
        lights = self.lights(SetBool.Request(data=True)).message
        answer = self.drive(Trigger.Request()).message
        self.told.publish(String(f"{answer}, {lights}, {self.ticks} ticks"))


def test_time_passes_for_a_handler_that_waits(run_node: RunNode, clock: Clock) -> None:
    driver = run_node(Driver)
    with pytest.raises(StillWaiting, match=r"drive has not answered.*robo-drive for 0\.1 s"):
        driver.call("drive", Trigger.Request())
    clock.advance(0.5)
    call = driver.begin_call("drive", Trigger.Request())
    clock.advance(0.49)
    assert not call.done()
    clock.advance(0.01)
    assert call.result().message == "done at 1.0"
    assert len(driver.published("cmd_vel")) == 10


def test_a_callback_that_waits_for_another_node_goes_on_at_once(run_node: RunNode, clock: Clock) -> None:
    run_node(Driver)
    boss = run_node(Boss)
    boss.send("go", String())
    clock.advance(0.45)
    assert boss.published("told") == []
    clock.advance(10.0)
    # Of what is due at the same time that of the node that was started first comes first: the end of the drive.
    assert boss.published(Boss.told) == [String("done at 0.5, True, 4 ticks")]


# -- main, threads, time -----------------------------------------------------------------------------------------------


class Player(Node):
    """Plays three notes, then ends."""

    notes = Publisher(String, "notes")

    def main(self) -> None:
        for note in "abc":
            self.notes.publish(String(note))
            self.sleep(1.0)


def test_main_sleeps_by_the_clock(run_node: RunNode, clock: Clock) -> None:
    player = run_node(Player)
    assert player.published("notes") == [String("a")]
    clock.advance(1.5)
    assert player.published("notes") == [String("a"), String("b")]
    assert not player.has_ended()
    clock.advance(60.0)
    assert player.has_ended()
    assert player.exit_code == 0
    assert player.published("notes")[-1] == String("c")


class Listener(Node):
    """Waits in main, and in a thread of its own, for what no clock knows."""

    lines = Publisher(String, "lines")

    def on_start(self) -> None:
        self.port = threading.Semaphore(0)
        threading.Thread(target=self.read, daemon=True).start()

    def read(self) -> None:
        while not self.stopping:
            if self.port.acquire(timeout=0.01):
                self.lines.publish(String("a line"))

    def main(self) -> None:
        while not self.stopping:
            time.sleep(0.01)


def test_a_thread_of_its_own_holds_nobody_up(run_node: RunNode, clock: Clock) -> None:
    node, gripper = run_node(Listener), run_node(Gripper)
    clock.advance(1.0)
    assert len(gripper.published("steps")) == 1
    node.node.port.release()
    assert node.wait_for("lines", lambda line: "line" in line.data).data == "a line"


def test_simulated_time_is_the_tests(run_node: RunNode, clock: Clock) -> None:
    node = run_node(Gripper, use_sim_time=True, rate=2.0)
    clock.advance(1.0)
    assert texts(node, "steps") == ["1 at 0.500", "2 at 1.000"]


def test_a_node_that_ships_can_be_stepped(run_node: RunNode, clock: Clock) -> None:
    monitor = run_node(SafetyMonitor, laser=False, namespace="r1")
    for _ in range(10):
        monitor.send("odom", Odometry())
        monitor.send("cmd_vel_raw", Twist(Vector3(x=0.1)), source="driver")
        clock.advance(0.05)
    assert monitor.published("cmd_vel")[-1].linear.x == 0.1
    clock.advance(2.0)
    assert monitor.published("cmd_vel")[-1].linear.x == 0.0


# -- what surrounds them ---------------------------------------------------------------------------------------------


def test_a_session_of_the_test_alone(robo_session: zenoh.Session, run_node: RunNode, clock: Clock) -> None:
    heard: list[str] = []
    subscriber = robo_session.declare_subscriber("r1/steps", lambda sample: heard.append(str(sample.key_expr)))
    run_node(Gripper, namespace="r1")
    clock.advance(2.0)
    eventually(lambda: heard == ["r1/steps"] * 2, "Zenoh has called what is no node's")
    subscriber.undeclare()


def test_the_environment_says_nothing(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> None:
    monkeypatch.setenv("ROBO_NAMESPACE", "r9")
    run_node = request.getfixturevalue("run_node")
    assert run_node(Gripper).node.full_name == "/gripper"


def test_the_level_of_logs_is_put_back(run_node: RunNode) -> None:
    run_node(Gripper)
    assert logging.getLogger("robo.node").level == logging.INFO
