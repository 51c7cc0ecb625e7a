"""Every waypoint is reached within tolerance, and no limit is exceeded on the way."""

import math
import random
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import msgspec
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from robo_services import world
from robo_services.courses import Course, CourseError, Waypoint, load
from robo_services.kinematics import Pose2, advance
from robo_services.planar import angle_difference
from robo_services.pursuit import STAND, Follower, Limits, Motion, curvature_to, passes, speed_before
from robo_services.simulated_base import BaseLimits, SimulatedBase

CONFIG = Path(__file__).parents[2] / "config"
LIMITS = Limits(
    max_velocity=0.5, min_velocity=0.05, max_angular_velocity=1.0, max_acceleration=0.5, max_deceleration=0.5,
    max_angular_acceleration=2.0, max_lateral_acceleration=0.5, reaction_time=0.2, lookahead_time=1.2,
    min_lookahead=0.3, max_lookahead=1.0, tolerance=0.25, goal_tolerance=0.1, yaw_tolerance=0.05, turn_angle=0.8,
)  # fmt: skip
BASE = BaseLimits(
    radius=0.2, max_linear_velocity=1.5, max_angular_velocity=3.0, linear_acceleration=2.0, linear_deceleration=5.0,
    angular_acceleration=6.0,
)  # fmt: skip
DT = 0.05
ORIGIN = Pose2()
BRAKING = 0.02
"""How far a base goes on after the end of a course, m: it was at `min_velocity` at most."""

few = settings(max_examples=30, derandomize=True)


class Drive(NamedTuple):
    """What a robot did."""

    poses: list[Pose2]
    motions: list[Motion]
    follower: Follower

    def misses(self) -> list[float]:
        """How far it passed each waypoint, m."""
        return [min(math.hypot(p.x - w.x, p.y - w.y) for p in self.poses) for w in self.follower.course.waypoints]


def drive(
    course: Course, limits: Limits = LIMITS, begin: Pose2 = ORIGIN, delay: int = 0, seconds: float = 1500.0
) -> Drive:
    """A base that does at once, or `delay` steps later, what it is told."""
    follower, pose = Follower(course), begin
    poses, motions = [pose], [STAND] * (delay + 1)
    while not follower.finished and len(poses) * DT < seconds:
        motions.append(follower.step(pose, motions[-1 - delay].linear, limits, DT))
        pose = advance(pose, *motions[-1 - delay], DT)
        poses.append(pose)
    return Drive(poses, motions[delay:], follower)


def course(*points: tuple[float, ...], laps: int = 1) -> Course:
    return Course(tuple(Waypoint(*point) for point in points), "", laps)


places = st.floats(-3, 3) | st.sampled_from([0.0, 1.0, 1.0 + 1e-9, -2.0])
"""Some again and again: waypoints coincide, stand in a line, and the way turns back."""
tolerances = st.sampled_from([0.05, 0.1, 0.25, 0.5])
waypoints = st.builds(
    Waypoint, places, places,
    st.none() | st.none() | st.floats(-4, 4), st.none() | st.sampled_from([0.2, 2.0]), st.none() | tolerances,
)  # fmt: skip
limits_of_all_kinds = st.builds(
    lambda **changes: msgspec.structs.replace(LIMITS, **changes),
    max_velocity=st.sampled_from([0.2, 0.5, 1.0, 1.5]), max_angular_velocity=st.sampled_from([0.4, 1.0, 2.0]),
    max_deceleration=st.sampled_from([0.3, 1.0]), tolerance=tolerances, goal_tolerance=st.sampled_from([0.05, 0.1]),
)  # fmt: skip


