"""The ways that a base drives to be calibrated: a straight line, and squares. Pure: no network, no clock."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import msgspec

from robo_services.calibration import Track
from robo_services.kinematics import Twist2
from robo_services.limits import clamp, ramp

STANDS = Twist2(5e-3, 0.03)
"""m and rad: a base that moves by less while it settles stands. A tick of a coarse encoder is about as much."""
SETTLED = 0.5
"""A base that has stood for so long stands still, s."""
STUCK = 5.0
"""A base that has come no further for so long does not move, s."""
SLOWEST = Twist2(0.02, 0.15)
"""m/s and rad/s: slower than this it is not told to drive, for friction would hold it."""
NEAR = Twist2(0.02, 0.05)
"""m and rad: a base that lacks no more and comes no further is there. What it drives is known: no square need be exact.
"""
PUSHED = 0.5
"""After so long without coming further it is there, or is told to go twice as fast as `SLOWEST`, and so on, s."""


class Leg(NamedTuple):
    """A way ahead, or a turn on the spot."""

    way: float = 0.0
    """m."""
    turn: float = 0.0
    """To the left, rad."""


class Speeds(msgspec.Struct, frozen=True, kw_only=True):
    """How it drives."""

    linear: float
    """m/s."""
    angular: float
    """rad/s."""
    linear_acceleration: float
    """m/s²."""
    angular_acceleration: float
    """rad/s²."""


def legs_of(kind: str, length: float, side: float) -> list[Leg]:
    """The legs of a run.

    Args:
        kind: `straight`, or a square to the `left` or `right`.
        length: of the straight line, m.
        side: of the square, m.
    """
    if kind == "straight":
        return [Leg(way=length)]
    return 4 * [Leg(way=side), Leg(turn=math.pi / 2 if kind == "left" else -math.pi / 2)]


class Drive:
    """Drives legs by what odometry says, standing still between them."""

    def __init__(self, legs: Sequence[Leg], speeds: Speeds) -> None:
        self._left = list(legs)
        self._speeds = speeds
        self._begin = (0.0, 0.0)
        self._commanded = Twist2()
        self._best, self._since = math.inf, 0.0
        self._stands_at: tuple[float, float] | None = None
        """Where it began to stand, once it has arrived."""
        self._stood = 0.0

    def is_over(self) -> bool:
        """Whether all legs are driven, and the base stands still."""
        return not self._left

    def is_stuck(self) -> bool:
        """Whether it comes no further, or not to rest."""
        return self._since > STUCK

    def is_settling(self) -> bool:
        """Whether it has driven a leg and is to stand."""
        return self._stands_at is not None

    def command(self, track: Track, dt: float) -> Twist2:
        """What to do now.

        Args:
            track: what odometry has said since the run began.
            dt: since the last call, s.
        """
        if not self._left:
            return Twist2()
        if self._stands_at is not None:
            return self._settle(track, self._stands_at, dt)
        leg = self._left[0]
        rest = leg.way - (track.way - self._begin[0]), leg.turn - (track.turned - self._begin[1])
        gap, size, near = (rest[0], leg.way, NEAR.linear) if leg.way else (rest[1], leg.turn, NEAR.angular)
        self._since = 0.0 if abs(gap) < self._best - 1e-3 else self._since + dt
        self._best = min(self._best, abs(gap)) if not self._since else self._best
        if gap * math.copysign(1.0, size) <= 0.0 or (abs(gap) < near and self._since >= PUSHED):
            self._since, self._stood, self._stands_at = 0.0, 0.0, (track.way, track.turned)
            self._commanded = Twist2()
        else:
            self._commanded = self._towards(leg, gap, dt)
        return self._commanded

    def _settle(self, track: Track, at: tuple[float, float], dt: float) -> Twist2:
        """Stand until it stands still; then comes the next leg.

        Its velocity says nothing of that: one tick to and fro is much of it.
        """
        self._since += dt
        self._stood += dt
        if abs(track.way - at[0]) > STANDS.linear or abs(track.turned - at[1]) > STANDS.angular:
            self._stood, self._stands_at = 0.0, (track.way, track.turned)
        elif self._stood >= SETTLED:
            self._left.pop(0)
            self._begin = track.way, track.turned
            self._since, self._best, self._stands_at = 0.0, math.inf, None
        return Twist2()

    def _towards(self, leg: Leg, gap: float, dt: float) -> Twist2:
        s = self._speeds
        fastest, gains, slowest = (
            (s.linear, s.linear_acceleration, SLOWEST.linear)
            if leg.way
            else (s.angular, s.angular_acceleration, SLOWEST.angular)
        )
        slowest *= 2.0 ** (min(self._since, STUCK) / PUSHED)
        wanted = clamp(math.copysign(max(math.sqrt(2 * gains * abs(gap)) * 0.8, slowest), gap), fastest)
        if leg.way:
            return Twist2(ramp(self._commanded.linear, wanted, dt, gains, 10 * gains), 0.0)
        return Twist2(0.0, ramp(self._commanded.angular, wanted, dt, gains, 10 * gains))
