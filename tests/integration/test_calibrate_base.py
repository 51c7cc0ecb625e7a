"""A base whose wheels are not as they are said to be is calibrated: by a simulator's truth, and by a ruler."""

import math
import re
from typing import Any

import msgspec
import pytest
import yaml
import zenoh

from robo.testing import Clock, NodeUnderTest, RunNode
from robo_messages import Odometry, Point, Pose, PoseWithCovariance, Trigger, Twist, Vector3
from robo_services.base_wheels import Wheels, ask_wheels
from robo_services.calibrate_base import KINDS, CalibrateBase
from robo_services.calibration import Corrections, Measured, seen_from
from robo_services.diff_drive_controller import DiffDriveController
from robo_services.diff_drive_sim import DiffDriveSim
from robo_services.kinematics import Pose2
from robo_services.planar import yaw_from_quaternion

ERRORS = {"left_wheel_radius": 0.02, "right_wheel_radius": -0.01, "wheel_separation": 0.04}
QUICK: dict[str, Any] = {"length": 2.0, "side": 1.0, "speed": 0.5, "turning_speed": 1.5, "acceleration": 0.5}

Base = NodeUnderTest[DiffDriveSim]
Tool = NodeUnderTest[CalibrateBase]

WAITS = "waits to be told where the base is"


class CorrectedSim(DiffDriveSim):
    """Says that a wheel is corrected already."""

    class Parameters(DiffDriveSim.Parameters):
        """As of a driver that takes multipliers."""

        right_wheel_radius_multiplier: float = 1.1


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
    (multipliers,) = msgspec.convert(yaml.safe_load(said.data), dict[str, dict[str, float]]).values()
    return multipliers


def truth_of(base: NodeUnderTest[Any]) -> Pose2:
    said: Odometry = base.published("ground_truth")[-1]
    pose = said.pose.pose
    return Pose2(pose.position.x, pose.position.y, yaw_from_quaternion(pose.orientation))


def measure(tool: Tool, base: Base, clock: Clock, begun: Pose2) -> Measured:
    """Begin a run and wait for its end. Returns where the base is then, from where it began."""
    assert tool.call("~/go", Trigger.Request()).success
    until(tool, clock, WAITS)
    return seen_from(begun, truth_of(base))


def say(tool: Tool, clock: Clock, measured: Measured) -> None:
    tool.send("~/measured", Point(round(measured.x, 3), round(measured.y, 3)))
    clock.advance(1.0)


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
    printed = capsys.readouterr().out
    assert re.search(r"^diff_drive_sim:\n  left_wheel_radius_multiplier: 1\.0\d{3}  # ± 0\.00\d\d\n", printed, re.M)