@few
@given(st.lists(waypoints, min_size=1, max_size=6), st.integers(1, 3), limits_of_all_kinds, places, st.integers(0, 3))
@example([Waypoint(0, 0)], 1, LIMITS, 0.0, 0)
@example([Waypoint(0, 0), Waypoint(0, 0), Waypoint(0, 0, 3.0)], 1, LIMITS, 0.0, 0)
@example([Waypoint(-1, 0), Waypoint(1, 0), Waypoint(-1, 0)], 3, LIMITS, 0.0, 2)
def test_each_waypoint_is_reached_within_tolerance(
    way: list[Waypoint], laps: int, limits: Limits, yaw: float, delay: int
) -> None:
    try:
        one = Course(tuple(way), "", laps)
    except CourseError:
        one = Course(tuple(way))
    driven = drive(one, limits, Pose2(0.0, 0.0, yaw), delay)
    assert driven.follower.finished
    assert driven.follower.missed == []
    for miss, goal in zip(driven.misses(), one.waypoints, strict=True):
        assert miss <= (goal.tolerance or limits.tolerance) + limits.max_velocity * DT, "the one between two samples"
    end, last = driven.poses[-1], one.waypoints[-1]
    there = last.tolerance or min(limits.tolerance, limits.goal_tolerance)
    assert math.hypot(end.x - last.x, end.y - last.y) <= there + BRAKING
    if last.yaw is not None:
        assert abs(angle_difference(last.yaw, end.yaw)) <= limits.yaw_tolerance + 0.2 * (delay + 2) * DT


@few
@given(st.lists(waypoints, min_size=1, max_size=5), limits_of_all_kinds)
def test_no_limit_is_exceeded_and_the_same_is_the_same_again(way: list[Waypoint], limits: Limits) -> None:
    driven = drive(Course(tuple(way)), limits)
    assert drive(Course(tuple(way)), limits)[:2] == driven[:2]
    for a, b in pairwise(driven.motions[:-1]):  # the last one is to stand
        assert 0.0 <= b.linear <= limits.max_velocity
        assert abs(b.angular) <= limits.max_angular_velocity
        assert -limits.max_deceleration * DT - 1e-9 <= b.linear - a.linear <= limits.max_acceleration * DT + 1e-9
        assert abs(b.angular - a.angular) <= limits.max_angular_acceleration * DT + 1e-9


def test_a_corner_is_not_cut_by_more_than_the_tolerance_however_far_it_looks_ahead() -> None:
    corner = course((3, 0), (3, 3), (6, 3))
    for lookahead in (0.3, 1.0, 3.0):
        far = msgspec.structs.replace(LIMITS, min_lookahead=lookahead, max_lookahead=lookahead, tolerance=0.1)
        assert max(drive(corner, far).misses()) <= 0.1
    assert max(drive(corner, delay=4).misses()) <= 0.25


@pytest.mark.parametrize("yaw", [0.0, 1.0, math.pi, -2.0])
def test_it_turns_on_the_spot_at_the_start_only_where_it_looks_elsewhere(yaw: float) -> None:
    driven = drive(course((2, 0)), begin=Pose2(0, 0, yaw))
    turned = [
        pose for pose, motion in zip(driven.poses, driven.motions, strict=False) if motion.angular and not motion.linear
    ]
    assert bool(turned) == (abs(yaw) > LIMITS.turn_angle)
    assert all(math.hypot(pose.x, pose.y) < 1e-9 for pose in turned[:-1])


def test_where_the_way_turns_back_it_stands_and_turns() -> None:
    driven = drive(course((2, 0), (0.5, 0.0)))
    assert max(pose.x for pose in driven.poses) <= 2.0 + BRAKING
    assert max(abs(pose.y) for pose in driven.poses) < 0.05
    assert driven.misses()[0] < 0.05


def test_a_yaw_that_is_asked_for_is_taken_on_the_spot() -> None:
    driven = drive(course((1, 0, math.pi / 2), (1, 1)))
    standing = [pose for pose, motion in zip(driven.poses[1:], driven.motions[1:], strict=False) if not motion.linear]
    assert any(abs(angle_difference(math.pi / 2, pose.yaw)) <= 0.05 and abs(pose.x - 1) < 0.02 for pose in standing)
    assert driven.follower.finished


