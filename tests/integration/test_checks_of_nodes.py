"""What the nodes of the reference robot, and those of bases, say of themselves."""

from pathlib import Path
from typing import Any

import pytest

from robo.testing import Clock, NodeUnderTest, RunNode
from robo_messages import Bool, JointState, LaserScan, Trigger, Twist, Vector3
from robo_services.diff_drive_controller import DiffDriveController
from robo_services.joy import Joy
from robo_services.safety import Decision
from robo_services.safety_monitor import SafetyMonitor, health_of
from robo_services.twist_mux import TwistMux
from robo_services.waypoint_follower import WaypointFollower

OK, WARN, ERROR = 0, 1, 2


def said(node: NodeUnderTest[Any], clock: Clock, check: str) -> tuple[int, str]:
    """The level and the sentence of a check, once it was asked again."""
    clock.advance(1.1)
    report = node.published("diagnostics")[-1]
    return next((one.level, one.message) for one in report.status if one.name.endswith(f": {check}"))


def test_the_monitor(run_node: RunNode, clock: Clock) -> None:
    monitor = run_node(SafetyMonitor, namespace="r1", scan_timeout=10.0, command_timeout=10.0)
    assert said(monitor, clock, "safety") == (ERROR, "no laser scan so far")
    monitor.send("scan", LaserScan(angle_min=-3.1, angle_increment=0.1, range_max=10.0, ranges=[5.0] * 63))
    assert said(monitor, clock, "safety") == (OK, "no command so far")
    monitor.send("cmd_vel_raw", Twist(Vector3(0.2)))
    assert said(monitor, clock, "safety") == (OK, "nothing in the way")
    monitor.call("emergency_stop", Trigger.Request())
    assert said(monitor, clock, "safety") == (ERROR, "emergency stop, until reset_emergency_stop is called")


@pytest.mark.parametrize(
    ("action", "reason", "rival", "level"),
    [
        ("clear", "clear", "", OK),
        ("slow", "obstacle_near", "", OK),
        ("stop", "stale_command", "", OK),
        ("stop", "obstacle", "", WARN),
        ("stop", "blind", "", WARN),
        ("stop", "stale_source", "", ERROR),
        ("stop", "overspeed", "", ERROR),
        ("clear", "clear", "/r1/stranger", WARN),
        ("stop", "rival", "/r1/stranger", ERROR),
    ],
)
def test_what_the_monitor_decides_is_as_grave_as_it_is_unusual(
    action: Any, reason: str, rival: str, level: int
) -> None:
    health = health_of(Decision(action, reason, "why", Twist()), rival)
    assert (health.level, health.values) == (level, {"action": action})
    assert health.message.startswith("why")


def test_the_mux(run_node: RunNode, clock: Clock) -> None:
    mux = run_node(
        TwistMux,
        namespace="r1",
        topics={"key": {"topic": "cmd_vel_key", "priority": 10, "timeout": 5.0}},
        locks={"pause": {"topic": "pause", "priority": 50, "timeout": 0.0}},
    )
    assert said(mux, clock, "driver")[0] == OK
    mux.send("cmd_vel_key", Twist(Vector3(0.2)))
    assert said(mux, clock, "driver")[0] == OK
    mux.send("pause", Bool(True))
    level, text = said(mux, clock, "driver")
    assert (level, "pause" in text) == (WARN, True)
    mux.send("pause", Bool(False))
    assert said(mux, clock, "driver")[0] == OK


def test_the_wheels(run_node: RunNode, clock: Clock) -> None:
    controller = run_node(
        DiffDriveController, namespace="r1", left_wheel_names=["left"], right_wheel_names=["right"],
        wheel_separation=0.3, wheel_radius=0.05, joint_states_timeout=2.0,
    )  # fmt: skip
    assert said(controller, clock, "wheels") == (
        ERROR,
        "the wheels stand: nothing new on r1/joint_states of left, right",
    )
    controller.send("joint_states", JointState(name=["left", "right"], position=[0.0, 0.0], velocity=[0.0, 0.0]))
    assert said(controller, clock, "wheels")[0] == OK


def test_the_follower(run_node: RunNode, clock: Clock) -> None:
    follower = run_node(WaypointFollower, namespace="r1", waypoints=[[1.0, 0.0]])
    level, text = said(follower, clock, "course")
    assert level == WARN, text  # it does not know where it is
    assert said(run_node(WaypointFollower, namespace="r2"), clock, "course")[0] == OK


def test_the_pad(run_node: RunNode, clock: Clock, tmp_path: Path) -> None:
    level, text = said(run_node(Joy, namespace="r1", device=str(tmp_path / "js7")), clock, "pad")
    assert (level, text.startswith("no pad: ")) == (ERROR, True)
