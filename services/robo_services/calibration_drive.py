"""The ways that a base drives to be calibrated: a straight line, and squares. Pure: no network, no clock."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import msgspec

from robo_services.calibration import Track
from robo_services.kinematics import Twist2
from robo_services.limits import clamp, ramp

STANDS = 5e-3
"""m/s and rad/s: a base that is slower stands."""
SETTLED = 0.5
"""A base that has stood for so long stands still, s."""
STUCK = 5.0
"""A base that has come no further for so long does not move, s."""
SLOWEST = 0.02
"""m/s and rad/s: slower than this it is not told to drive, for friction would hold it."""


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
        self._stood = 0.0
        self._best, self._since = math.inf, 0.0
        self._arrived = False

    def is_over(self) -> bool:
        """Whether all legs are driven, and the base stands still."""
        return not self._left

    def is_stuck(self) -> bool:
        """Whether it comes no further."""
        return self._since > STUCK

    def command(self, track: Track, moving: Twist2, dt: float) -> Twist2:
        """What to do now.

        Args:
            track: what odometry has said since the run began.
            moving: how the base moves by its odometry.
            dt: since the last call, s.
        """
        if not self._left:
            return Twist2()
        leg = self._left[0]
        rest = leg.way - (track.way - self._begin[0]), leg.turn - (track.turned - self._begin[1])
        gap, size = (rest[0], leg.way) if leg.way else (rest[1], leg.turn)
        if not self._arrived and gap * math.copysign(1.0, size) <= SLOWEST * dt:
            self._arrived = True
        if self._arrived:
            return self._settle(track, moving, dt)
        self._since = 0.0 if abs(gap) < self._best - 1e-3 else self._since + dt
        self._best = min(self._best, abs(gap)) if not self._since else self._best
        self._commanded = self._towards(leg, gap, dt)
        return self._commanded

    def _settle(self, track: Track, moving: Twist2, dt: float) -> Twist2:
        """Stand until it stands still; then comes the next leg."""
        self._commanded = Twist2()
        stands = abs(moving.linear) < STANDS and abs(moving.angular) < STANDS
        self._stood = self._stood + dt if stands else 0.0
        self._since += dt
        if self._stood >= SETTLED:
            self._left.pop(0)
            self._begin = track.way, track.turned
            self._stood, self._since, self._best, self._arrived = 0.0, 0.0, math.inf, False
        return Twist2()

    def _towards(self, leg: Leg, gap: float, dt: float) -> Twist2:
        s = self._speeds
        fastest, gains = (s.linear, s.linear_acceleration) if leg.way else (s.angular, s.angular_acceleration)
        wanted = clamp(math.copysign(max(math.sqrt(2 * gains * abs(gap)) * 0.8, SLOWEST), gap), fastest)
        if leg.way:
            return Twist2(ramp(self._commanded.linear, wanted, dt, gains, 10 * gains), 0.0)
        return Twist2(0.0, ramp(self._commanded.angular, wanted, dt, gains, 10 * gains))
