"""Where a base is by the ticks that its board counts: wrap-around, a board that begins anew, lines that were garbled.

Counts are absolute: a reading that is lost loses no tick, the next one holds it. What comes has no checksum. So a
reading that goes on as the wheels went is taken; of any other the board is asked again, and two that agree are
believed: either the wheels were jolted, or, where no wheel can have got there or both count from 0 again, the board has
begun anew. After a silence the nearer of the two is believed: a board that was without power counts from 0, and a hand
may have turned the wheels since. Then the pose stays, what was driven meanwhile is not known, and the covariance says
so. Pure: no port, no clock.
"""

import math
from collections import deque
from typing import Literal, NamedTuple

from robo_messages import Header, Odometry
from robo_services.arduino_protocol import Encoders
from robo_services.drives import DiffDrive, Wheels
from robo_services.kinematics import Twist2
from robo_services.uncertainty import NOISE, Noise
from robo_services.wheel_odometry import LEAST, MARGIN, WheelOdometry, odometry_message, twist_variances

WINDOW = 0.1
"""Velocities are those over this time, s: readings come late by some ms, which in one step would be much of it."""
SOON = 0.02
"""What the board says when it is asked again comes about so soon, s."""
STALE = 0.5
"""A speed says nothing of what comes so much later, s."""
CLOSE = 0.1
"""What a wheel does is foreseen for no longer than this, s."""
SWIFTEST = 100.0
"""How a wheel's speed changes that nobody has jolted, rad/s²."""
SWIFT = 40.0
"""Likewise, where it may as well be that the board has begun anew, rad/s²."""
JITTER = 0.01
"""A reading is late by up to this, s."""
FEW = 3.0
"""Ticks that nobody wonders about."""
COASTING = 0.3
"""For so long a wheel may go on as it did while its board begins anew, s."""
MOST_UNSEEN = 1.0
"""In a longer silence a wheel is believed to have turned as far as it can in this time, s, and no further."""

Verdict = Literal["begins", "moves", "asks", "reset"]
"""The first reading; one that is taken; one of which the board is to be asked again; the board has begun anew."""


class _Moment(NamedTuple):
    time: float
    left: float
    """ticks, counted on through wraps and resets."""
    right: float


