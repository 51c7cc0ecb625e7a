"""Velocities that change gently: limits of velocity, acceleration and jerk, without Zenoh and without a clock.

Over a step of dt s an axis has one acceleration a, by which its velocity v becomes v + a·dt. Its jerk is the
difference of the accelerations of two steps, divided by the dt of the later one. How large a may be follows from two
conditions.

**To stop in time.** With a jerk of at most J an acceleration a can be gone before the velocity has changed by more
than a²/(2J): that is the area under a ramp from a to 0, and steps, each of which has the lower acceleration from its
beginning on, stay below it however long they are. So a velocity that is at a distance d from a bound never passes it
if after each step enough of d is left:

    d - a·dt ≥ a²/(2J)   ⇔   a ≤ d/T,   T = (dt + √(dt² + 2d/J)) / 2                                   (1)

Where this held before a step, d/T is at least a - J·dt: it can be kept with the jerk that is allowed, also where the
next step has another length. Without a limit of jerk T is dt: the bound is reached in one step.

**To pass zero slowly enough.** Slowing down may be allowed to be quicker than speeding up, D > A. A velocity that
comes from a speed s has at most A when it passes zero, if (1) holds for d = s + A²/(2J): what acceleration there is
at zero could then be gone within A²/(2J) behind it.
"""

import math
from typing import NamedTuple

import msgspec

from robo_messages import Twist, Vector3

SHORTEST_STEP = 1e-4
"""The shortest dt, s: an acceleration is a difference of velocities divided by it, and rounding would count."""

ROUNDING = 1e-13
"""A velocity that is nearer to its target than this, m/s or rad/s, is there; by (1) alone it would come ever nearer, by
a square at each step. The acceleration that is left then, √(2·J·ROUNDING), can end in any step, for J ≥ 2e-5."""


class AxisLimits(msgspec.Struct, frozen=True, kw_only=True):
    """What one axis may do."""

    max_velocity: float
    """m/s or rad/s, at least 0."""
    min_velocity: float
    """Of the other direction, m/s or rad/s, at most 0. Where both are 0 there is no such axis."""
    max_acceleration: float
    """How quickly it gains speed, in both directions, m/s² or rad/s², more than 0."""
    max_deceleration: float
    """How quickly it loses speed, m/s² or rad/s², more than 0."""
    max_jerk: float = math.inf
    """How quickly its acceleration changes, m/s³ or rad/s³, more than 0; infinite where that is not limited."""
    deadband: float = 0.0
    """What is slower is commanded as 0, m/s or rad/s."""


class Limits(msgspec.Struct, frozen=True, kw_only=True):
    """What the base may do."""

    linear: AxisLimits
    """Along x, forward."""
    lateral: AxisLimits
    """Along y, to the left."""
    angular: AxisLimits
    """Around z, to the left."""
    scale_velocities: bool = False
    """Whether what one axis cannot do slows the others down as much, so that the base stays on its curve."""

    def axes(self) -> tuple[AxisLimits, AxisLimits, AxisLimits]:
        """Those of each axis, in the order of `Motion`."""
        return self.linear, self.lateral, self.angular


class AxisMotion(NamedTuple):
    """How one axis moves after a step."""

    velocity: float = 0.0
    """m/s or rad/s."""
    acceleration: float = 0.0
    """During the step, m/s² or rad/s²."""


class Motion(NamedTuple):
    """How the base moves after a step."""

    linear: AxisMotion = AxisMotion()
    lateral: AxisMotion = AxisMotion()
    angular: AxisMotion = AxisMotion()


STANDING = Motion()


def target_of(command: Twist, limits: Limits) -> tuple[float, float, float]:
    """What becomes of a command by the limits of velocity.

    With `scale_velocities` all axes are slowed down alike; those that the base does not have are left out of account.

    Args:
        command: finite numbers.
        limits: of the base.

    Returns:
        The velocities along x and y, m/s, and around z, rad/s.
    """
    x, y, z = command.linear.x, command.linear.y, command.angular.z
    if limits.scale_velocities:
        share = min(_share(v, axis) for v, axis in zip((x, y, z), limits.axes(), strict=True))
        x, y, z = x * share, y * share, z * share
    a, b, c = limits.axes()
    return (
        _between(a.min_velocity, x, a.max_velocity),
        _between(b.min_velocity, y, b.max_velocity),
        _between(c.min_velocity, z, c.max_velocity),
    )


