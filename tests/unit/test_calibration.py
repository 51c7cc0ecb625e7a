"""Wheels that are not as they are said to be, found by where a base ended."""

import math
import random

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from robo_messages import Header
from robo_services.calibration import (
    CalibrationError,
    Corrections,
    Measured,
    Run,
    Track,
    arc,
    calibrate,
    driven,
    seen_from,
)
from robo_services.drives import DiffDrive
from robo_services.kinematics import ORIGIN, Pose2, Twist2, advance
from robo_services.planar import yaw_from_quaternion
from robo_services.simulated_errors import ErringWheels, WheelErrors

DRIVE = DiffDrive(wheel_separation=0.3, wheel_radius=0.05)
DT = 0.02


def square(side: float, left: bool) -> list[Twist2]:
    """By odometry: sides at 0.5 m/s, corners on the spot."""
    way = round(side / 0.5 / DT)
    corner = 50
    turn = math.pi / 2 / corner * (1 if left else -1)
    return 4 * [*(way * [Twist2(side / way)]), *(corner * [Twist2(0.0, turn)])]


def straight(length: float) -> list[Twist2]:
    return 400 * [Twist2(length / 400)]


def run_of(steps: list[Twist2], errors: WheelErrors, seed: int = 0, *, yaw: bool = False) -> Run:
    """What becomes of a base that drives what its wheels take for these steps; measured to 2 mm by hand."""
    real = errors.real(DRIVE)
    rng = random.Random(seed)
    pose, track, told = ORIGIN, Track(), ORIGIN
    track.add(told)
    for step in steps:
        told = advance(told, step.linear, step.angular, 1.0)
        track.add(told)
        left, right, _ = DRIVE.wheels(step)
        if errors.slip:
            left += rng.gauss(0.0, errors.slip * math.sqrt(abs(left) * 0.05)) / 0.05
            right += rng.gauss(0.0, errors.slip * math.sqrt(abs(right) * 0.05)) / 0.05
        way, turn = real.twist(DRIVE.wheels(step)._replace(left=left, right=right))
        pose = advance(pose, way, turn, 1.0)
    hand = 0.002 if errors.slip else 0.0
    return Run(
        track.steps,
        Measured(pose.x + rng.gauss(0.0, hand), pose.y + rng.gauss(0.0, hand), pose.yaw if yaw else None),
    )


def course(errors: WheelErrors, seed: int = 0, *, yaw: bool = False) -> list[Run]:
    ways = straight(4.0), square(2.0, True), square(2.0, False)
    return [run_of(way, errors, seed + k, yaw=yaw) for k, way in enumerate(ways)]


@settings(max_examples=10)
@example(0.09375, -0.0625, 0.0, False)
@example(-0.1, 0.1, 0.15, False)
@example(0.1, -0.1, -0.15, True)
@given(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(-0.15, 0.15), st.booleans())
def test_wheels_that_roll_are_found_exactly(left: float, right: float, separation: float, yaw: bool) -> None:
    errors = WheelErrors(left_wheel_radius=left, right_wheel_radius=right, wheel_separation=separation)
    found = calibrate(course(errors, yaw=yaw), 0.3)
    assert found.corrections == pytest.approx((1 + left, 1 + right, 1 + separation), rel=1e-6)
    assert found.left_over < 1e-6


@pytest.mark.parametrize("seed", range(5))
def test_with_slip_and_a_ruler_they_are_found_to_half_a_percent(seed: int) -> None:
    errors = WheelErrors(left_wheel_radius=0.02, right_wheel_radius=-0.015, wheel_separation=0.04, slip=0.001)
    found = calibrate(course(errors, 10 * seed), 0.3)
    assert found.corrections == pytest.approx((1.02, 0.985, 1.04), rel=0.005)
    assert found.before > 0.3
    assert found.left_over < 0.02


def test_one_square_and_a_straight_line_say_as_much_without_slip() -> None:
    errors = WheelErrors(left_wheel_radius=0.02, right_wheel_radius=0.01, wheel_separation=0.03)
    runs = course(errors)[:2]
    assert calibrate(runs, 0.3).corrections == pytest.approx((1.02, 1.01, 1.03), rel=1e-6)


def test_a_straight_line_alone_does_not_say_how_far_wheels_are_apart() -> None:
    with pytest.raises(CalibrationError, match=r"do not tell .* apart: drive a straight line, and a square"):
        calibrate([run_of(straight(4.0), WheelErrors())], 0.3)


@pytest.mark.parametrize(
    ("runs", "separation", "says"),
    [
        ([Run(straight(4.0), Measured(math.nan, 0.0))], 0.3, "run 1 holds what is not finite"),
        ([Run([], Measured(0.0, 0.0))], 0.3, "in run 1 the base has hardly moved"),
        ([], 0.0, "wheel_separation = 0 m"),
        ([*course(WheelErrors())[1:], Run(straight(4.0), Measured(0.4, 0.0))], 0.3, "no wheels lead from"),
    ],
)
def test_figures_that_cannot_be_are_refused(runs: list[Run], separation: float, says: str) -> None:
    with pytest.raises(CalibrationError, match=says):
        calibrate(runs, separation)


def test_wheels_that_are_right_stay_as_they_are() -> None:
    found = calibrate(course(WheelErrors()), 0.3)
    assert found.corrections == pytest.approx(Corrections())
    assert found.before < 1e-9


@given(st.floats(-2, 2), st.floats(-2, 2), st.floats(-3.1, 3.1), st.floats(-1, 1), st.floats(-3, 3))
def test_an_arc_is_found_again(x: float, y: float, yaw: float, way: float, turn: float) -> None:
    begin = Pose2(x, y, yaw)
    assert arc(begin, advance(begin, way, turn, 1.0)) == pytest.approx((way, turn), abs=1e-9)


def test_a_track_leads_where_its_poses_do() -> None:
    track, pose = Track(), Pose2(3.0, 1.0, 2.0)
    for step in [*square(1.0, True), Twist2(-0.2, 0.1)]:
        track.add(pose)
        pose = advance(pose, *step, 1.0)
    track.add(pose)
    assert driven(track.steps, 0.3) == pytest.approx(seen_from(Pose2(3.0, 1.0, 2.0), pose))
    assert track.way == pytest.approx(3.8)
    assert track.turned == pytest.approx(math.tau + 0.1)


def test_it_agrees_with_what_the_simulator_does() -> None:
    """The other way round: the base drives exactly, and its odometry errs."""
    errors = WheelErrors(left_wheel_radius=0.02, right_wheel_radius=-0.01, wheel_separation=0.05)
    runs = []
    for way in (straight(4.0), square(2.0, True), square(2.0, False)):
        wheels, track, truth = ErringWheels(DRIVE, errors, ORIGIN, 0), Track(), ORIGIN
        for step in way:
            pose = wheels.message(Header(), "base_link").pose.pose
            track.add(Pose2(pose.position.x, pose.position.y, yaw_from_quaternion(pose.orientation)))
            wheels.step(*step, DT)
            truth = advance(truth, *step, 1.0)
        pose = wheels.message(Header(), "base_link").pose.pose
        track.add(Pose2(pose.position.x, pose.position.y, yaw_from_quaternion(pose.orientation)))
        runs.append(Run(track.steps, Measured(truth.x, truth.y)))
    assert calibrate(runs, 0.3).corrections == pytest.approx((1.02, 0.99, 1.05), rel=1e-6)
