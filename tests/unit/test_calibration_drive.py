"""A base is driven along a course by what its encoders say, coarse ones included."""

import itertools
import math

import pytest

from robo_services.arduino_base import ArduinoBase, Settings
from robo_services.board import BoardSpec
from robo_services.calibration import Track
from robo_services.calibration_drive import STUCK, Drive, Leg, Speeds, legs_of
from robo_services.kinematics import Pose2, Twist2
from robo_services.tick_odometry import TickOdometry
from tests.unit.test_arduino_base import DRIVE, Played

DT = 0.05
SPEEDS = Speeds(linear=0.2, angular=0.5, linear_acceleration=0.2, angular_acceleration=0.5)
FAST = Speeds(linear=0.5, angular=2.0, linear_acceleration=0.5, angular_acceleration=2.0)


def played(per_revolution: float) -> Played:
    """A base with motors that stick, and with so many ticks in a revolution of its wheels."""
    one = Played(BoardSpec(drive=DRIVE, per_revolution=per_revolution, friction=12.0, noise=0.02))
    one.odometry = TickOdometry(DRIVE, per_revolution, bits=one.board.spec.bits)
    one.base = ArduinoBase(Settings(), one.odometry)
    one.base.begin(one.now)
    one.run(1.0)
    return one


@pytest.mark.parametrize(
    ("per_revolution", "speeds"), [(40.0, FAST), (200.0, SPEEDS), (360.0, SPEEDS), (1440.0, SPEEDS)]
)
@pytest.mark.parametrize("turn", [math.pi / 2, -math.pi / 2])
def test_it_arrives_whatever_encoders_count(per_revolution: float, speeds: Speeds, turn: float) -> None:
    base, track = played(per_revolution), Track()
    drive = Drive([Leg(way=0.5), Leg(turn=turn)], speeds)
    end = base.now + 120.0
    while not drive.is_over():
        track.add(base.odometry.track.pose)
        base.run(DT, drive.command(track, DT))
        assert not drive.is_stuck()
        assert base.now < end
    assert track.way == pytest.approx(0.5, abs=0.05)
    assert track.turned == pytest.approx(turn, abs=0.15)


def test_odometry_that_trembles_stands_all_the_same() -> None:
    track, drive = Track(), Drive(legs_of("straight", 0.5, 0.0), SPEEDS)
    track.add(Pose2())
    for tremble in itertools.islice(itertools.cycle([0.0, 0.002]), 40):
        track.add(Pose2(0.5 + tremble, 0.0, 2 * tremble))
        drive.command(track, DT)
        assert not drive.is_stuck()
    assert drive.is_over()


def test_a_base_that_does_not_come_to_rest_is_no_base_that_does_not_move() -> None:
    track, drive = Track(), Drive(legs_of("straight", 4.0, 0.0), SPEEDS)
    x, spent = 0.0, 0.0
    track.add(Pose2())
    while not drive.is_stuck():
        x, spent = x + 0.02, spent + DT
        track.add(Pose2(x))
        wanted = drive.command(track, DT)
        assert spent < 30.0
    assert drive.is_settling()
    assert wanted == Twist2()
    assert x > 4.0
    assert spent == pytest.approx(200 * DT + STUCK, abs=3 * DT), "which counts from the arrival"


def test_a_base_that_is_held_is_told_to_go_faster_and_never_faster_than_said() -> None:
    track, drive = Track(), Drive([Leg(turn=math.pi / 2)], SPEEDS)
    track.add(Pose2())
    track.add(Pose2(0.0, 0.0, math.pi / 2 - 0.1))
    told = []
    while not drive.is_stuck():
        told.append(drive.command(track, DT).angular)
    assert told[3] < 0.3
    assert told[-1] == SPEEDS.angular == max(told)
