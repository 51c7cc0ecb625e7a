"""real_robot.yaml with board and lidar played in one world, and what the supervisor makes of drivers that wait."""

import math
from pathlib import Path

import pytest

from robo.testing import Launch, Robot
from robo_messages import DiagnosticStatus, Odometry, Trigger

MANIFEST = """\
include:
  file: real_robot.yaml
  args: {{emulate: true, demo: arc, speed: 0.3, world: ./corridor.yaml, port: {folder}/b, lidar_port: {folder}/l}}
  override:
    velocity_controller: {{params: {{angular_velocity: 0.0}}}}
    serial_base: {{watchdog: 5.0}}
    laser_frame: {{watchdog: 5.0}}
    ld_lidar: {{watchdog: 5.0}}
"""
WALL = 2.0
"""Where the corridor ends, ahead of the robot, m."""
CORRIDOR = f"walls: [[-2, -2, {WALL}, -2], [{WALL}, -2, {WALL}, 2], [{WALL}, 2, -2, 2], [-2, 2, -2, -2]]\n"


def stops_at_the_wall(robot: Robot) -> Odometry:
    """It stands for what is in the way: on a busy machine it may stand before because scans are late."""
    robot.wait_for("safety_state", lambda state: reason_of(state) == "obstacle")
    stood: Odometry = robot.wait_for("ground_truth", lambda truth: truth.twist.twist.linear.x == 0.0, new=True)
    return stood


def reason_of(state: DiagnosticStatus) -> str:
    return {value.key: value.value for value in state.values}["reason"]


def let_time_pass(robot: Robot) -> None:
    """More than twice the time after which a silent topic would be a hang; a busy machine holds a driver up for 2 s."""
    robot.clear()
    robot.wait_for_count("ground_truth", round(30 * 11.0))


@pytest.mark.timeout(120)
def test_board_and_lidar_stand_in_one_world_and_are_waited_for(launch: Launch, tmp_path: Path) -> None:
    pytest.importorskip("serial", reason="the extra serial is not installed")
    (tmp_path / "corridor.yaml").write_text(CORRIDOR)
    (tmp_path / "robot.yaml").write_text(MANIFEST.format(folder=tmp_path))
    robot = launch("robot.yaml", folder=tmp_path)
    x = stops_at_the_wall(robot).pose.pose.position.x
    assert WALL - 0.8 < x < WALL - 0.25, "before the wall that the lidar sees and the board does not know"
    odometry = robot.wait_for("odom", lambda said: math.isclose(said.pose.pose.position.x, x, abs_tol=0.02))
    assert odometry.header.frame_id == "odom"
    for device, driver, topic in (("emulated_lidar/", "ld_lidar", "scan"), ("", "serial_base", "odom")):
        robot.call(f"{device}unplug", Trigger.Request())
        robot.wait_until(driver, lambda process: process.health == "error")
        if driver == "ld_lidar":
            robot.wait_for("safety_state", lambda state: reason_of(state) == "stale_scan")
        let_time_pass(robot)
        robot.call(f"{device}replug", Trigger.Request())
        robot.wait_for(topic, lambda _: True, new=True)
        robot.wait_until(driver, lambda process: process.health == "ok")
        assert [one.restarts for one in robot.processes()] == [0] * len(robot.processes()), driver
