"""Where a recording that is played has come to, and when what is in it is due. Pure: whoever asks says what time it is.

Times of the recording are ns since the epoch, those of the clock ns since an arbitrary start. When something is due is
reckoned from one moment at which both were known, not from what came before it: nothing adds up to a drift.
"""

import math

from robo.errors import UsageError

SLOWEST = 1e-6
"""A lower rate is a pause."""
FASTEST = 1e6
"""A higher rate is as fast as nothing is lost: 0."""
SLOWEST_CLOCK = 0.1
"""How often the time is told at least, Hz."""


def check_rate(rate: float) -> float:
    """A rate if it makes sense.

    Raises:
        UsageError: it does not.
    """
    if rate and not SLOWEST <= rate <= FASTEST:  # NaN too
        raise UsageError(
            f"rate {rate:g}: use 1 for as recorded, 2 for twice as fast, 0 for as fast as nothing is lost; else "
            f"{SLOWEST:g} to {FASTEST:g}"
        )
    return rate


def check_clock_rate(rate: float | None) -> None:
    """Refuse what is no number of times a second at which to tell the time; None for never.

    Raises:
        UsageError: tells which are.
    """
    if rate is not None and not SLOWEST_CLOCK <= rate <= 1000.0:  # NaN too
        raise UsageError(f"clock rate {rate:g}: use {SLOWEST_CLOCK:g} to 1000 Hz")


class Timeline:
    """The time of a recording, which goes on, stands, jumps, and is quicker or slower."""

    def __init__(self, at: int, now: int, rate: float = 1.0, *, paused: bool = False) -> None:
        """
        Args:
            at: where in the recording it begins.
            now: the clock's time.
            rate: how many times as fast as recorded; 0 for as fast as it goes.
            paused: whether it stands.

        Raises:
            UsageError: the rate makes no sense.
        """
        self._at, self._now = at, now
        self._rate = check_rate(rate)
        self._paused = paused

    @property
    def rate(self) -> float:
        """How many times as fast as recorded; 0 for as fast as it goes."""
        return self._rate

    @property
    def paused(self) -> bool:
        """Whether it stands."""
        return self._paused

    def at(self, now: int) -> int:
        """Where in the recording it is."""
        if self._paused or not self._rate:
            return self._at
        return self._at + max(int((now - self._now) * self._rate), 0)

    def due(self, time: int) -> int | None:
        """When a time of the recording has come, by the clock; None as long as it stands."""
        if self._paused:
            return None
        if not self._rate:
            return self._now
        return self._now + math.ceil((time - self._at) / self._rate)

    def pause(self, at: int, now: int) -> None:
        """Stand, at a time of the recording."""
        self._at, self._now, self._paused = at, now, True

    def resume(self, now: int) -> None:
        """Go on from where it stands."""
        if self._paused:
            self._now, self._paused = now, False

    def change_rate(self, rate: float, at: int, now: int) -> None:
        """Be quicker or slower from a time of the recording on.

        Raises:
            UsageError: the rate makes no sense.
        """
        self._rate = check_rate(rate)
        self._at, self._now = at, now

    def jump(self, at: int, now: int) -> None:
        """Be at another time of the recording."""
        self._at, self._now = at, now

    def reach(self, at: int) -> None:
        """Be at least at a time of the recording, where no clock takes it there."""
        if self._paused or not self._rate:
            self._at = max(self._at, at)

    def put_off(self, by: int) -> None:
        """Let everything be due so much later, ns: whoever plays stood still meanwhile."""
        self._now += by