class TickOdometry:
    """Follows a base by its board's counters."""

    def __init__(self, drive: DiffDrive, per_revolution: float, *, bits: int = 32, noise: Noise = NOISE) -> None:
        """
        Args:
            drive: the wheels; none of them turns faster than its `max_wheel_velocity`.
            per_revolution: ticks of a revolution of the wheel.
            bits: of a counter; then it wraps around.
            noise: how the base errs.
        """
        self.resets = 0
        """How often the board has begun anew, or was another one."""
        self.refused = 0
        """Readings that were not true."""
        self._drive, self._per_revolution, self._wrap = drive, per_revolution, 2**bits
        self._most = self.max_rate * 0.999  # no further than WheelOdometry believes
        self._track = WheelOdometry(drive, noise, slack=1.001 * FEW / self.per_radian)
        self._last: Encoders | None = None
        self._suspect: tuple[Encoders, float] | None = None
        self._moments: deque[_Moment] = deque()

    @property
    def per_radian(self) -> float:
        """Ticks per rad of a wheel."""
        return self._per_revolution / math.tau

    @property
    def max_rate(self) -> float:
        """Ticks per s of a wheel: none turns faster."""
        return self._drive.max_wheel_velocity * self.per_radian

    @property
    def track(self) -> WheelOdometry:
        """Pose and covariance."""
        return self._track

    @property
    def turned(self) -> Wheels:
        """How far the wheels have turned in all, rad."""
        if not self._moments:
            return Wheels(0.0, 0.0)
        _, left, right = self._moments[-1]
        return Wheels(left / self.per_radian, right / self.per_radian)

    @property
    def rates(self) -> Wheels:
        """How fast the wheels turn, rad/s."""
        left, right, _ = self._ticks_per_second()
        return Wheels(left / self.per_radian, right / self.per_radian)

    def take(self, reading: Encoders, time: float) -> Verdict:
        """Move on to a reading.

        Args:
            reading: ticks.
            time: when it came, s.
        """
        if not -self._wrap // 2 <= min(reading) <= max(reading) < self._wrap // 2:
            self.refused += 1  # no counter of so many bits says that
            return "asks"
        if self._last is None:
            self._begin(reading, time)
            return "begins"
        elapsed = time - self._moments[-1].time
        if self._is_expected(reading, elapsed):
            self.refused += self._suspect is not None
            self._move(reading, time)
            return "moves"
        suspect, self._suspect = self._suspect, (reading, time)
        if suspect is None:
            return "asks"
        if not self.is_near(suspect[0], reading, time - suspect[1], least=SOON):
            self.refused += 1
            return "asks"
        self._suspect = None
        if self.is_near(self._last, reading, elapsed) and not self._counts_anew(reading, elapsed):
            self._move(reading, time)
            return "moves"
        self.resets += 1
        self._lose(reading, time)
        return "reset"

    def message(self, header: Header, base_frame: str) -> Odometry:
        """What it has found so far.

        Args:
            header: when the last reading came, and the frame of the pose.
            base_frame: the frame of the velocities.
        """
        twist, window = self._twist()
        track = self._track
        variances = twist_variances(twist, track.noise, window)
        return odometry_message(header, base_frame, track.pose, twist, track.covariance, variances)

    def _twist(self) -> tuple[Twist2, float]:
        """How the base moves, and over which time that was measured, s."""
        left, right, window = self._ticks_per_second()
        return self._drive.twist(Wheels(left / self.per_radian, right / self.per_radian)), max(window, JITTER)

    def _ticks_per_second(self) -> tuple[float, float, float]:
        """Of both wheels, and over which time, s."""
        if len(self._moments) < 2:
            return 0.0, 0.0, 0.0
        first, last = self._moments[0], self._moments[-1]
        elapsed = last.time - first.time
        if elapsed < JITTER:
            return 0.0, 0.0, 0.0
        return (last.left - first.left) / elapsed, (last.right - first.right) / elapsed, elapsed

    def _is_expected(self, reading: Encoders, elapsed: float) -> bool:
        """Whether the wheels went on as they did, or a little faster or slower."""
        assert self._last is not None
        if not self.is_near(self._last, reading, elapsed):
            return False
        anew = self._counts_anew(reading, elapsed)
        if not 0.0 <= elapsed <= CLOSE:
            return not anew
        change = (SWIFT if anew else SWIFTEST) * self.per_radian * elapsed
        return all(
            abs(way - rate * elapsed) <= change * (elapsed + WINDOW / 2) + abs(rate) * JITTER + FEW
            for way, rate in zip(self._ways(self._last, reading), self._ticks_per_second()[:2], strict=True)
        )

    def is_near(self, before: Encoders, reading: Encoders, elapsed: float, *, least: float = LEAST) -> bool:
        """Whether wheels can turn so far in this time; stamps are good to `least` s."""
        furthest = self._most * MARGIN * min(max(elapsed, least), MOST_UNSEEN)
        furthest = max(min(furthest, self._wrap / 4), FEW)
        return all(abs(way) <= furthest for way in self._ways(before, reading))

    def _counts_anew(self, reading: Encoders, elapsed: float) -> bool:
        """Whether a board that counts from 0 would say that, rather than one that goes on."""
        assert self._last is not None
        if sum(map(abs, reading)) >= sum(map(abs, self._ways(self._last, reading))):
            return False
        if elapsed > STALE:
            return True  # how fast they were says nothing of how far they were turned since
        rates = self._ticks_per_second()[:2]
        return all(abs(count) <= FEW + COASTING * abs(rate) for count, rate in zip(reading, rates, strict=True))

    def _ways(self, before: Encoders, reading: Encoders) -> tuple[float, float]:
        half = self._wrap // 2
        left, right = ((new - old + half) % self._wrap - half for old, new in zip(before, reading, strict=True))
        return float(left), float(right)

    def _begin(self, reading: Encoders, time: float) -> None:
        self._last = reading
        self._moments.append(_Moment(time, 0.0, 0.0))
        self._track.take_positions([0.0], [0.0], time)

    def _move(self, reading: Encoders, time: float) -> None:
        assert self._last is not None
        before = self._moments[-1]
        left, right = self._ways(self._last, reading)
        self._last, self._suspect = reading, None
        self._note(_Moment(time, before.left + left, before.right + right))
        self._roll(time)

    def _lose(self, reading: Encoders, time: float) -> None:
        """Count on from another number; how far the wheels have turned meanwhile nobody knows."""
        before = self._moments[-1]
        self._last = reading
        self._track.begin_anew()
        self._roll(time)
        self._moments.clear()
        self._moments.append(before._replace(time=time))

    def _roll(self, time: float) -> None:
        left, right, _ = self.turned
        self._track.take_positions([left], [right], time)

    def _note(self, moment: _Moment) -> None:
        """Remember it, and what is needed to say how fast the wheels turn."""
        moments = self._moments
        if moment.time < moments[-1].time or moment.time - moments[-1].time > STALE:
            moments.clear()
        moments.append(moment)
        while len(moments) > 2 and moment.time - moments[1].time >= WINDOW - JITTER / 2:
            moments.popleft()
