"""Who drives by which topic: one viewer at a time, and zeros once nothing is commanded any more. Any thread may ask."""

import threading
from collections import deque

import msgspec

from robo.dashboard.lease import Lease

PAUSE = 1.2
"""A hand that has said nothing for so long has let go, s: viewers have pads that say a command a second."""
ENDED = "an emergency stop has ended this grip: let go for two seconds, then take hold anew"
_MOST_ENDS = 100
"""That are remembered, for grips of which nothing has come yet."""
_FORGET = 60.0
"""So long a grip is remembered of which nothing comes any more, s."""


class _Grip(msgspec.Struct):
    """Commands of a viewer on a topic, without a pause."""

    last: float
    """When the last of them came, s."""
    ended: bool


class Drivers:
    """Knows it of all topics by which viewers drive: the rules are those of the page of `robo dashboard`.

    Times are s, by a clock that never goes back.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._of: dict[str, Lease] = {}
        self._grips: dict[tuple[str, str], _Grip] = {}
        """By key and viewer."""
        self._ends: deque[tuple[str, float]] = deque(maxlen=_MOST_ENDS)
        """Of grips: of which robot, and when."""

    def hold(self, key: str, who: str, said: float, came: float) -> None:
        """A viewer has said that a robot is to move; whether it may or not, somebody holds its pad.

        Args:
            key: of the topic.
            who: the viewer.
            said: when, at the earliest: a link that is held up makes no pause.
            came: when that has come.
        """
        with self._lock:
            grip = self._grips.get((key, who))
            if grip is None or said - grip.last > PAUSE:
                if grip is None:
                    self._grips = {end: one for end, one in self._grips.items() if came - one.last < _FORGET}
                ended = any(_is_of(key, robot) and said <= at for robot, at in self._ends)
                self._grips[key, who] = _Grip(came, ended)
            else:
                grip.last = came

    def command(self, key: str, who: str, now: float) -> str:
        """A viewer wants a robot to move.

        Args:
            key: of the topic.
            who: the viewer.
            now: what time it is.

        Returns:
            Why it may not; empty where it may.
        """
        with self._lock:
            grip = self._grips.get((key, who))
            if grip is not None and grip.ended:
                return ENDED
            lease = self._of.setdefault(key, Lease())
            return "" if lease.command(who, now) else f"{lease.driver} drives"

    def end(self, robot: str, now: float) -> None:
        """Nobody's grip on a robot counts any more, and it is told to stand: of an emergency stop, and its reset.

        Args:
            robot: its namespace; all topics below it are meant.
            now: what time it is.
        """
        with self._lock:
            self._ends.append((robot, now))
            for (key, _), grip in self._grips.items():
                grip.ended |= _is_of(key, robot)
            for key, lease in self._of.items():
                if _is_of(key, robot):
                    lease.end()

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


def _is_of(key: str, robot: str) -> bool:
    return not robot or key.startswith(f"{robot}/")
