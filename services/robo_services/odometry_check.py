"""Which odometry can be believed: pure logic, without Zenoh and without a clock.

A position that is not a finite number, or that the base cannot have reached since the last one, is left
out. Neither clock is trusted alone: real logs hold stamps that step back by 2,600 s and on again, and what
comes over a network comes in bursts. A step is possible if either the stamps or the receiver's clock leave
time for it.

A jump may be true all the same: the base was reset, or it drove on unheard. So what is in doubt waits, and
where `AGREEING` messages in a row fit together, they are the truth from there on.
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import msgspec

from robo_messages import Odometry
from robo_services.planar import angle_difference, yaw_from_quaternion

MARGIN = 1.5
"""How much faster than its limits a base may seem: wheels slip, and clocks jitter."""
LEAST = 0.1
"""Stamps and arrivals are good to this time, s: no step is too long for `LEAST` at full speed."""
LONGEST = 10.0
"""Over a longer gap of the stamps, s, a single message is not believed: its stamp may lie."""
AGREEING = 5
"""So many messages that fit to each other are believed, whatever was before."""
MOST_IN_DOUBT = 50
"""After so many in a row that fit to nothing the newest is where it begins anew: nobody stays blind for ever."""


class BaseLimits(msgspec.Struct, frozen=True):
    """What the base can do."""

    max_linear_velocity: float
    """m/s."""
    max_angular_velocity: float
    """rad/s."""


class Fix(NamedTuple):
    """Where the base says that it is."""

    x: float
    """m."""
    y: float
    """m."""
    yaw: float
    """rad."""
    stamp: float
    """When it was there by its own clock, s."""
    arrived: float
    """When that was heard by the receiver's monotonic clock, s."""


class Motion(NamedTuple):
    """A position that is believed."""

    x: float
    """m."""
    y: float
    """m."""
    driven: float
    """The way from the position before, m; 0 where it begins anew."""


class Judged(NamedTuple):
    """What becomes of one message."""

    steps: Sequence[Motion] = ()
    """What is believed now: nothing, the message, or also those that had waited."""
    doubt: str = ""
    """Why the message is not believed, or not yet."""
    jump: float = 0.0
    """How far from the last position it begins anew, m, where it does."""


def fix_of(odometry: Odometry, arrived: float) -> Fix | None:
    """The pose in a message; None if it holds NaN or an infinity."""
    position, turn = odometry.pose.pose.position, odometry.pose.pose.orientation
    if not all(map(math.isfinite, (position.x, position.y, turn.x, turn.y, turn.z, turn.w))):
        return None
    yaw = yaw_from_quaternion(turn)
    # Products of huge components may overflow although each of them is finite.
    return Fix(position.x, position.y, yaw, odometry.header.stamp.to_seconds(), arrived) if yaw == yaw else None


class OdometryTrack:
    """Follows a base from message to message, and leaves out what cannot be."""

    def __init__(self) -> None:
        self.left_out = 0
        """Messages that were not believed, those in doubt at present included."""
        self._last: Fix | None = None
        self._waiting: list[Fix] = []
        self._in_doubt = 0

    def take(self, fix: Fix | None, limits: BaseLimits) -> Judged:
        """Judge the next message.

        Args:
            fix: what it says; None if that is not finite.
            limits: of the base.
        """
        if fix is None:
            self.left_out += 1
            return Judged(doubt="it is not finite")
        if self._last is None:
            return Judged([self._believe(fix, 0.0)])
        if _follows(self._last, fix, limits):
            return Judged([self._believe(fix, _way(self._last, fix))])
        self.left_out += 1
        self._in_doubt += 1
        if self._waiting and not _follows(self._waiting[-1], fix, limits):
            self._waiting.clear()
        self._waiting.append(fix)
        if len(self._waiting) >= AGREEING or self._in_doubt >= MOST_IN_DOUBT:
            return self._begin_anew(self._last, limits)
        return Judged(doubt=_why(self._last, fix, limits))

    def _believe(self, fix: Fix, driven: float) -> Motion:
        self._last = fix
        self._waiting.clear()
        self._in_doubt = 0
        return Motion(fix.x, fix.y, driven)

    def _begin_anew(self, last: Fix, limits: BaseLimits) -> Judged:
        waited = list(self._waiting)
        self.left_out -= len(waited)
        way = _way(last, waited[0])
        drove = _in_reach(last, waited[0], limits, _elapsed(last, waited[0]))
        steps = [self._believe(waited[0], way if drove else 0.0)]
        steps += [self._believe(b, _way(a, b)) for a, b in pairwise(waited)]
        return Judged(steps, jump=0.0 if drove else way)


def _follows(a: Fix, b: Fix, limits: BaseLimits) -> bool:
    """Whether the base can have come from `a` to `b`, as far as one message is believed."""
    by_stamps = b.stamp - a.stamp
    return _in_reach(a, b, limits, max(b.arrived - a.arrived, by_stamps if by_stamps <= LONGEST else 0.0))


def _in_reach(a: Fix, b: Fix, limits: BaseLimits, seconds: float) -> bool:
    time = max(seconds, LEAST) * MARGIN
    turn = abs(angle_difference(b.yaw, a.yaw))
    return _way(a, b) <= limits.max_linear_velocity * time and turn <= limits.max_angular_velocity * time


def _elapsed(a: Fix, b: Fix) -> float:
    return max(b.arrived - a.arrived, b.stamp - a.stamp)


def _way(a: Fix, b: Fix) -> float:
    return math.hypot(b.x - a.x, b.y - a.y)


def _why(a: Fix, b: Fix, limits: BaseLimits) -> str:
    turn = abs(angle_difference(b.yaw, a.yaw))
    return (
        f"{_way(a, b):.4g} m and {turn:.2f} rad in {max(_elapsed(a, b), 0.0):.3f} s, beyond max_linear_velocity = "
        f"{limits.max_linear_velocity:g} m/s or max_angular_velocity = {limits.max_angular_velocity:g} rad/s"
    )
