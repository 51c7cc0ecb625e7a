"""How much strangers may take up of a server: connections that say nothing, and requests without end. Pure."""

from collections.abc import Hashable
from typing import Generic, TypeVar

H = TypeVar("H", bound=Hashable)


class WaitingRoom(Generic[H]):
    """Who has come and not been let in yet: when it is full whoever has waited longest goes."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._waiting: dict[H, None] = {}

    def enter(self, who: H) -> H | None:
        """Somebody comes. Returns who has to go for that."""
        self._waiting[who] = None
        if len(self._waiting) <= self._most:
            return None
        oldest = next(iter(self._waiting))
        del self._waiting[oldest]
        return oldest

    def leave(self, who: H) -> None:
        """Somebody is let in, or gone."""
        self._waiting.pop(who, None)


class Budget:
    """How many requests somebody may make: so many at once, and so many a second."""

    def __init__(self, at_once: float, rate: float) -> None:
        """
        Args:
            at_once: requests.
            rate: 1/s.
        """
        self._most = self._left = at_once
        self._rate = rate
        self._seen: float | None = None

    def take(self, now: float) -> bool:
        """Make one; whether that is within the budget.

        Args:
            now: s, by a clock that never goes back.
        """
        if self._seen is not None:
            self._left = min(self._most, self._left + (now - self._seen) * self._rate)
        self._seen = now
        self._left -= 1
        return self._left >= 0