def test_speeds_on_the_way_are_kept() -> None:
    driven = drive(Course((Waypoint(1, 0), Waypoint(2, 0, speed=0.1), Waypoint(4, 0))))
    slow = [m.linear for p, m in zip(driven.poses, driven.motions[1:], strict=False) if 1.0 < p.x < 1.75]
    assert max(slow) <= 0.1 + 0.01
    assert max(m.linear for m in driven.motions) == 0.5


def test_curves_are_taken_slowly() -> None:
    wide, narrow = (drive(course((2, 0), (2, 2)), msgspec.structs.replace(LIMITS, tolerance=one)) for one in (1.0, 0.1))
    for driven in (wide, narrow):
        lateral = [motion.linear * abs(motion.angular) for motion in driven.motions]
        assert max(lateral) <= LIMITS.max_lateral_acceleration * 1.2
    assert len(wide.poses) < len(narrow.poses)


def test_laps_are_driven_without_a_stop_between_them() -> None:
    square = course((2, 0), (2, 2), (0, 2), (0, 0), laps=3)
    driven = drive(square)
    assert driven.follower.lap == 2
    assert driven.follower.finished
    begun = next(i for i, motion in enumerate(driven.motions) if motion.linear > 0.2)
    ended = len(driven.motions) - 40
    assert min(motion.linear for motion in driven.motions[begun:ended]) > 0.1
    passed = sum(
        math.hypot(p.x, p.y - 2) <= 0.25 and math.hypot(q.x, q.y - 2) > 0.25 for p, q in pairwise(driven.poses)
    )
    assert passed == 3


def test_a_course_for_ever_goes_on_and_numbers_begin_anew() -> None:
    driven = drive(course((2, 0), (2, 2), (0, 0), laps=0), seconds=200.0)
    assert not driven.follower.finished
    assert driven.follower.lap > 5
    assert driven.follower.waypoint in (0, 1, 2)
    assert 0.0 <= driven.follower.left < 10.0


def test_it_begins_with_the_waypoint_that_is_said() -> None:
    one = Course((Waypoint(5, 5), Waypoint(1, 0), Waypoint(2, 0)), "", 1, 1)
    driven = drive(one)
    assert driven.follower.finished
    assert max(abs(pose.y) for pose in driven.poses) < 0.01


def test_who_passed_a_waypoint_by_goes_back() -> None:
    """It is pushed aside beyond the next waypoint."""
    follower, pose = Follower(course((2, 0), (4, 0))), Pose2()
    for _ in range(40):
        pose = advance(pose, *follower.step(pose, 0.5, LIMITS, DT), DT)
    pose = Pose2(3.0, 0.9, 0.0)
    nearest = math.inf
    while not follower.finished and nearest > 0.25:
        pose = advance(pose, *follower.step(pose, 0.5, LIMITS, DT), DT)
        nearest = min(nearest, math.hypot(pose.x - 2, pose.y))
    assert nearest <= 0.25


def test_who_does_not_get_on_is_told_and_may_give_up() -> None:
    follower = Follower(course((1, 0), (2, 0), (0, 0)))
    for _ in range(100):
        motion = follower.step(Pose2(), 0.0, LIMITS, DT)
    assert follower.idle == pytest.approx(100 * DT, abs=2 * DT)
    assert 0.0 < motion.linear <= LIMITS.max_acceleration * (0.5 + DT), "a base that was held up does not jump"
    follower.give_up(0.25)
    assert (follower.missed, follower.waypoint, follower.idle) == ([0], 1, 0.0)
    follower.give_up(0.25)
    for _ in range(20):
        follower.step(Pose2(), 0.0, LIMITS, DT)
    assert follower.finished, "it is where the last one is"
    assert follower.missed == [0, 1]


def test_a_base_that_never_comes_round_does_not_hide_it() -> None:
    follower = Follower(course((-1, 0)))
    for step in range(200):
        follower.step(Pose2(0, 0, 0.02 * (step % 2)), 0.0, LIMITS, DT)
    assert follower.turning
    assert follower.idle > 8.0