def test_by_a_ruler_each_run_waits_to_be_begun_and_measured(
    run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    base = run_node(CorrectedSim, ground_truth=True, laser=False, errors=ERRORS, x=-1.0, y=-0.5)
    tool = run_node(CalibrateBase, **QUICK)
    clock.advance(1.0)
    assert "straight: robo service call calibrate_base/go begins it" in caplog.text
    for kind in ("straight", "left", "right"):
        begun = truth_of(base)
        assert tool.call("~/go", Trigger.Request()).message == f"drives: {kind}"
        assert tool.call("~/go", Trigger.Request()).message == f"it drives already: {kind}"
        until(tool, clock, WAITS)
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
    assert tool.published(CalibrateBase.command)[-1] == Twist()
    assert "nothing new on odom; this run is given up" in caplog.text
    assert not tool.has_ended()


def test_without_the_truth_it_waits_and_says_so(run_node: RunNode, clock: Clock) -> None:
    run_node(DiffDriveSim, laser=False)
    tool = run_node(CalibrateBase, ground_truth="ground_truth", **QUICK)
    clock.advance(2.0)
    assert tool.node.run().message == "nothing new on ground_truth"
    assert tool.published(CalibrateBase.command) == []
    tool.send("~/measured", Point())


def test_a_base_that_is_moved_on_its_wheels_before_it_is_measured_does_no_harm(run_node: RunNode, clock: Clock) -> None:
    base = base_of(run_node, **ERRORS)
    tool = run_node(CalibrateBase, **QUICK)
    clock.advance(1.0)
    for kind in KINDS:
        begun = truth_of(base)
        measured = measure(tool, base, clock, begun)
        if kind == "straight":
            for _ in range(10):
                base.send("cmd_vel", Twist(Vector3(-0.5)))
                clock.advance(0.1)
            clock.advance(1.0)
            assert measured.x - truth_of(base).x + begun.x > 0.3, "it has moved"
            measured = seen_from(begun, truth_of(base))
        say(tool, clock, measured)
    assert tool.exit_code == 0
    assert list(found(tool).values()) == pytest.approx([1.02, 0.99, 1.04], rel=0.01)


def test_a_base_that_was_carried_before_it_is_measured_is_found_out(
    run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    base = base_of(run_node, **ERRORS)
    tool = run_node(CalibrateBase, **QUICK)
    clock.advance(1.0)
    for kind in KINDS:
        measured = measure(tool, base, clock, truth_of(base))
        say(tool, clock, measured._replace(x=measured.x - 0.3 * (kind == "left")))
    assert tool.exit_code == 1
    assert tool.published(CalibrateBase.calibration) == []
    assert re.search(r"± \d+% only: .* has the base slipped or been moved", caplog.text)
    assert re.search(r"run 2, left: x = .* m by its wheels, x = .* m as measured", caplog.text)


def test_a_run_that_is_given_up_is_begun_again_and_the_others_are_kept(
    run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    base = base_of(run_node, **ERRORS)
    tool = run_node(CalibrateBase, **QUICK)
    clock.advance(1.0)
    for kind in KINDS:
        if kind == "right":
            assert tool.call("~/go", Trigger.Request()).success
            clock.advance(2.0)
            base.close()  # as good as a cable that falls out
            clock.advance(1.0)
            assert "right: robo service call calibrate_base/go begins it again" in caplog.text
            assert tool.call("~/go", Trigger.Request()).message == "nothing new on odom"
            base = base_of(run_node, **ERRORS)
            clock.advance(2.0)
        say(tool, clock, measure(tool, base, clock, truth_of(base)))
    assert tool.exit_code == 0
    assert list(found(tool).values()) == pytest.approx([1.02, 0.99, 1.04], rel=0.005)


def test_after_three_runs_in_a_row_that_were_given_up_it_ends(run_node: RunNode, clock: Clock) -> None:
    run_node(DiffDriveSim, laser=False, command_source="nobody")
    tool = run_node(CalibrateBase, **QUICK)
    clock.advance(1.0)
    for _ in range(2):
        assert tool.call("~/go", Trigger.Request()).success
        clock.advance(6.0)
        assert not tool.has_ended()
        assert tool.node.run().message == "waits to begin"
    assert tool.call("~/go", Trigger.Request()).success
    clock.advance(6.0)
    assert tool.exit_code == 1


def test_a_base_that_is_reset_has_not_driven_there(
    run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    base = base_of(run_node)
    tool = run_node(CalibrateBase, **QUICK)
    clock.advance(1.0)
    assert tool.call("~/go", Trigger.Request()).success
    clock.advance(4.0)
    base.call("reset", Trigger.Request())
    clock.advance(0.5)
    assert "odom has jumped: was the base reset?; this run is given up" in caplog.text
    assert tool.published(CalibrateBase.command)[-1] == Twist()
    assert not tool.has_ended()


def test_wheels_are_as_far_apart_as_the_base_takes_them_to_be(run_node: RunNode, clock: Clock) -> None:
    run_node(DiffDriveSim, ground_truth=True, laser=False, errors=ERRORS, wheel_separation=0.5)
    tool = run_node(CalibrateBase, ground_truth="ground_truth", wheel_separation=0.3, **QUICK)
    until(tool, clock, "")
    assert list(found(tool).values()) == pytest.approx([1.02, 0.99, 1.04], rel=0.002)


def odometry_at(x: float) -> Odometry:
    return Odometry(pose=PoseWithCovariance(pose=Pose(position=Point(x))))


@pytest.mark.parametrize(
    ("source", "controller", "who"),
    [(None, "plain", "a plain Zenoh client"), ("ekf_filter", "", "/ekf_filter")],
)
def test_odometry_of_one_who_tells_no_wheels_wants_them_said(
    run_node: RunNode, source: str | None, controller: str, who: str
) -> None:
    tool = run_node(CalibrateBase, controller=controller, **QUICK)
    tool.send("odom", odometry_at(0.0), source=source)
    said = tool.call("~/go", Trigger.Request())
    assert not said.success
    assert said.message.startswith(f"{who}, who sends odom, does not tell its parameter wheel_separation")


def test_what_is_driven_before_odometry_is_heard_again_counts(
    run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    tool = run_node(CalibrateBase, wheel_separation=0.3, **QUICK)
    tool.send("odom", odometry_at(0.0))
    assert tool.call("~/go", Trigger.Request()).success
    for step in range(1, 18):
        clock.advance(0.1)
        tool.send("odom", odometry_at(min(0.25 * step, 2.0)))
    clock.advance(0.1)
    assert "straight: by its wheels it is at x = 2.000 m" in caplog.text


def test_a_node_tells_which_wheels_it_takes_its_base_to_have(robo_session: zenoh.Session) -> None:
    said = {"wheel_separation": 0.5, "wheel_separation_multiplier": 1.5, "left_wheel_radius_multiplier": 0.9}
    with DiffDriveController(session=robo_session, namespace="r1", parameters=said) as controller:
        wheels = ask_wheels(robo_session, controller.full_name)
    assert wheels == Wheels("diff_drive_controller", 0.75, Corrections(0.9, 1.0, 1.5))
    with CalibrateBase(session=robo_session, parameters={"wheel_separation": 0.0}) as tool:
        assert ask_wheels(robo_session, tool.full_name) is None, "what it says are no wheels"
    assert ask_wheels(robo_session, "/r1/nobody") is None
