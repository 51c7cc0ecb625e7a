"""What nodes report of how well they do, in a test and among real ones; and the node that sums it up."""

import threading
import time
from typing import Any

import msgspec
import pytest
import zenoh

from robo import Health, LifecycleNode, Node, Part, Publisher, check, service, subscribe, timer
from robo.node.diagnostics import Diagnostics
from robo.testing import Clock, NodeUnderTest, RunNode
from robo.testing.heard import Heard
from robo_messages import Clock as SaidClock
from robo_messages import (
    DiagnosticArray,
    DiagnosticStatus,
    Odometry,
    Point,
    Pose,
    PoseWithCovariance,
    String,
    Time,
    Trigger,
    Twist,
    Vector3,
)
from robo_services.diagnostic_aggregator import DiagnosticAggregator
from robo_services.diff_drive_sim import DiffDriveSim
from robo_services.position_tracker import PositionTracker
from robo_services.velocity_smoother import VelocitySmoother
from tests.support import PATIENCE, eventually

OK, WARN, ERROR, STALE = 0, 1, 2, 3


class Lamp(Part):
    burns = True

    @check("lamp")
    def lamp(self) -> Health:
        return Health.ok() if self.burns else Health.error("it is out")


class Torch(Node):
    """A lamp and a battery."""

    lamp = Lamp()
    light = Publisher(String, "light", deadline=2.0)

    def on_start(self) -> None:
        self.volts: Any = 12.0

    @subscribe("volts")
    def on_volts(self, volts: String) -> None:
        self.volts = float(volts.data)
        self.light.publish(volts)

    @check("battery")
    def battery(self) -> Any:
        if self.volts is None:
            return "no health"
        if self.volts < 11.0:
            return Health.warn("charge it", volts=self.volts)
        return Health.ok(volts=self.volts)


def said(node: NodeUnderTest[Any], name: str) -> dict[str, DiagnosticStatus]:
    """The last report of a node: its statuses by the names of the checks."""
    report: DiagnosticArray = node.published("diagnostics")[-1]
    assert all(one.name.startswith(f"{name}: ") for one in report.status)
    return {one.name.rpartition(": ")[2]: one for one in report.status}


def levels(node: NodeUnderTest[Any], name: str) -> dict[str, int]:
    return {check: one.level for check, one in said(node, name).items()}


def test_a_node_reports_once_a_second(run_node: RunNode, clock: Clock) -> None:
    torch = run_node(Torch, namespace="r1")
    assert torch.published("diagnostics") == []
    assert torch.node.status.checks == []
    for _ in range(50):
        torch.send("volts", String("12.25"))
        clock.advance(0.1)
    assert len(torch.published("diagnostics")) == 5
    assert torch.published("diagnostics")[-1].header.stamp == clock.now()
    found = said(torch, "/r1/torch")
    assert list(found) == ["topics", "callbacks", "lamp", "battery"]
    assert {one.level for one in found.values()} == {OK}
    assert found["topics"].message == "10.0 Hz in, 10.0 Hz out"
    assert [(one.key, one.value) for one in found["battery"].values] == [("volts", "12.25")]
    assert torch.node.status.checks == list(found.values())


def test_own_checks_are_told_those_of_parts_too(run_node: RunNode, clock: Clock) -> None:
    torch = run_node(Torch, namespace="r1")
    torch.send("volts", String("10.5"))
    torch.node.lamp.burns = False
    clock.advance(1.0)
    found = said(torch, "/r1/torch")
    assert (found["battery"].level, found["battery"].message) == (WARN, "charge it")
    assert (found["lamp"].level, found["lamp"].message) == (ERROR, "it is out")
    torch.send("volts", String("12.5"))
    clock.advance(1.0)
    assert levels(torch, "/r1/torch")["battery"] == OK


def test_a_promise_that_is_not_kept_is_told(run_node: RunNode, clock: Clock) -> None:
    torch = run_node(Torch)
    clock.advance(3.0)
    topics = said(torch, "/torch")["topics"]
    assert (topics.level, topics.message) == (ERROR, "nothing published on light for 3 s, its deadline is 2 s")