def test_a_course_of_many_close_poses_is_one_smooth_way() -> None:
    """As planners publish them."""
    arc = [(2 * math.sin(i / 40), 2 - 2 * math.cos(i / 40)) for i in range(1, 121)]
    driven = drive(course(*arc), delay=2)
    assert max(driven.misses()) < 0.2
    assert len(driven.poses) * DT < 6.0 / 0.5 + 4.0


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_odometry_that_jitters_changes_nothing(noise: float) -> None:
    jitter = random.Random(1)
    follower, pose = Follower(course((2, 0.5), (3, 2), (1, 3), (0, 1))), Pose2()
    for _ in range(2000):
        seen = Pose2(
            pose.x + jitter.gauss(0, noise), pose.y + jitter.gauss(0, noise), pose.yaw + jitter.gauss(0, noise)
        )
        pose = advance(pose, *follower.step(seen, follower.motion.linear, LIMITS, DT), DT)
    assert follower.finished


@few
@given(st.lists(waypoints, min_size=2, max_size=6), st.integers(0, 2**32), st.sampled_from([0, 2, 4]))
def test_it_comes_to_its_end_however_it_is_pushed_and_held(way: list[Waypoint], seed: int, delay: int) -> None:
    chance, follower, pose, held, pushes = random.Random(seed), Follower(Course(tuple(way))), Pose2(), 0, 0
    motions = [STAND] * (delay + 1)
    for _ in range(20_000):
        seen = Pose2(*(value + chance.gauss(0, 0.01) for value in pose))
        motions.append(follower.step(seen, motions[-1 - delay].linear, LIMITS, DT))
        assert all(map(math.isfinite, motions[-1]))
        if follower.finished:
            break
        if pushes < 3 and chance.random() < 0.01:
            pushes += 1
            held = chance.choice([0, 0, 100])
            pose = Pose2(pose.x + chance.uniform(-2, 2), pose.y + chance.uniform(-2, 2), chance.uniform(-3, 3))
        held -= 1
        if held <= 0:
            pose = advance(pose, *motions[-1 - delay], DT)
    assert follower.finished
    assert follower.missed == []


# -- formulas --------------------------------------------------------------------------------------------------------


@given(st.floats(0.05, 5), st.floats(-5, 5))
def test_the_arc_leads_to_the_point(ahead: float, left: float) -> None:
    curvature = curvature_to(ahead, left)
    angle = 2 * math.atan2(left, ahead)
    length = angle / curvature if abs(curvature) > 1e-9 else ahead
    end = advance(Pose2(), 1.0, curvature, length)
    assert (end.x, end.y) == pytest.approx((ahead, left), abs=1e-4)
    assert curvature_to(0.0, 0.0) == 0.0


@given(st.floats(0.1, 3), st.floats(-3, 3), st.floats(-3, 3), st.floats(-3, 3), st.floats(0.05, 1))
def test_whether_an_arc_passes_a_point(tx: float, ty: float, x: float, y: float, distance: float) -> None:
    curvature, angle = curvature_to(tx, ty), 2 * math.atan2(ty, tx)
    length = angle / curvature if abs(curvature) > 1e-6 else tx
    poses = [advance(Pose2(), 1.0, curvature, length * i / 400) for i in range(401)]
    nearest = min(math.hypot(p.x - x, p.y - y) for p in poses)
    if abs(nearest - distance) > 0.02:
        assert passes((x, y), (tx, ty), distance, turning=False) == (nearest <= distance)
    straight = min(math.hypot(x - tx * i / 400, y - ty * i / 400) for i in range(401))
    if abs(straight - distance) > 0.02:
        assert passes((x, y), (tx, ty), distance, turning=True) == (straight <= distance)


