"""Gentle velocities keep their limits, whatever is commanded, however long steps are."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robo_messages import Twist, Vector3
from robo_services.limits import ramp
from robo_services.smoothing import (
    SHORTEST_STEP,
    STANDING,
    AxisLimits,
    AxisMotion,
    Limits,
    Motion,
    begun_at,
    step,
    target_of,
    twist_of,
)

EXACT = 1e-9
TINY = 1e-12
"""A velocity of which nobody can say whether it is on this or on that side of zero."""

few = settings(max_examples=150, derandomize=True)

NO_AXIS = AxisLimits(max_velocity=0.0, min_velocity=0.0, max_acceleration=1.0, max_deceleration=1.0)


def axis(
    velocity: float = 10.0, acceleration: float = 1.0, deceleration: float = 1.0, jerk: float = math.inf
) -> AxisLimits:
    return AxisLimits(
        max_velocity=velocity,
        min_velocity=-velocity,
        max_acceleration=acceleration,
        max_deceleration=deceleration,
        max_jerk=jerk,
    )


def straight(limits: AxisLimits) -> Limits:
    return Limits(linear=limits, lateral=NO_AXIS, angular=NO_AXIS)


def twist(x: float = 0.0, y: float = 0.0, turn: float = 0.0) -> Twist:
    return Twist(Vector3(x, y), Vector3(z=turn))


accelerations = st.floats(0.1, 30.0)
jerks = st.just(math.inf) | st.floats(0.1, 500.0)
axes = st.builds(
    AxisLimits,
    max_velocity=st.floats(0.05, 5.0),
    min_velocity=st.floats(-5.0, 0.0),
    max_acceleration=accelerations,
    max_deceleration=accelerations,
    max_jerk=jerks,
)
lateral = axes | st.just(NO_AXIS)
proportional = st.builds(Limits, linear=axes, lateral=lateral, angular=axes, scale_velocities=st.just(True))
all_limits = proportional | st.builds(Limits, linear=axes, lateral=lateral, angular=axes)
wishes = st.just(0.0) | st.floats(-8.0, 8.0) | st.sampled_from([-1e300, 1e300])
commands = st.builds(twist, wishes, wishes, wishes)
dts = st.floats(1e-3, 0.5)
paces = st.floats(0.02, 0.5)
"""Of steps that are taken until something is reached, s."""


class Stretch(NamedTuple):
    """A command, and the steps that are taken towards it."""

    command: Twist
    dts: list[float]


stretches = st.lists(st.builds(Stretch, commands, st.lists(dts, min_size=1, max_size=25)), min_size=1, max_size=5)


def drive(motion: Motion, sequence: Sequence[Stretch], limits: Limits) -> list[Motion]:
    """All motions on a way, the first one included; each step is checked."""
    way = [motion]
    for stretch in sequence:
        for dt in stretch.dts:
            way.append(step(way[-1], stretch.command, limits, dt))
            check(way[-2], way[-1], limits, dt)
    return way


def settle(motion: Motion, command: Twist, limits: Limits, dt: float) -> list[Motion]:
    """All motions until it is exactly where a command wants it, without any acceleration; each step is checked."""
    way = [motion]
    target = target_of(command, limits)
    while [*way[-1]] != [AxisMotion(velocity) for velocity in target]:
        way += drive(way[-1], [Stretch(command, [dt])], limits)[1:]
        assert len(way) * dt < 1000.0, "it takes too long"
    return way


def check(before: Motion, after: Motion, limits: Limits, dt: float) -> None:
    """No limit is exceeded by a step, as seen from its velocities."""
    for a, b, one in zip(before, after, limits.axes(), strict=True):
        acceleration = (b.velocity - a.velocity) / dt
        assert acceleration == pytest.approx(b.acceleration, rel=EXACT, abs=EXACT)
        assert one.min_velocity - EXACT <= b.velocity <= one.max_velocity + EXACT
        assert abs(b.acceleration - a.acceleration) <= one.max_jerk * dt + EXACT
        gains = abs(b.velocity) > abs(a.velocity)
        most = one.max_acceleration if gains else one.max_deceleration
        if a.velocity * b.velocity < 0 and min(abs(a.velocity), abs(b.velocity)) > TINY:
            most = min(one.max_acceleration, one.max_deceleration)  # it slows down, and speeds up, within the step
        assert abs(acceleration) <= most + EXACT


@few
@given(all_limits, stretches)
def test_no_limit_is_ever_exceeded(limits: Limits, sequence: list[Stretch]) -> None:
    way = drive(STANDING, sequence, limits)
    assert drive(STANDING, sequence, limits) == way, "the same again"


@few
@given(all_limits, stretches, commands | st.just(Twist()), paces)
def test_each_command_is_reached_after_all_and_standstill_too(
    limits: Limits, sequence: list[Stretch], command: Twist, dt: float
) -> None:
    settle(drive(STANDING, sequence, limits)[-1], command, limits, dt)


@few
@given(axes, st.floats(-5.0, 5.0), paces)
def test_a_constant_command_is_reached_as_soon_as_can_be_and_not_passed(
    limits: AxisLimits, wish: float, dt: float
) -> None:
    way = [motion.linear.velocity for motion in settle(STANDING, twist(wish), straight(limits), dt)]
    speeds = [abs(velocity) for velocity in way]
    assert speeds == sorted(speeds)
    assert abs(target_of(twist(wish), straight(limits))[0]) == speeds[-1]
    # In continuous time: a ramp of the acceleration up to its limit and down again, or, for a little way, not so far.
    least = speeds[-1] / limits.max_acceleration + limits.max_acceleration / limits.max_jerk
    if speeds[-1] <= limits.max_acceleration**2 / limits.max_jerk:
        least = 2 * math.sqrt(speeds[-1] / limits.max_jerk)
    assert len(way) * dt <= least + 8 * dt


@few
@given(all_limits, stretches)
def test_who_can_stop_before_a_target_does_not_pass_it(limits: Limits, sequence: list[Stretch]) -> None:
    motion = STANDING
    for stretch in sequence:
        target = target_of(stretch.command, limits)
        for before, after in pairwise(drive(motion, [stretch], limits)):
            for a, b, there, of in zip(before, after, target, limits.axes(), strict=True):
                stops = a.velocity + a.acceleration * abs(a.acceleration) / (2 * of.max_jerk)
                if (there - a.velocity) * (there - stops) > 0.0:
                    assert (there - b.velocity) * math.copysign(1.0, there - a.velocity) >= -EXACT
            motion = after


@few
@given(axes, stretches, commands, paces)
def test_a_target_is_passed_only_as_far_as_jerk_makes_it(
    limits: AxisLimits, sequence: list[Stretch], command: Twist, dt: float
) -> None:
    motion = drive(STANDING, sequence, straight(limits))[-1]
    velocity, acceleration = motion.linear
    target = target_of(command, straight(limits))[0]
    stops = velocity + acceleration * abs(acceleration) / (2 * limits.max_jerk)
    for later in settle(motion, command, straight(limits), dt):
        assert min(velocity, target, stops) - EXACT <= later.linear.velocity <= max(velocity, target, stops) + EXACT


@few
@given(proportional, commands, st.lists(dts, max_size=60), paces)
def test_a_curve_is_kept_from_standstill_and_to_it(
    limits: Limits, command: Twist, some: list[float], dt: float
) -> None:
    target = target_of(command, limits)
    begun = drive(STANDING, [Stretch(command, some)], limits)
    there = settle(begun[-1], command, limits, dt)
    back = settle(there[-1], twist(*(-velocity / 2 for velocity in target)), limits, dt)
    for motion in [*begun, *there, *back, *settle(begun[-1], twist(), limits, dt)]:
        for a, wanted_a in zip(motion, target, strict=True):
            for b, wanted_b in zip(motion, target, strict=True):
                assert a.velocity * wanted_b == pytest.approx(b.velocity * wanted_a, abs=EXACT)


def test_a_command_that_is_too_fast_keeps_its_curve() -> None:
    limits = Limits(linear=axis(0.5), lateral=NO_AXIS, angular=axis(2.0), scale_velocities=True)
    assert target_of(twist(1.0, turn=1.0), limits) == (0.5, 0.0, 0.5)
    assert target_of(twist(0.1, turn=-4.0), limits) == (0.05, 0.0, -2.0)
    assert target_of(twist(0.5, 0.3, turn=1.0), limits) == (0.5, 0.0, 1.0), "there is no lateral axis"
    one_way = msgspec.structs.replace(limits, linear=msgspec.structs.replace(axis(0.5), min_velocity=0.0))
    assert target_of(twist(-0.3, turn=1.0), one_way) == (0.0, 0.0, 0.0), "a turn on the spot is another path"
    apart = msgspec.structs.replace(limits, scale_velocities=False)
    assert target_of(twist(1.0, turn=1.0), apart) == (0.5, 0.0, 1.0)


def test_what_is_in_proportion_waits_for_the_slowest() -> None:
    limits = Limits(linear=axis(), lateral=NO_AXIS, angular=axis(acceleration=9.0), scale_velocities=True)
    way = settle(STANDING, twist(0.3, turn=0.6), limits, 0.1)
    assert [motion.linear.velocity for motion in way] == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.3])
    assert [motion.angular.velocity for motion in way] == pytest.approx([0.0, 0.2, 0.4, 0.6, 0.6])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_what_waits_for_another_axis_passes_neither_its_limit_nor_its_target(sign: float) -> None:
    quick = axis(velocity=1.0, acceleration=5.0, deceleration=5.0, jerk=10.0)
    lazy = axis(velocity=5.0, jerk=0.1)
    limits = Limits(linear=quick, lateral=NO_AXIS, angular=lazy, scale_velocities=True)
    turning = Stretch(twist(turn=-5.0), 50 * [0.01])
    for steps in range(1, 60, 2):
        gaining = drive(STANDING, [Stretch(twist(sign), steps * [0.01]), turning], limits)
        slowing = drive(Motion(AxisMotion(sign)), [Stretch(twist(), steps * [0.01]), turning], limits)
        assert min(sign * motion.linear.velocity for motion in [*gaining, *slowing]) >= -EXACT


def test_a_reversal_slows_down_through_zero_and_speeds_up_behind() -> None:
    limits = straight(axis(acceleration=3.0, deceleration=4.0, jerk=20.0))
    way = settle(settle(STANDING, twist(1.0), limits, 0.01)[-1], twist(-1.0), limits, 0.01)
    slowing = [(motion.linear.velocity, -motion.linear.acceleration) for motion in way if motion.linear.velocity > 0.0]
    gaining = [-motion.linear.acceleration for motion in way if motion.linear.velocity < 0.0]
    assert max(acceleration for _, acceleration in slowing) == pytest.approx(4.0)
    assert max(gaining) == pytest.approx(3.0)
    assert slowing[-1][1] == pytest.approx(3.0, abs=0.2), "it comes to zero with what is allowed behind"
    late = min(velocity for velocity, acceleration in slowing if acceleration > 4.0 - EXACT)
    assert late == pytest.approx((4.0**2 - 3.0**2) / (2 * 20.0), abs=0.04), "and not earlier than it must"


@few
@given(accelerations, accelerations, st.floats(0.0, 5.0), st.floats(0.0, 5.0), st.sampled_from([-1.0, 1.0]), dts)
def test_without_a_limit_of_jerk_it_is_a_plain_ramp(
    acceleration: float, deceleration: float, begin: float, end: float, sign: float, dt: float
) -> None:
    limits = straight(axis(acceleration=acceleration, deceleration=deceleration))
    moved = step(Motion(AxisMotion(sign * begin)), twist(sign * end), limits, dt)
    assert moved.linear.velocity == pytest.approx(
        ramp(sign * begin, sign * end, dt, acceleration, deceleration), abs=EXACT
    )


def test_limits_that_were_lowered_are_come_back_to_as_they_allow() -> None:
    lowered = straight(axis(0.5, deceleration=2.0))
    way = [Motion(AxisMotion(1.0))]
    for _ in range(4):
        way.append(step(way[-1], twist(1.0), lowered, 0.1))
    assert [motion.linear.velocity for motion in way] == pytest.approx([1.0, 0.8, 0.6, 0.5, 0.5])
    hasty = Motion(AxisMotion(0.5, 3.0))
    assert step(hasty, twist(5.0), straight(axis(acceleration=1.0, jerk=2.0)), 0.1).linear.acceleration == 1.0


def test_the_deadband_is_exactly_zero_and_can_be_left() -> None:
    limits = straight(msgspec.structs.replace(axis(), deadband=0.25))
    way = settle(STANDING, twist(-1.0), limits, 0.1)
    commanded = [twist_of(motion, limits).linear.x for motion in way]
    assert commanded[:3] == [0.0, 0.0, 0.0]
    assert commanded[3:5] == pytest.approx([-0.3, -0.4])
    assert twist_of(Motion(AxisMotion(0.25)), limits) == twist(0.25), "only what is slower"


def test_rounding_makes_no_step_more() -> None:
    way = [Motion(AxisMotion(0.4))]
    for _ in range(4):
        way.append(step(way[-1], twist(), straight(axis(deceleration=2.0)), math.nextafter(0.05, 0.0)))
    assert way[-1].linear.velocity == 0.0


@pytest.mark.parametrize("dt", [0.0, -0.1, SHORTEST_STEP / 2, math.nan])
def test_a_step_takes_time(dt: float) -> None:
    with pytest.raises(ValueError, match=r"at least 0\.0001 s"):
        step(STANDING, twist(1.0), straight(axis()), dt)


far = st.sampled_from([0.0, 5e-324, 1e-300, 1e-12, 100.0])
least_and_most = st.builds(
    AxisLimits,
    max_velocity=far,
    min_velocity=far.map(lambda velocity: -velocity),
    max_acceleration=st.sampled_from([0.01, 1000.0]),
    max_deceleration=st.sampled_from([0.01, 1000.0]),
    max_jerk=st.sampled_from([0.01, 1e5, math.inf]),
    deadband=st.sampled_from([0.0, 10.0]),
)
any_limits = st.builds(
    Limits, linear=least_and_most, lateral=least_and_most, angular=least_and_most, scale_velocities=st.booleans()
)
odd_wishes = st.floats(allow_nan=False, allow_infinity=False)
odd_commands = st.builds(twist, odd_wishes, odd_wishes, odd_wishes)


@few
@given(any_limits, st.lists(odd_commands, min_size=1, max_size=5), st.sampled_from([SHORTEST_STEP, 1.0]))
def test_whatever_is_commanded_what_comes_out_is_finite(limits: Limits, wanted: list[Twist], dt: float) -> None:
    motion = STANDING
    for command in wanted:
        for _ in range(5):
            motion = step(begun_at(motion, wanted[0], command, limits), command, limits, dt)
            for one, of in zip(motion, limits.axes(), strict=True):
                assert math.isfinite(one.acceleration)
                assert of.min_velocity <= one.velocity <= of.max_velocity


@few
@given(all_limits, stretches)
def test_a_base_that_obeys_at_once_makes_no_difference(limits: Limits, sequence: list[Stretch]) -> None:
    for stretch in sequence:
        for motion in drive(STANDING, sequence, limits):
            begun = begun_at(motion, twist(*(one.velocity for one in motion)), stretch.command, limits)
            for a, b, of in zip(begun, motion, limits.axes(), strict=True):
                assert a.velocity == b.velocity
                assert of.max_jerk == math.inf or a.acceleration == pytest.approx(b.acceleration, abs=1e-6)


@few
@given(axes, stretches, st.lists(st.floats(-9.0, 9.0), min_size=1, max_size=9), paces)
def test_whatever_is_measured_commands_stay_within_what_is_wanted_and_become_zero(
    limits: AxisLimits, sequence: list[Stretch], speeds: list[float], dt: float
) -> None:
    motion = STANDING
    for stretch in [*sequence, Stretch(twist(), [dt] * 20_000)]:
        target = target_of(stretch.command, straight(limits))[0]
        for count, dt_now in enumerate(stretch.dts):
            velocity, acceleration = motion.linear
            stops = velocity + acceleration * abs(acceleration) / (2 * limits.max_jerk)
            begun = begun_at(motion, twist(speeds[count % len(speeds)]), stretch.command, straight(limits))
            motion = step(begun, stretch.command, straight(limits), dt_now)
            ends = 0.0, velocity, stops, target
            assert min(ends) - EXACT <= motion.linear.velocity <= max(ends) + EXACT
            if motion == STANDING:
                break
    assert motion == STANDING


def test_a_closed_loop_begins_where_the_base_is() -> None:
    limits = straight(axis(acceleration=1.0, deceleration=2.0))

    def commanded(last: float, measured: float, wanted: float) -> float:
        begun = begun_at(Motion(AxisMotion(last)), twist(measured), twist(wanted), limits)
        return step(begun, twist(wanted), limits, 0.1).linear.velocity

    assert commanded(0.3, 0.1, 1.0) == pytest.approx(0.2), "it lags behind"
    assert commanded(0.0, 0.8, 1.0) == pytest.approx(0.9), "it was driven by somebody else"
    assert commanded(0.5, 0.0, 1.0) == pytest.approx(0.1), "it was stopped"
    assert commanded(0.5, 0.9, 0.0) == pytest.approx(0.3), "it does not slow down, so it is told all the more"
    assert commanded(0.2, -0.7, 1.0) == pytest.approx(0.1), "it rolls back"
    assert commanded(0.0, 0.1, 0.0) == 0.0, "it is pushed"
