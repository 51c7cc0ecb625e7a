"""A clock that nobody sets, for what is kept around a moment."""

import time
from collections.abc import Callable

_LEAST = 1_000_000
"""Of less two clocks that go alike may be apart, as they are not read at once, ns."""


class SteadyClock:
    """The time of day as it was when this began, and on from there evenly, whatever is done to the machine's clock."""

    def __init__(self, wall: Callable[[], int] = time.time_ns, steady: Callable[[], int] = time.monotonic_ns) -> None:
        """Both tell ns: the machine's clock, and how much time has passed."""
        self._wall, self._steady = wall, steady
        self._begin = wall() - steady()

    def now(self) -> int:
        """Ns since the epoch."""
        return self._begin + self._steady()

    def behind(self) -> int:
        """By how much the machine's clock has been set forward since, ns; below 0 where it was set back."""
        found = self._wall() - self.now()
        return found if abs(found) >= _LEAST else 0
