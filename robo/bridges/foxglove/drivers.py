"""Who drives by which topic: one viewer at a time, and zeros once nothing is commanded any more. Any thread may ask."""

import threading

from robo.dashboard.lease import Lease


class Drivers:
    """Knows it of all topics by which viewers drive: the rules are those of the page of `robo dashboard`."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._of: dict[str, Lease] = {}

    def command(self, key: str, who: str, now: float) -> str:
        """A viewer wants a robot to move.

        Args:
            key: of the topic.
            who: the viewer.
            now: s, by a clock that never goes back.

        Returns:
            Who drives it instead; empty where it may.
        """
        with self._lock:
            lease = self._of.setdefault(key, Lease())
            return "" if lease.command(who, now) else lease.driver or ""

    def is_to_stand(self, key: str, who: str, now: float) -> bool:
        """Whether a viewer that has driven is to send a zero now: asked some twenty times a second."""
        with self._lock:
            lease = self._of.get(key)
            return lease is not None and lease.driver in (who, None) and lease.is_to_stand(now)

    def is_over(self, key: str, who: str) -> bool:
        """Whether nothing is to be sent any more for a viewer: another one drives, or all zeros are sent."""
        with self._lock:
            lease = self._of.get(key)
            return lease is None or lease.driver not in (who, None) or lease.stands

    def leave(self, key: str, who: str) -> None:
        """A viewer drives there no more."""
        with self._lock:
            if (lease := self._of.get(key)) is not None:
                lease.give(who)

    def forget(self, key: str) -> None:
        """Nothing of a topic that nobody drives has to be known."""
        with self._lock:
            lease = self._of.get(key)
            if lease is not None and lease.driver is None and lease.stands:
                del self._of[key]