def step(motion: Motion, command: Twist, limits: Limits, dt: float) -> Motion:
    """How the base moves after the next step, as fast as may be towards a command.

    From STANDING on no limit is ever exceeded, whatever is commanded. Where `motion` contradicts limits, since they
    were changed or it was measured, the velocity comes back into them as they allow, and a limit of acceleration goes
    before one of jerk. An axis passes its target only where its jerk leaves it no choice: where the target was moved
    while it accelerated. With `scale_velocities` the velocities change in proportion, and so keep their ratio from
    standstill and to it, but where one axis would pass its target by that.

    Args:
        motion: how it moves now.
        command: what is wanted: finite numbers.
        limits: of the base.
        dt: how long the step takes, s, at least SHORTEST_STEP.

    Raises:
        ValueError: `dt` is shorter, or no number.
    """
    if not dt >= SHORTEST_STEP:
        raise ValueError(f"a step of {dt!r} s: it takes at least {SHORTEST_STEP:g} s")
    target = target_of(command, limits)
    axes = [_AxisStep(*each, dt) for each in zip(motion, target, limits.axes(), strict=True)]
    wanted = _in_proportion(axes, dt) if limits.scale_velocities else [axis.soonest() for axis in axes]
    x, y, z = (axis.taken(acceleration) for axis, acceleration in zip(axes, wanted, strict=True))
    return Motion(x, y, z)


def begun_at(motion: Motion, measured: Twist, command: Twist, limits: Limits) -> Motion:
    """The motion from which the next step begins where the base is measured: a closed loop.

    A measured velocity counts between standstill, what was commanded last, with the acceleration that it had, and what
    is wanted. So a base that does not obey, is pushed or rolls the other way leads no command away from what is wanted,
    nor keeps it from becoming 0.

    Args:
        motion: how it was to move after the last step.
        measured: how it moves: finite numbers.
        command: what is wanted: finite numbers.
        limits: of the base.
    """
    velocities = measured.linear.x, measured.linear.y, measured.angular.z
    each = zip(motion, velocities, target_of(command, limits), limits.axes(), strict=True)
    x, y, z = (_axis_begun_at(axis, velocity, target, of.max_jerk) for axis, velocity, target, of in each)
    return Motion(x, y, z)


def twist_of(motion: Motion, limits: Limits) -> Twist:
    """The command for a motion: what is within the deadband is 0."""
    x, y, z = (
        0.0 if abs(axis.velocity) < of.deadband else axis.velocity
        for axis, of in zip(motion, limits.axes(), strict=True)
    )
    return Twist(Vector3(x, y), Vector3(z=z))


