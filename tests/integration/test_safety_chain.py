"""The reference robot's control chain as nodes of one process: time and obstacles are the test's."""

import math
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest
import zenoh

from robo.testing import Clock, NodeUnderTest, RunNode
from robo_messages import LaserScan, Trigger, Twist, Vector3
from robo_services import safety_monitor
from robo_services.diff_drive_sim import DiffDriveSim
from robo_services.safety import Decision, Limits, Situation, decide
from robo_services.safety_monitor import SafetyMonitor
from robo_services.velocity_controller import VelocityController


def speed(twist: Twist) -> float:
    return math.hypot(twist.linear.x, twist.linear.y)


def scan(ahead: float) -> LaserScan:
    ranges = [math.inf] * 360
    ranges[180] = ahead
    return LaserScan(angle_min=-math.pi, angle_increment=math.tau / 360, range_max=10.0, ranges=ranges)


def last_reason(monitor: NodeUnderTest[SafetyMonitor]) -> str:
    reason: str = monitor.published("safety_state")[-1].values[1].value
    return reason


def until(clock: Clock, condition: Callable[[], bool], what: str, limit: float = 60.0) -> None:
    """Let time pass until something is so."""
    end = clock.monotonic() + limit
    while not condition():
        assert clock.monotonic() < end, f"not within {limit} s: {what}"
        clock.advance(0.02)


def test_the_controller_ramps_up_and_leaves_a_standing_robot(run_node: RunNode, clock: Clock) -> None:
    controller = run_node(VelocityController, namespace="r1", publish_rate=100.0, linear_velocity=0.2)
    clock.advance(1.0)
    commands = controller.published("cmd_vel")
    assert all(speed(b) - speed(a) <= 0.01 + 1e-9 for a, b in pairwise(commands))
    assert speed(commands[-1]) == 0.2
    assert commands[-1].angular.z == 0.2
    controller.close()
    assert speed(controller.published("cmd_vel")[-1]) == 0.0


def test_the_monitor_passes_slows_stops_and_fails_closed(run_node: RunNode, clock: Clock) -> None:
    monitor = run_node(SafetyMonitor, namespace="r1", scan_timeout=0.3, command_timeout=0.3)

    def reached(ahead: float | None, x: float | None = 0.4, seconds: float = 0.1) -> float:
        """What the base is told after a while in which this was seen and commanded, m/s."""
        end = clock.monotonic() + seconds
        while clock.monotonic() < end - 1e-6:
            if ahead is not None:
                monitor.send("scan", scan(ahead))
            if x is not None:
                monitor.send("cmd_vel_raw", Twist(Vector3(x=x)))
            clock.advance(0.02)
        return speed(monitor.published("cmd_vel")[-1])

    assert reached(None, None) == 0.0
    assert "no laser scan so far" in monitor.published("safety_state")[-1].message
    assert reached(5.0) == 0.4
    assert reached(0.4) == pytest.approx(0.2)
    assert reached(0.2) == 0.0
    assert reached(5.0) == 0.4
    assert reached(5.0, math.nan) == 0.0
    assert last_reason(monitor) == "invalid_command"
    assert reached(5.0) == 0.4
    assert reached(None, seconds=0.26) == 0.4
    assert reached(None, seconds=0.06) == 0.0  # the laser has died
    assert last_reason(monitor) == "stale_scan"
    assert reached(5.0) == 0.4
    assert reached(5.0, None, seconds=0.26) == 0.4
    assert reached(5.0, None, seconds=0.06) == 0.0  # whoever commands has died
    assert last_reason(monitor) == "stale_command"