@given(st.floats(0, 20), st.floats(0, 2), st.floats(0.05, 5), st.floats(0, 1))
def test_who_brakes_by_the_formula_is_slow_enough_in_time(distance: float, end: float, a: float, react: float) -> None:
    speed = speed_before(distance, end, a, react)
    assert speed >= end
    if speed > end:
        assert speed * react + (speed**2 - end**2) / (2 * a) == pytest.approx(distance, abs=1e-6)
    assert speed_before(-1.0, end, a, react) == pytest.approx(end)


# -- the courses that ship -------------------------------------------------------------------------------------------


class Hall:
    """The simulated base in the hall."""

    def __init__(self) -> None:
        surroundings = world.load(str(CONFIG / "hall.yaml"))
        self.clearance: Callable[[float, float], float] = lambda x, y: world.clearance(
            surroundings.segments(), surroundings.circles, x, y
        )
        self.base = SimulatedBase(surroundings, BASE, Pose2())

    def drive(self, course: Course, limits: Limits = LIMITS) -> tuple[float, float, list[float]]:
        """How long it takes, s, how near it comes to anything, m, and how far it passes each waypoint, m."""
        follower, steps, nearest = Follower(course), 0, math.inf
        misses = [math.inf] * len(course.waypoints)
        while not follower.finished and steps < 30_000:
            if steps % 5 == 0:  # the base steps at 50 Hz, the follower at 10
                motion = follower.step(self.base.pose, self.base.linear, limits, 0.1)
            self.base.step(*motion, 0.02)
            assert not self.base.bumped
            pose, steps = self.base.pose, steps + 1
            nearest = min(nearest, self.clearance(pose.x, pose.y))
            misses = [
                min(m, math.hypot(pose.x - w.x, pose.y - w.y)) for m, w in zip(misses, course.waypoints, strict=True)
            ]
        assert follower.finished
        return steps * 0.02, nearest, misses


@pytest.mark.parametrize(("speed", "laps", "most"), [(0.5, 1, 120.0), (0.8, 1, 90.0), (1.0, 2, 160.0)])
def test_the_course_through_the_hall_is_reached_far_from_everything(speed: float, laps: int, most: float) -> None:
    one = load(str(CONFIG / "course.yaml"), laps)
    seconds, nearest, misses = Hall().drive(one, msgspec.structs.replace(LIMITS, max_velocity=speed))
    assert len(misses) == 20
    assert max(misses) <= LIMITS.tolerance
    assert nearest >= 0.7, "0.5 m beside the robot: the safety monitor has nothing to say"
    assert seconds <= most


def test_the_dock_is_reached_slowly_and_straight() -> None:
    hall, one = Hall(), load(str(CONFIG / "dock.yaml"))
    seconds, nearest, misses = hall.drive(one)
    assert misses[-1] <= 0.03
    assert abs(angle_difference(one.waypoints[-1].yaw or 0.0, hall.base.pose.yaw)) <= 0.06
    assert nearest == pytest.approx(0.55, abs=0.03)
    assert 20.0 < seconds < 40.0


@pytest.mark.parametrize("yaw", [math.pi, -math.pi / 2, 3.0])
def test_the_turn_at_the_end_is_headway(yaw: float) -> None:
    follower, pose, motion = Follower(Course((Waypoint(0.8, 0.0, yaw),))), Pose2(0.0, 0.0, 0.6), STAND
    longest = 0.0
    while not follower.finished:
        motion = follower.step(pose, motion.linear, LIMITS, DT)
        longest = max(longest, follower.idle)
        pose = advance(pose, *motion, DT)
    assert abs(angle_difference(yaw, pose.yaw)) < 0.06
    assert longest < 1.0, "s without getting on, on a way on which nothing holds it up"


def test_who_is_held_while_it_turns_at_the_end_does_not_get_on() -> None:
    follower, pose = Follower(Course((Waypoint(0.05, 0.0, math.pi),))), Pose2()
    for _ in range(200):
        follower.step(pose, 0.0, LIMITS, DT)
    assert follower.idle > 9.0