def test_a_check_that_raises_or_says_nothing_is_an_error_and_hides_no_other(session: zenoh.Session) -> None:
    class Broken(Torch):
        @check("pump")
        def pump(self) -> Health:
            raise OSError("no such device")

        @check("mute")
        def mute(self) -> Health:
            class Mute(Exception):
                def __str__(self) -> str:
                    raise ValueError("it cannot even say that")

            raise Mute

    with Broken(namespace="r1", session=session) as node:
        node.volts = None
        eventually(lambda: len(node.status.checks) == 6, "it has reported")
        found = {one.name.rpartition(": ")[2]: one for one in node.status.checks}
        assert (found["pump"].level, found["pump"].message) == (ERROR, "raised OSError: no such device")
        assert (found["mute"].level, found["mute"].message) == (ERROR, "raised Mute")
        assert found["battery"].level == ERROR
        assert "the check 'battery' returned str, not a robo.Health" in found["battery"].message
        assert found["lamp"].level == OK
        eventually(lambda: node.status.callback_errors >= 4, "they are counted")
        eventually(lambda: "raised" in node.status.checks[1].message, "and told of")


def test_a_check_that_raises_fails_a_test(run_node: RunNode, clock: Clock) -> None:
    class Broken(Node):
        @check("pump")
        def pump(self) -> Health:
            raise OSError("no such device")

    run_node(Broken)
    with pytest.raises(OSError, match="no such device"):
        clock.advance(1.0)


