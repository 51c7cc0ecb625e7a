"""The wheels that a base truly has, found by drives whose ends were measured."""

import math
import random

import pytest

from robo_services.board import BoardSpec
from robo_services.calibration import Correction, Drive, Step, calibrate, end_of, step_between
from robo_services.drives import DiffDrive
from robo_services.kinematics import ORIGIN, Twist2, advance
from tests.unit.test_arduino_base import DRIVE, Played


def square(side: float, turn: float) -> list[Step]:
    return 4 * [*(10 * [Step(side / 10, 0.0)]), *(10 * [Step(0.0, turn / 10)])]


DRIVES = [[Step(4.0, 0.0)], square(2.0, math.pi / 2), square(2.0, -math.pi / 2)]


def measured(truth: Correction, drives: list[list[Step]], spread: float = 0.0) -> list[Drive]:
    """What a tape measure says of them."""
    dice = random.Random(7)
    ends = [end_of(steps, 0.3, truth) for steps in drives]
    return [
        Drive(steps, end.x + dice.gauss(0, spread), end.y + dice.gauss(0, spread))
        for steps, end in zip(drives, ends, strict=True)
    ]


@pytest.mark.parametrize("left", [0.97, 1.0, 1.02])
@pytest.mark.parametrize("right", [0.98, 1.01])
@pytest.mark.parametrize("separation", [0.93, 1.0, 1.08])
def test_a_line_and_two_squares_tell_all_three(left: float, right: float, separation: float) -> None:
    truth = Correction(left, right, separation)
    found = calibrate(measured(truth, DRIVES), 0.3)
    assert found.correction == pytest.approx(truth, abs=2e-3)
    assert found.after < 0.005
    roughly = calibrate(measured(truth, DRIVES, spread=0.01), 0.3)
    assert roughly.correction == pytest.approx(truth, abs=1e-2), "a tape measure is good to a centimetre"


def test_what_no_drive_tells_stays_as_it_was() -> None:
    line = calibrate(measured(Correction(1.02, 1.02, 1.1), DRIVES[:1]), 0.3).correction
    assert line.left_radius == pytest.approx(1.02, abs=2e-3)
    assert line.separation == pytest.approx(1.0, abs=1e-3)
    squares = calibrate(measured(Correction(1.0, 1.0, 1.05), DRIVES[1:]), 0.3).correction
    assert squares.separation / squares.left_radius == pytest.approx(1.05, abs=5e-3)


def test_nonsense_is_held_within_reason() -> None:
    found = calibrate([Drive([Step(1.0, 0.0)], 900.0, -900.0), Drive([Step(0.0, 1.0)], 5.0, 5.0)], 0.3)
    assert all(0.5 <= value <= 1.5 for value in found.correction)


def test_steps_are_the_arcs_between_poses() -> None:
    pose, steps = ORIGIN, [Step(0.3, 0.5), Step(-0.2, 0.1), Step(0.0, -3.0), Step(0.1, 0.0)]
    for step in steps:
        after = advance(pose, step.distance, step.turn, 1.0)
        assert step_between(pose, after) == pytest.approx(step)
        pose = after


def test_a_board_whose_wheels_are_others_is_found_out() -> None:
    truth = DiffDrive(
        wheel_separation=0.318,
        wheel_radius=0.05,
        left_wheel_radius_multiplier=1.01,
        right_wheel_radius_multiplier=0.985,
        max_wheel_velocity=20.0,
    )
    drives = []
    for turn in (0.0, 0.5, -0.5):
        played = Played(BoardSpec(drive=truth, noise=0.02))
        played.run(0.5)
        steps, pose = [], played.odometry.track.pose
        for leg in range(4 if turn else 1):
            for twist, seconds in ((Twist2(0.4), 5.0), (Twist2(0.0, turn), math.pi if leg < 3 else 0.0)):
                for _ in range(round(seconds / 0.1)):
                    played.run(0.1, twist)
                    steps.append(step_between(pose, played.odometry.track.pose))
                    pose = played.odometry.track.pose
                played.run(0.3)
                steps.append(step_between(pose, played.odometry.track.pose))
                pose = played.odometry.track.pose
        drives.append(Drive(steps, played.board.pose.x, played.board.pose.y))
    found = calibrate(drives, DRIVE.separation)
    assert found.before > 0.1
    assert found.after < 0.02
    assert found.correction == pytest.approx((1.01, 0.985, 0.318 / 0.3), abs=4e-3)