def test_a_monitor_that_gets_no_scan_says_what_may_be_done(
    run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    run_node(SafetyMonitor, namespace="r1")
    clock.advance(safety_monitor.PATIENCE - 0.1)
    assert "still no laser scan" not in caplog.text
    clock.advance(0.2)
    assert "still no laser scan on r1/scan" in caplog.text


def test_a_base_without_a_laser_drives_and_obeys_the_emergency_stop(run_node: RunNode, clock: Clock) -> None:
    monitor = run_node(SafetyMonitor, namespace="r1", laser=False)

    def reached() -> float:
        monitor.send("cmd_vel_raw", Twist(Vector3(x=0.4)))
        clock.advance(0.1)
        return speed(monitor.published("cmd_vel")[-1])

    assert reached() == 0.4
    monitor.call("emergency_stop", Trigger.Request())
    assert reached() == 0.0
    monitor.call("reset_emergency_stop", Trigger.Request())
    assert reached() == 0.4


def test_a_laser_that_is_not_waited_for_counts_once_it_was_heard(
    run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    monitor = run_node(SafetyMonitor, namespace="r1", wait_for_laser=False)

    def reached() -> tuple[float, str]:
        monitor.send("cmd_vel_raw", Twist(Vector3(x=0.4)))
        clock.advance(0.1)
        return speed(monitor.published("cmd_vel")[-1]), last_reason(monitor)

    assert reached() == (0.4, "no_laser")
    assert "no laser: nobody looks for obstacles" in caplog.text
    monitor.send("scan", scan(ahead=9.0))
    assert reached() == (0.4, "clear")
    clock.advance(1.0)
    assert reached() == (0.0, "stale_scan"), "from now on a laser that falls silent stops it"
    kept = monitor.node.memory
    assert kept.recall("laser_heard") is True, "and a new monitor knows"
    monitor.call("emergency_stop", Trigger.Request())
    assert kept.recall("laser_heard") is True


def test_an_emergency_stop_waits_for_no_decision_and_none_from_before_moves_the_robot(
    run_node: RunNode, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monitor = run_node(SafetyMonitor, namespace="r1", laser=False)
    monitor.send("cmd_vel_raw", Twist(Vector3(x=0.4)))
    clock.advance(0.02)
    assert speed(monitor.published("cmd_vel")[-1]) == 0.4

    def ponder(situation: Situation, limits: Limits) -> Decision:
        decision = decide(situation, limits)
        monitor.node.sleep(0.1)
        return decision

    monkeypatch.setattr("robo_services.safety_monitor.decide", ponder)
    clock.advance(0.05)
    monitor.clear()
    assert "stopped" in monitor.call("emergency_stop", Trigger.Request()).message
    assert [speed(twist) for twist in monitor.published("cmd_vel")] == [0.0]
    monkeypatch.undo()
    for _ in range(20):
        monitor.send("cmd_vel_raw", Twist(Vector3(x=0.4)))
        clock.advance(0.02)
    assert not any(speed(twist) for twist in monitor.published("cmd_vel")), "not even what was decided before"
    assert last_reason(monitor) == "emergency_stop"
    monitor.call("reset_emergency_stop", Trigger.Request())
    clock.advance(0.02)
    assert speed(monitor.published("cmd_vel")[-1]) == 0.4


def test_the_simulated_robot_stops_before_a_wall(run_node: RunNode, clock: Clock, tmp_path: Path) -> None:
    wall = tmp_path / "wall.yaml"
    wall.write_text("walls: [[1.2, -2, 1.2, 2]]\n")
    base = run_node(DiffDriveSim, namespace="r1", world=str(wall), x=0.4)
    monitor = run_node(SafetyMonitor, namespace="r1")
    run_node(
        VelocityController, namespace="r1", remap={"cmd_vel": "cmd_vel_raw"}, linear_velocity=0.2, angular_velocity=0.0
    )
    clock.advance(1.5)
    assert speed(base.published("odom")[-1].twist.twist) > 0.19
    until(clock, lambda: speed(base.published("odom")[-1].twist.twist) == 0.0, "it has stopped")
    assert last_reason(monitor) == "obstacle"
    # The laser is 0.3 m or more away from the wall, and so the base of radius 0.2 m does not touch it.
    assert 0.7 < base.published("odom")[-1].pose.pose.position.x <= 1.2 - 0.29


def test_the_robot_stops_when_its_laser_dies(run_node: RunNode, clock: Clock) -> None:
    laser = run_node(DiffDriveSim, namespace="r1", name="laser", remap={"odom": "~/odom"})
    base = run_node(DiffDriveSim, namespace="r1", name="base", laser=False)
    run_node(SafetyMonitor, namespace="r1")
    run_node(VelocityController, namespace="r1", remap={"cmd_vel": "cmd_vel_raw"})
    clock.advance(3.0)
    assert speed(base.published("odom")[-1].twist.twist) > 0.4
    laser.close()
    clock.advance(1.0)
    assert speed(base.published("odom")[-1].twist.twist) == 0.0


def test_a_json_twist_from_a_plain_client_moves_the_robot(
    run_node: RunNode, clock: Clock, robo_session: zenoh.Session
) -> None:
    base = run_node(DiffDriveSim, namespace="r1")
    monitor = run_node(SafetyMonitor, namespace="r1")
    until(clock, lambda: bool(monitor.published("safety_state")) and last_reason(monitor) == "no_command", "it sees")
    robo_session.put("r1/cmd_vel_raw", '{"linear": {"x": 0.3}}', encoding="application/json")
    clock.advance(2.0)
    odometry = base.published("odom")
    assert odometry[-1].pose.pose.position.x > 0.05
    assert max(speed(one.twist.twist) for one in odometry) > 0.1
    assert speed(odometry[-1].twist.twist) == 0.0
