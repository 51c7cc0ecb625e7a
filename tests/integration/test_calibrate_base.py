"""A base whose wheels are not as they are said to be is calibrated: by a simulator's truth, and by a ruler."""

import math
from typing import Any

import msgspec
import pytest
import yaml

from robo.testing import Clock, NodeUnderTest, RunNode
from robo_messages import Odometry, Point, Trigger, Twist
from robo_services.calibrate_base import CalibrateBase
from robo_services.calibration import seen_from
from robo_services.diff_drive_sim import DiffDriveSim
from robo_services.kinematics import Pose2
from robo_services.planar import yaw_from_quaternion

ERRORS = {"left_wheel_radius": 0.02, "right_wheel_radius": -0.01, "wheel_separation": 0.04}
QUICK: dict[str, Any] = {"length": 2.0, "side": 1.0, "speed": 0.5, "turning_speed": 1.5, "acceleration": 0.5}

Base = NodeUnderTest[DiffDriveSim]
Tool = NodeUnderTest[CalibrateBase]


def base_of(run_node: RunNode, **errors: float) -> Base:
    return run_node(DiffDriveSim, ground_truth=True, laser=False, errors=errors, x=-1.0, y=-0.5)


def until(tool: Tool, clock: Clock, what: str) -> None:
    for _ in range(240):
        if tool.has_ended() or tool.node.run().message == what:
            return
        clock.advance(0.5)
    raise AssertionError(f"not within two minutes: {what}")


def found(tool: Tool) -> dict[str, float]:
    (said,) = tool.published(CalibrateBase.calibration)
    return msgspec.convert(yaml.safe_load(said.data), dict[str, dict[str, float]])["diff_drive_controller"]


def truth_of(base: Base) -> Pose2:
    said: Odometry = base.published("ground_truth")[-1]
    pose = said.pose.pose
    return Pose2(pose.position.x, pose.position.y, yaw_from_quaternion(pose.orientation))


def test_by_the_truth_of_a_simulator_it_finds_the_wheels(
    run_node: RunNode, clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    base_of(run_node, **ERRORS, slip=0.0003)
    tool = run_node(CalibrateBase, ground_truth="ground_truth", **QUICK)
    until(tool, clock, "")
    assert tool.exit_code == 0
    assert found(tool) == pytest.approx(
        {
            "left_wheel_radius_multiplier": 1.02,
            "right_wheel_radius_multiplier": 0.99,
            "wheel_separation_multiplier": 1.04,
        },
        rel=0.005,
    )
    assert "diff_drive_controller:\n  left_wheel_radius_multiplier: 1.0" in capsys.readouterr().out


def test_by_a_ruler_each_run_waits_to_be_begun_and_measured(
    run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    base = base_of(run_node, **ERRORS)
    tool = run_node(CalibrateBase, right_wheel_radius_multiplier=1.1, wheel_separation=0.3, **QUICK)
    clock.advance(1.0)
    assert "straight: robo service call calibrate_base/go begins it" in caplog.text
    for kind in ("straight", "left", "right"):
        begun = truth_of(base)
        assert tool.call("~/go", Trigger.Request()).message == f"drives: {kind}"
        assert tool.call("~/go", Trigger.Request()).message == f"it drives already: {kind}"
        until(tool, clock, "waits to be told where the base is")
        assert not tool.call("~/go", Trigger.Request()).success
        x, y, _ = seen_from(begun, truth_of(base))
        for wrong in (math.nan, 5.0):
            tool.send("~/measured", Point(x + wrong, y))
        assert "left out" in caplog.text
        tool.send("~/measured", Point(round(x, 3), round(y, 3)))
        clock.advance(1.0)
    assert tool.exit_code == 0
    assert found(tool) == pytest.approx(
        {
            "left_wheel_radius_multiplier": 1.02,
            "right_wheel_radius_multiplier": 0.99 * 1.1,
            "wheel_separation_multiplier": 1.04,
        },
        rel=0.005,
    )


def test_a_base_that_does_not_move_is_given_up(
    run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    run_node(DiffDriveSim, ground_truth=True, laser=False, command_source="nobody")
    tool = run_node(CalibrateBase, ground_truth="ground_truth", **QUICK)
    clock.advance(8.0)
    assert tool.has_ended()
    assert tool.exit_code == 1
    assert "it comes no further: does the base follow cmd_vel" in caplog.text
    assert tool.published(CalibrateBase.command)[-1] == Twist()


def test_without_odometry_it_stops(run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture) -> None:
    base = base_of(run_node)
    tool = run_node(CalibrateBase, **QUICK)
    assert tool.call("~/go", Trigger.Request()).message == "nothing new on odom"
    clock.advance(0.5)
    assert tool.call("~/go", Trigger.Request()).success
    clock.advance(1.0)
    assert tool.published(CalibrateBase.command)[-1].linear.x > 0.1
    base.close()
    clock.advance(1.0)
    assert tool.exit_code == 1
    assert tool.published(CalibrateBase.command)[-1] == Twist()
    assert "nothing new on odom" in caplog.text


def test_without_the_truth_it_waits_and_says_so(run_node: RunNode, clock: Clock) -> None:
    run_node(DiffDriveSim, laser=False)
    tool = run_node(CalibrateBase, ground_truth="ground_truth", **QUICK)
    clock.advance(2.0)
    assert tool.node.run().message == "nothing new on ground_truth"
    assert tool.published(CalibrateBase.command) == []
    tool.send("~/measured", Point())
