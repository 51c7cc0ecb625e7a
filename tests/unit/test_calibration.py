"""Wheels that are not as they are said to be, found by where a base ended."""

import math
import random
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from robo_messages import Header
from robo_services import calibration
from robo_services.base_wheels import Wheels, as_yaml
from robo_services.calibration import (
    ROUNDS,
    Calibration,
    CalibrationError,
    Corrections,
    Measured,
    Run,
    Track,
    arc,
    calibrate,
    doubt,
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


def run_of(steps: list[Twist2], errors: WheelErrors, seed: int = 0, *, yaw: bool = False, hand: float = 0.0) -> Run:
    """What becomes of a base that drives what its wheels take for these steps; measured by hand to so many m."""
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
    return Run(
        track.steps,
        Measured(pose.x + rng.gauss(0.0, hand), pose.y + rng.gauss(0.0, hand), pose.yaw if yaw else None),
    )


def course(errors: WheelErrors, seed: int = 0, *, yaw: bool = False, hand: float = 0.0) -> list[Run]:
    ways = straight(4.0), square(2.0, True), square(2.0, False)
    return [run_of(way, errors, seed + k, yaw=yaw, hand=hand) for k, way in enumerate(ways)]


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
    runs = course(errors, 10 * seed, hand=0.002)
    found = calibrate(runs, 0.3)
    assert found.corrections == pytest.approx((1.02, 0.985, 1.04), rel=0.005)
    assert doubt(found, runs) == ""
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
        ([], 0.3, "there are no runs: drive a straight line"),
        ([*course(WheelErrors())[1:], Run(straight(4.0), Measured(0.4, 0.0))], 0.3, "no wheels lead from"),
        (
            [*course(WheelErrors())[1:], Run(straight(4.0), Measured(4.0, 2.0))],
            0.3,
            r"± \d+% only: .* is a figure wrong",
        ),
    ],
)
def test_figures_that_cannot_be_are_refused(runs: list[Run], separation: float, says: str) -> None:
    with pytest.raises(CalibrationError, match=says):
        calibrate(runs, separation)


@pytest.mark.parametrize("seed", range(5))
def test_two_squares_without_a_line_do_not_say_how_large_wheels_are(seed: int) -> None:
    errors = WheelErrors(left_wheel_radius=0.02, right_wheel_radius=0.01, wheel_separation=0.03, slip=0.001)
    with pytest.raises(CalibrationError, match="do not tell"):
        calibrate(course(errors, 10 * seed, hand=0.002)[1:], 0.3)


def test_it_tells_how_far_off_it_may_be() -> None:
    errors = WheelErrors(left_wheel_radius=0.02, right_wheel_radius=-0.015, wheel_separation=0.04)
    off = []
    for seed in range(12):
        found = calibrate(course(errors, 10 * seed, hand=0.005), 0.3)
        assert max(found.errors) < 0.004
        off += [
            abs(one - true) / error
            for one, true, error in zip(found.corrections, (1.02, 0.985, 1.04), found.errors, strict=True)
        ]
    assert sum(one < 2.0 for one in off) > 0.85 * len(off), "as of a standard deviation"
    assert sum(off) / len(off) > 0.3, "and no larger than it has to be"


def test_it_ends_where_errors_of_measuring_are_all_that_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    counted: list[None] = []

    def counting(*arguments: Any) -> Pose2:
        counted.append(None)
        return driven(*arguments)

    monkeypatch.setattr(calibration, "driven", counting)
    errors = WheelErrors(left_wheel_radius=0.02, right_wheel_radius=-0.01, wheel_separation=0.04, slip=0.002)
    for seed in range(5):
        counted.clear()
        calibrate(course(errors, 10 * seed, hand=0.005), 0.3)
        assert len(counted) < 3 * 2 * ROUNDS


@pytest.mark.parametrize(
    ("before", "left_over", "doubted"),
    [(1.1, 0.06, False), (1.1, 0.2, True), (0.05, 0.03, True), (0.007, 0.006, False)],
)
def test_what_ends_elsewhere_all_the_same_is_doubted(before: float, left_over: float, doubted: bool) -> None:
    runs = course(WheelErrors())
    assert bool(doubt(Calibration(Corrections(), Corrections(), before, left_over), runs)) == doubted


def test_what_was_found_is_printed_with_its_error_on_top_of_what_is_there() -> None:
    wheels = Wheels("serial_base", 0.3, Corrections(1.1, 1.0, 2.0))
    text = as_yaml(wheels, Corrections(1.02, 0.99, 1.04), Corrections(0.001, 0.002, 0.003))
    assert text.splitlines() == [
        "serial_base:",
        "  left_wheel_radius_multiplier: 1.1220  # ± 0.0011",
        "  right_wheel_radius_multiplier: 0.9900  # ± 0.0020",
        "  wheel_separation_multiplier: 2.0800  # ± 0.0060",
    ]


def test_a_track_keeps_no_more_than_it_needs() -> None:
    """As of an odometry that says every 2 ms what encoders count, and of a driver who never drives straight."""
    rng = random.Random(1)
    track, pose = Track(), ORIGIN
    track.add(pose)
    turning = 0.0
    for k in range(50_000):
        turning = 0.9995 * turning + rng.gauss(0.0, 0.02)
        pose = advance(pose, 0.5 if k % 10_000 < 8_000 else 0.0, turning, 0.002)
        track.add(pose)
    there = driven(track.steps, 0.3)
    assert math.hypot(there.x - pose.x, there.y - pose.y) < 2e-3
    assert len(track.steps) < 5_000


def test_a_pose_that_no_base_reaches_at_once_is_a_jump() -> None:
    track = Track()
    assert not track.is_jump(Pose2(100.0)), "it begins there"
    track.add(ORIGIN)
    assert track.is_jump(Pose2(1.0))
    assert track.is_jump(Pose2(0.0, 0.0, 2.0))
    assert not track.is_jump(Pose2(0.3, 0.0, 0.5))


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
    assert driven(track.steps, 0.3) == pytest.approx(seen_from(Pose2(3.0, 1.0, 2.0), pose), abs=1e-3)
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
