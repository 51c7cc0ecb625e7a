"""Drives: what the wheels have to do for a base to move as wanted, and how it moves when they turn.

Pure geometry, for wheels that roll and do not slide. A differential drive, a skid steer and a car (Ackermann)
answer the same three questions, so that a driver, a simulator or an odometry works with any of them:

    drive.limited(twist)   the velocity that comes nearest, on the same curve
    drive.wheels(twist)    what the wheels do then
    drive.twist(wheels)    how the base moves when they do that

Rates and ways go by the same formulas: wheels in rad/s give m/s and rad/s, wheels in rad give m and rad.
"""

import math
from typing import NamedTuple, Protocol

import msgspec

from robo_services.kinematics import Twist2
from robo_services.limits import clamp

STANDING = Twist2()

_LEAST, _MOST = 1e-6, 1e6
"""No length of a base is outside, m, and no multiplier: what is, is a slip of the pen."""


class Wheels(NamedTuple):
    """The wheels of the two sides, and where they are steered to."""

    left: float
    """rad/s forward; or how far it has turned, rad."""
    right: float
    """Likewise."""
    steering: float = 0.0
    """The angle of a wheel in the middle of the front axle, to the left, rad; 0 where nothing is steered."""


class Drive(Protocol):
    """What all drives have in common."""

    @property
    def max_wheel_velocity(self) -> float:
        """rad/s; infinite where nobody says."""

    def limited(self, twist: Twist2) -> Twist2:
        """The velocity that the base can have and that comes nearest, on the same curve; see each drive."""

    def wheels(self, twist: Twist2, steering: float = 0.0) -> Wheels:
        """What the wheels do for a velocity, or for as much of it as they can; `steering` is the present angle, rad."""

    def twist(self, wheels: Wheels) -> Twist2:
        """How the base moves when its wheels do this."""


class DiffDrive(msgspec.Struct, frozen=True, kw_only=True):
    """Two wheels on one axle, each with a motor (Siegwart, Nourbakhsh 2004, §3.2). `base_link` is between them.

    Raises:
        ValueError: a length or multiplier that no base has.
    """

    wheel_separation: float
    """Between the middles of the left and the right wheel, m."""
    wheel_radius: float
    """m."""
    wheel_separation_multiplier: float = 1.0
    """By what the separation is to be corrected, as found by turning on the spot."""
    left_wheel_radius_multiplier: float = 1.0
    """By what the radius is to be corrected, as found by driving straight."""
    right_wheel_radius_multiplier: float = 1.0
    """Likewise."""
    max_wheel_velocity: float = math.inf
    """rad/s."""

    def __post_init__(self) -> None:
        """Refuse what is no base."""
        _check_wheels(self)
        _check("wheel_separation_multiplier", self.wheel_separation_multiplier)

    @property
    def separation(self) -> float:
        """As corrected, m."""
        return self.wheel_separation * self.wheel_separation_multiplier

    def limited(self, twist: Twist2) -> Twist2:
        """Both velocities scaled down until no wheel is faster than it can; 0 for what is not finite."""
        return _scaled(self._unlimited(twist), twist, self.max_wheel_velocity)

    def wheels(self, twist: Twist2, steering: float = 0.0) -> Wheels:  # noqa: ARG002 - nothing is steered
        """What the wheels do for a velocity, or for as much of it as they can."""
        return self._unlimited(self.limited(twist))

    def twist(self, wheels: Wheels) -> Twist2:
        """How the base moves when its wheels do this."""
        left, right = _rims(self, wheels)
        return Twist2((left + right) / 2, (right - left) / self.separation)

    def _unlimited(self, twist: Twist2) -> Wheels:
        left, right = _radii(self)
        outward = twist.angular * self.separation / 2
        return Wheels((twist.linear - outward) / left, (twist.linear + outward) / right)


class SkidSteer(DiffDrive, frozen=True, kw_only=True):
    """Wheels in a row, or a track, on each side, which slide when the base turns.

    It turns as a differential drive whose wheels are further apart: the points where the ground and a side have the
    same velocity lie outside of it (Mandow et al. 2007, "Experimental kinematics for wheeled skid-steer mobile
    robots"). How much further depends on the ground, and is measured: turn on the spot by what odometry takes for ten
    turns, and multiply by ten over the turns that it was.
    """

    wheel_separation_multiplier: float = 1.5
    """At least 1; 1.5 to 2 for four wheels on a hard floor."""

    def __post_init__(self) -> None:
        """Refuse what is no base."""
        super().__post_init__()
        if self.wheel_separation_multiplier < 1.0:
            text = f"wheel_separation_multiplier = {self.wheel_separation_multiplier:g}: a skid steer has at least 1"
            raise ValueError(text)


