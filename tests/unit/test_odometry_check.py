"""What odometry is believed, whatever comes."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo_messages import Header, Odometry, Point, Pose, PoseWithCovariance, Quaternion, Time
from robo_services.odometry_check import (
    AGREEING,
    LEAST,
    MARGIN,
    MOST_IN_DOUBT,
    BaseLimits,
    Fix,
    Motion,
    OdometryTrack,
    fix_of,
)

LIMITS = BaseLimits(max_linear_velocity=1.0, max_angular_velocity=2.0)
PERIOD = 0.02

numbers = st.floats(allow_nan=False, allow_infinity=False)
anywhere = st.builds(Fix, numbers, numbers, st.floats(-math.pi, math.pi), st.floats(-3e9, 3e9), st.floats(0, 1e6))
far_off = st.builds(
    Fix, st.floats(50, 1e300), numbers, st.floats(-math.pi, math.pi), st.floats(-3e9, 3e9), st.just(math.nan)
)


def drive(count: int, speed: float = 0.9, start: float = 0.0, x: float = 0.0) -> list[Fix]:
    times = [start + i * PERIOD for i in range(count)]
    return [Fix(x + speed * PERIOD * i, 0.0, 0.0, 1000 + time, time) for i, time in enumerate(times)]


def believed(track: OdometryTrack, fixes: list[Fix | None]) -> list[Motion]:
    return [step for fix in fixes for step in track.take(fix, LIMITS).steps]


@given(st.lists(st.lists(far_off | st.none(), max_size=AGREEING - 1), min_size=20, max_size=20))
def test_garbage_between_true_messages_changes_nothing(garbage: list[list[Fix | None]]) -> None:
    true = drive(len(garbage))
    mixed: list[Fix | None] = []
    for fix, between in zip(true, garbage, strict=True):
        mixed += [fix, *(odd and odd._replace(arrived=fix.arrived) for odd in between)]
    track = OdometryTrack()
    steps = believed(track, mixed)
    assert steps == believed(OdometryTrack(), [*true])
    assert [step.x for step in steps] == [fix.x for fix in true]
    assert track.left_out == len(mixed) - len(true)


@given(st.lists(anywhere, max_size=200))
def test_no_step_is_longer_than_the_base_can_drive(fixes: list[Fix]) -> None:
    fixes = sorted(fixes, key=lambda fix: fix.arrived)
    track = OdometryTrack()
    steps = believed(track, [*fixes])
    assert len(steps) + track.left_out == len(fixes)
    longest = max((fix.stamp for fix in fixes), default=0.0) - min((fix.stamp for fix in fixes), default=0.0)
    longest = max(longest, fixes[-1].arrived - fixes[0].arrived if fixes else 0.0, LEAST)
    assert all(0 <= step.driven <= longest * MARGIN * LIMITS.max_linear_velocity for step in steps)


@given(st.lists(st.floats(-3e9, 3e9), min_size=1, max_size=50))
def test_stamps_that_lie_cost_nothing(stamps: list[float]) -> None:
    fixes = [fix._replace(stamp=stamp) for fix, stamp in zip(drive(len(stamps)), stamps, strict=True)]
    assert len(believed(OdometryTrack(), [*fixes])) == len(fixes)


def test_bursts_are_believed_by_their_stamps() -> None:
    fixes = [fix._replace(arrived=5.0, x=30 * fix.x, stamp=30 * fix.stamp) for fix in drive(50)]  # as in a replay
    assert len(believed(OdometryTrack(), [*fixes])) == 50


def test_a_base_that_was_reset_begins_anew_without_distance() -> None:
    before, after = drive(200), drive(20, start=200 * PERIOD)
    track = OdometryTrack()
    believed(track, [*before])
    waiting = [track.take(fix, LIMITS) for fix in after[: AGREEING - 1]]
    assert all(not judged.steps and "3.58" in judged.doubt for judged in waiting[:1])
    judged = track.take(after[AGREEING - 1], LIMITS)
    assert (len(judged.steps), judged.steps[0].driven) == (AGREEING, 0.0)
    assert judged.jump == pytest.approx(before[-1].x)
    steps = [*judged.steps, *believed(track, [*after[AGREEING:]])]
    assert [step.x for step in steps] == [fix.x for fix in after]
    assert sum(step.driven for step in steps) == pytest.approx(after[-1].x)
    assert track.left_out == 0


def test_a_way_that_nobody_heard_of_counts_where_there_was_time_for_it() -> None:
    for silence, counts in ((60.0, True), (2.0, False)):
        before = drive(10)
        after = drive(10, start=silence, x=30.0)
        by_stamps = [fix._replace(arrived=before[-1].arrived + 0.001) for fix in after]  # a replay does not wait
        steps = believed(OdometryTrack(), [*before, *by_stamps])
        driven = sum(step.driven for step in steps)
        assert driven == pytest.approx(after[-1].x if counts else before[-1].x + after[-1].x - 30.0)


def test_who_believes_nothing_for_long_begins_anew() -> None:
    track = OdometryTrack()
    believed(track, [*drive(3)])
    jumping = [Fix(1e3 * i, 0.0, 0.0, 0.0, 0.0) for i in range(1, MOST_IN_DOUBT + 1)]
    assert believed(track, [*jumping]) == [Motion(1e3 * MOST_IN_DOUBT, 0.0, 0.0)]
    assert track.left_out == MOST_IN_DOUBT - 1


@pytest.mark.parametrize("odd", [math.nan, math.inf, -math.inf, 1e200])
def test_what_is_not_finite_is_no_fix(odd: float) -> None:
    poses = [
        Pose(Point(odd, 0.0)),
        Pose(Point(0.0, odd)),
        Pose(orientation=Quaternion(odd, odd, odd, odd)),
        Pose(orientation=Quaternion(0.0, 0.0, odd, 1.0)),
    ]
    for pose in poses:
        fix = fix_of(Odometry(pose=PoseWithCovariance(pose)), 0.0)
        assert fix is None or all(map(math.isfinite, fix))
        assert math.isfinite(odd) or fix is None


def test_a_fix_is_what_the_message_says() -> None:
    odometry = Odometry(Header(Time(3, 500_000_000)), "base_link", PoseWithCovariance(Pose(Point(1.0, 2.0))))
    assert fix_of(odometry, 7.0) == Fix(1.0, 2.0, 0.0, 3.5, 7.0)
    assert fix_of(Odometry(pose=PoseWithCovariance(Pose(orientation=Quaternion(w=0.0)))), 0.0) == Fix(0, 0, 0, 0, 0)