def test_no_report_says_that_all_is_well_before_the_checks_were_asked(
    session: zenoh.Session, other: zenoh.Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on a busy machine, on which what asks may come to its turn after what reports."""
    report_was_due = threading.Event()
    asks, reports = Diagnostics._ask, Diagnostics._report

    def ask(self: Diagnostics) -> None:
        assert report_was_due.wait(PATIENCE), "a report is due"
        asks(self)

    def report(self: Diagnostics) -> None:
        reports(self)
        report_was_due.set()

    monkeypatch.setattr(Diagnostics, "_ask", ask)
    monkeypatch.setattr(Diagnostics, "_report", report)
    monkeypatch.setattr("robo.node.diagnostics.PERIOD", 0.1)
    heard = Heard(other, "r1/diagnostics")
    with Torch(namespace="r1", session=session):
        first = heard.wait_for("r1/diagnostics", lambda _: True, PATIENCE)
    assert [one.name for one in first.status[2:]] == ["/r1/torch: lamp", "/r1/torch: battery"]
    heard.close()


def test_a_callback_that_does_not_return_is_named_and_checks_become_stale(
    session: zenoh.Session, other: zenoh.Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A report comes all the same: it has a turn of its own."""
    monkeypatch.setattr("robo.node.diagnostics.PERIOD", 0.1)
    monkeypatch.setattr("robo.node.diagnostics.OVERDUE", 0.3)
    monkeypatch.setattr("robo.node.diagnosis.LONG_CALLBACK", 0.4)
    monkeypatch.setattr("robo.node.diagnosis.HANGING", 0.8)
    free = threading.Event()

    class Stuck(Torch):
        @service("plan")
        def plan(self, _request: Trigger.Request) -> Trigger.Response:
            free.wait(PATIENCE)
            return Trigger.Response()

    heard = Heard(other, "r1/diagnostics")

    def told(name: str, condition: Any) -> DiagnosticStatus:
        def of(report: DiagnosticArray) -> DiagnosticStatus:
            return next((one for one in report.status if one.name == f"/r1/stuck: {name}"), DiagnosticStatus())

        return of(heard.wait_for("r1/diagnostics", lambda report: condition(of(report)), PATIENCE, anew=True))

    with Stuck(namespace="r1", session=session):
        told("battery", lambda one: one.level == OK and one.values)
        replies = other.get("r1/plan", payload=msgspec.msgpack.encode(Trigger.Request()), timeout=PATIENCE)
        assert "plan has been running for" in told("callbacks", lambda one: one.level == WARN).message
        told("callbacks", lambda one: one.level == ERROR)
        assert told("battery", lambda one: one.level == STALE).message.startswith("not asked for ")
        free.set()
        assert [reply.ok is not None for reply in replies] == [True]
        told("battery", lambda one: one.level == OK)
        assert "plan held up the others for" in told("callbacks", lambda one: one.level == WARN).message
        told("callbacks", lambda one: one.level == OK)
    heard.close()


def test_waiting_for_a_service_holds_nobody_up(session: zenoh.Session) -> None:
    class Patient(Node):
        @service("slow", turn="slow")
        def slow(self, _request: Trigger.Request) -> Trigger.Response:
            time.sleep(0.5)
            return Trigger.Response()

        @timer(rate=1.0)
        def ask(self) -> None:
            client = self.create_client(Trigger.Request, Trigger.Response, "slow")
            client(Trigger.Request())

    with Patient(session=session) as node:
        turns = node._turns
        eventually(lambda: turns.others["slow"].longest > 0.4, "the slow one is noted")
        eventually(lambda: turns.own.longest_of == "ask", "and the one that waits")
        assert turns.own.longest < 0.4, "of it what it did itself"


class Camera(LifecycleNode):
    @check("exposure")
    def exposure(self) -> Health:
        return Health.warn("dark")


def test_a_managed_node_is_asked_while_it_is_active(run_node: RunNode, clock: Clock) -> None:
    camera = run_node(Camera, autostart=False)
    clock.advance(2.0)
    assert levels(camera, "/camera") == {"topics": OK, "callbacks": OK}
    lifecycle = {one.key: one.value for one in said(camera, "/camera")["callbacks"].values}["lifecycle"]
    assert lifecycle == "unconfigured"
    for transition in ("configure", "activate"):
        camera.change_state(transition)
    clock.advance(1.0)
    assert levels(camera, "/camera")["exposure"] == WARN
    camera.change_state("deactivate")
    clock.advance(1.0)
    assert "exposure" not in levels(camera, "/camera")


def test_simulated_time_that_stands_still_holds_no_report_back(session: zenoh.Session, other: zenoh.Session) -> None:
    heard = Heard(other, "diagnostics")
    with Torch(parameters={"use_sim_time": True}, session=session):
        other.put("clock", msgspec.msgpack.encode(SaidClock(Time.from_seconds(7.0))))
        for _ in range(3):
            report = heard.wait_for("diagnostics", lambda _: True, PATIENCE, anew=True)
        assert report.header.stamp.to_seconds() == pytest.approx(time.time(), abs=60.0), "the wall clock's"
        assert report.status[0].level == OK, "in simulated time nothing is late"
    heard.close()


def test_a_node_that_has_ended_reports_no_more_and_begins_anew(session: zenoh.Session, other: zenoh.Session) -> None:
    heard = Heard(other, "diagnostics")
    node = Torch(session=session)
    for _ in range(2):
        node.start()
        heard.wait_for("diagnostics", lambda _: True, PATIENCE, anew=True)
        node.close()
    assert not [thread for thread in threading.enumerate() if "diagnostics" in thread.name]
    heard.close()


# -- the node that sums up ---------------------------------------------------------------------------


def total(aggregator: NodeUnderTest[DiagnosticAggregator]) -> tuple[int, str]:
    state: DiagnosticStatus = aggregator.published("diagnostics_toplevel_state")[-1]
    assert state.name == "toplevel_state"
    return state.level, state.message


def test_the_aggregator_sums_up_its_robot_and_tells_of_changes(
    run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    aggregator = run_node(DiagnosticAggregator, namespace="r1")
    torch = run_node(Torch, namespace="r1", name="torch")
    caplog.set_level("INFO")

    def go(seconds: int, volts: str) -> None:
        for _ in range(seconds):
            torch.send("volts", String(volts))
            clock.advance(1.0)

    go(3, "12.0")
    assert total(aggregator) == (OK, "OK")
    go(2, "10.0")
    assert total(aggregator) == (WARN, "/r1/torch/battery: charge it")
    sums = {one.name: one for one in aggregator.published("diagnostics_agg")[-1].status}
    assert (sums["/r1"].level, sums["/r1"].message) == (WARN, "torch: battery: charge it")
    assert (sums["/r1/torch/battery"].values[0].key, sums["/r1/torch/lamp"].level) == ("volts", OK)
    assert sums["/r1/diagnostic_aggregator"].level == OK
    go(2, "12.0")
    torch.close()
    clock.advance(8.0)
    level, message = total(aggregator)
    assert level == ERROR
    assert message.startswith("/r1/torch: has said nothing for ")
    lines = [text for text in caplog.messages if text.split(":")[0] in ("OK", "WARN", "ERROR", "STALE")]
    assert [text.split(":")[0] for text in lines] == ["OK", "WARN", "OK", "ERROR"], "each change once"
    aggregator.set(discard_stale=True)
    clock.advance(1.0)
    assert total(aggregator) == (OK, "OK")


def test_the_aggregator_sums_up_other_namespaces_that_are_named(run_node: RunNode, clock: Clock) -> None:
    aggregator = run_node(DiagnosticAggregator, namespace="r1", namespaces=["arm", "/r2"])
    run_node(Torch, namespace="r1/arm").send("volts", String("10.0"))
    run_node(Torch, namespace="r2")
    run_node(Torch, namespace="r3")
    clock.advance(2.0)
    found = {one.name for one in aggregator.published("diagnostics_agg")[-1].status}
    assert {"/r1/arm/torch/battery", "/r2/torch/battery", "/r1", "/r2"} <= found
    assert not [name for name in found if "r3" in name]


def test_what_others_say_is_summed_up_too(run_node: RunNode, clock: Clock, robo_session: zenoh.Session) -> None:
    aggregator = run_node(DiagnosticAggregator, namespace="r1")
    clock.advance(1.0)
    text = '{"status": [{"name": "lidar: link", "level": 2, "message": "no cable"}, {"name": ""}]}'
    robo_session.put("r1/diagnostics", text, encoding="application/json")
    clock.advance(1.0)
    assert total(aggregator) == (ERROR, "/r1/lidar/link: no cable")


# -- the nodes that ship -----------------------------------------------------------------------------


def test_the_tracker_doubts_odometry_aloud(run_node: RunNode, clock: Clock) -> None:
    def odometry(x: float) -> Odometry:
        return Odometry(pose=PoseWithCovariance(Pose(Point(x))))

    tracker = run_node(PositionTracker, max_linear_velocity=1.0)
    clock.advance(1.0)
    assert said(tracker, "/position_tracker")["odometry"].message == "nothing has come on odom"
    tracker.send("odom", odometry(0.0))
    clock.advance(1.0)
    assert levels(tracker, "/position_tracker")["odometry"] == OK
    tracker.send("odom", odometry(1e6))
    clock.advance(1.0)
    doubted = said(tracker, "/position_tracker")["odometry"]
    assert doubted.level == WARN
    assert "left out what cannot be: 1e+06 m" in doubted.message
    clock.advance(11.0)
    assert levels(tracker, "/position_tracker")["odometry"] == OK


def test_the_smoother_tells_of_bad_commands_and_of_an_open_loop(run_node: RunNode, clock: Clock) -> None:
    smoother = run_node(VelocitySmoother)
    clock.advance(1.0)
    assert levels(smoother, "/velocity_smoother")["feedback"] == OK
    smoother.set(feedback="closed_loop")
    smoother.send("cmd_vel", Twist(Vector3(float("nan"))))
    clock.advance(1.0)
    found = said(smoother, "/velocity_smoother")
    assert (found["commands"].level, found["feedback"].level) == (WARN, WARN)
    for _ in range(60):
        smoother.send("odom", Odometry())
        clock.advance(0.1)
    assert levels(smoother, "/velocity_smoother") == {"topics": OK, "callbacks": OK, "commands": OK, "feedback": OK}


def test_the_base_tells_that_it_pushes(run_node: RunNode, clock: Clock) -> None:
    base = run_node(DiffDriveSim, x=4.0)
    clock.advance(1.0)
    assert levels(base, "/diff_drive_sim")["contact"] == OK
    for _ in range(30):
        base.send("cmd_vel", Twist(Vector3(1.0)))
        clock.advance(0.1)
    assert levels(base, "/diff_drive_sim")["contact"] == WARN