class Ackermann(msgspec.Struct, frozen=True, kw_only=True):
    """A car: the wheels behind drive, those in front are steered; `base_link` is in the middle of the rear axle.

    Seen from there it is a bicycle: one that steers by δ turns with the curvature tan(δ) / wheelbase (Siegwart,
    Nourbakhsh 2004, §3.2; Rajamani 2012, §2.2). So it cannot turn on the spot: a velocity that turns and does not
    drive is none. It stands then, and its steering stays where it is.

    Raises:
        ValueError: a length or multiplier that no base has; a steering angle outside of (0, π/2).
    """

    wheelbase: float
    """Between the axles, m."""
    wheel_separation: float
    """Between the middles of the left and the right wheel, in front and behind, m."""
    wheel_radius: float
    """m."""
    max_steering_angle: float
    """Of a wheel in the middle, to either side, rad; the inner one of two steers more."""
    max_steering_velocity: float = math.inf
    """How quickly that changes, rad/s."""
    left_wheel_radius_multiplier: float = 1.0
    """By what the radius is to be corrected, as found by driving straight."""
    right_wheel_radius_multiplier: float = 1.0
    """Likewise."""
    max_wheel_velocity: float = math.inf
    """Of the wheels behind, rad/s."""

    def __post_init__(self) -> None:
        """Refuse what is no base."""
        _check_wheels(self)
        _check("wheelbase", self.wheelbase)
        if not 1e-6 <= self.max_steering_angle <= math.pi / 2 - 1e-6:
            raise ValueError(f"max_steering_angle = {self.max_steering_angle:g}: between 0 and π/2 = 1.57 rad")
        if not self.max_steering_velocity > 0.0:
            raise ValueError(f"max_steering_velocity = {self.max_steering_velocity:g}: more than 0, or inf")

    @property
    def max_curvature(self) -> float:
        """1/m."""
        return math.tan(self.max_steering_angle) / self.wheelbase

    @property
    def min_turning_radius(self) -> float:
        """Of the middle of the rear axle, m."""
        return 1.0 / self.max_curvature

    def limited(self, twist: Twist2) -> Twist2:
        """The curve no tighter than it can steer, then both velocities scaled down until no wheel is too fast.

        0 for what is not finite, and for a turn on the spot.
        """
        if not math.isfinite(twist.linear) or not math.isfinite(twist.angular):
            return STANDING
        if twist.linear == 0.0:
            return Twist2(twist.linear, 0.0)  # which has a sign, too
        curvature = clamp(twist.angular / twist.linear, self.max_curvature)
        twist = Twist2(twist.linear, twist.linear * curvature)
        return _scaled(self._rolling(twist), twist, self.max_wheel_velocity)

    def wheels(self, twist: Twist2, steering: float = 0.0) -> Wheels:
        """What the wheels do for a velocity, or for as much of it as they can; steering is free to be there at once.

        Args:
            twist: what is wanted.
            steering: the present angle, rad, where it stays while the base stands.
        """
        twist = self.limited(twist)
        if twist.linear == 0.0:
            return Wheels(0.0, 0.0, clamp(steering, self.max_steering_angle) if math.isfinite(steering) else 0.0)
        angle = math.atan(self.wheelbase * (twist.angular / twist.linear))
        return self._rolling(twist)._replace(steering=clamp(angle, self.max_steering_angle))

    def twist(self, wheels: Wheels) -> Twist2:
        """How the base moves when its wheels do this: the middle of both, on the curve to which it steers."""
        left, right = _rims(self, wheels)
        linear = (left + right) / 2
        return Twist2(linear, linear * self.curvature(wheels.steering))

    def curvature(self, steering: float) -> float:
        """Of the curve that it drives with this steering, 1/m; what it cannot steer counts as its limit."""
        return math.tan(clamp(steering, self.max_steering_angle)) / self.wheelbase

    def steered(self, present: float, wanted: float, dt: float) -> float:
        """The steering after `dt` s on its way from one angle to another, rad."""
        step = self.max_steering_velocity * dt
        change = clamp(wanted, self.max_steering_angle) - present
        return present + (change if abs(change) <= step else math.copysign(step, change))

    def front_wheels(self, steering: float) -> tuple[float, float]:
        """The angles of the left and the right wheel in front, rad: both are at right angles to the same centre."""
        ahead, aside = self.wheelbase * math.sin(steering), self.wheelbase * math.cos(steering)
        half = math.sin(steering) * self.wheel_separation / 2
        return math.atan2(ahead, aside - half), math.atan2(ahead, aside + half)

    def _rolling(self, twist: Twist2) -> Wheels:
        left, right = _radii(self)
        outward = twist.angular * self.wheel_separation / 2
        return Wheels((twist.linear - outward) / left, (twist.linear + outward) / right)


def _radii(drive: DiffDrive | Ackermann) -> tuple[float, float]:
    """Of the left and the right wheel, as corrected, m."""
    return (
        drive.wheel_radius * drive.left_wheel_radius_multiplier,
        drive.wheel_radius * drive.right_wheel_radius_multiplier,
    )


def _rims(drive: DiffDrive | Ackermann, wheels: Wheels) -> tuple[float, float]:
    """How the left and the right side move over the ground, m/s; or the way, m."""
    left, right = _radii(drive)
    return wheels.left * left, wheels.right * right


def _scaled(wheels: Wheels, twist: Twist2, limit: float) -> Twist2:
    fastest = max(abs(wheels.left), abs(wheels.right))
    if not math.isfinite(wheels.left) or not math.isfinite(wheels.right):
        return STANDING
    return twist if fastest <= limit else Twist2(twist.linear * (limit / fastest), twist.angular * (limit / fastest))


def _check_wheels(drive: DiffDrive | Ackermann) -> None:
    for name in ("wheel_separation", "wheel_radius", "left_wheel_radius_multiplier", "right_wheel_radius_multiplier"):
        _check(name, getattr(drive, name))
    if not drive.max_wheel_velocity > 0.0:
        raise ValueError(f"max_wheel_velocity = {drive.max_wheel_velocity:g}: more than 0, or inf")


def _check(name: str, value: float) -> None:
    if not _LEAST <= value <= _MOST:
        raise ValueError(f"{name} = {value:g}: between {_LEAST:g} and {_MOST:g}")