class _AxisStep:
    """The next step of one axis; a direction is 1.0 or -1.0."""

    def __init__(self, motion: AxisMotion, target: float, limits: AxisLimits, dt: float) -> None:
        self.acceleration = motion.acceleration
        self.distance = target - motion.velocity
        """How far the target is, m/s or rad/s; negative where it is below."""
        self.jerk = limits.max_jerk
        self._velocity = motion.velocity
        self._target = target
        self._limits = limits
        self._dt = dt

    def soonest(self) -> float:
        """The acceleration that leads to the target as soon as may be, but for the limit of jerk."""
        direction = math.copysign(1.0, self.distance)
        return direction * self._up_to(self._target, direction)

    def time(self, jerk: float) -> float:
        """The least time in which a constant acceleration may cover the distance, s.

        Args:
            jerk: the limit that is to be kept when zero is passed, m/s³ or rad/s³.
        """
        distance = abs(self.distance)
        direction = math.copysign(1.0, self.distance)
        return max(_time_to_stop(distance, self._dt, self.jerk), distance / self._most(direction, jerk))

    def guarded(self, acceleration: float) -> float:
        """The acceleration, as far as neither the target is passed by it nor a limit of velocity behind."""
        up = self._target if self.distance >= 0.0 else self._limits.max_velocity
        down = self._target if self.distance <= 0.0 else self._limits.min_velocity
        return _between(-self._up_to(down, -1.0), acceleration, self._up_to(up, 1.0))

    def taken(self, acceleration: float) -> AxisMotion:
        """The motion after the step, with an acceleration as near to that as the limits allow."""
        change = self.jerk * self._dt
        a = _between(self.acceleration - change, acceleration, self.acceleration + change)
        a = _between(-self._most(-1.0, self.jerk), a, self._most(1.0, self.jerk))
        velocity = self._velocity + a * self._dt
        return AxisMotion(self._target if abs(self._target - velocity) <= ROUNDING else velocity, a)

    def _up_to(self, bound: float, direction: float) -> float:
        """The largest acceleration in a direction that may be had before a bound there."""
        distance = max(0.0, direction * (bound - self._velocity))
        return min(self._most(direction, self.jerk), distance / _time_to_stop(distance, self._dt, self.jerk))

    def _most(self, direction: float, jerk: float) -> float:
        """The largest acceleration in a direction."""
        a, speed = self._limits.max_acceleration, -direction * self._velocity
        if speed <= 0.0:
            return a
        distance = speed + a * a / (2 * jerk)
        # At most A may always be had, as zero may be passed with it. Where D < A, D holds in the step that passes zero.
        return min(self._limits.max_deceleration, max(a, distance / _time_to_stop(distance, self._dt, jerk)))


def _in_proportion(axes: list[_AxisStep], dt: float) -> list[float]:
    """The accelerations by which all axes come to their targets at once, but for the limits of jerk.

    Each acceleration is the distance divided by a time, which is the same for all: that of the slowest. Accelerations
    that are in another proportion, since the target was moved meanwhile, turn into this one, each at the same pace.
    """
    moving = [axis for axis in axes if axis.distance]
    # Axes in proportion have the jerk, for each one's distance, of the one that has the least.
    jerk = min((axis.jerk / abs(axis.distance) for axis in moving), default=math.inf)
    time = max((axis.time(jerk * abs(axis.distance)) for axis in moving), default=dt)
    wanted = [axis.distance / time for axis in axes]
    share = min(_change_share(axis.jerk * dt, a - axis.acceleration) for axis, a in zip(axes, wanted, strict=True))
    if share < 1.0:
        wanted = [axis.acceleration + share * (a - axis.acceleration) for axis, a in zip(axes, wanted, strict=True)]
    return [axis.guarded(a) for axis, a in zip(axes, wanted, strict=True)]


def _axis_begun_at(motion: AxisMotion, measured: float, target: float, jerk: float) -> AxisMotion:
    velocity, a = motion
    stops = velocity + a * abs(a) / (2 * jerk)
    low, high = min(0.0, velocity, stops, target), max(0.0, velocity, stops, target)
    begin = _between(low, measured, high)
    return AxisMotion(begin, _between(-_gone_within(begin - low, jerk), a, _gone_within(high - begin, jerk)))


def _gone_within(distance: float, jerk: float) -> float:
    """The acceleration that can be gone before the velocity has changed by a distance."""
    return math.sqrt(2 * distance * jerk) if distance > 0.0 else 0.0


def _time_to_stop(distance: float, dt: float, jerk: float) -> float:
    """T of (1), s."""
    return (dt + math.sqrt(dt * dt + 2 * distance / jerk)) / 2


def _share(velocity: float, limits: AxisLimits) -> float:
    """How much of a velocity an axis can do, 0 to 1."""
    limit = limits.max_velocity if velocity > 0.0 else -limits.min_velocity
    if abs(velocity) <= limit or limits.min_velocity == limits.max_velocity == 0.0:
        return 1.0
    return limit / abs(velocity)


def _change_share(limit: float, change: float) -> float:
    """How much of a change is within a limit, 0 to 1."""
    return 1.0 if abs(change) <= limit else limit / abs(change)


def _between(low: float, value: float, high: float) -> float:
    return max(low, min(high, value))
