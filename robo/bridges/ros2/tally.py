"""What has crossed, what was lost, and what does not fit: counted by topic, told once. Any thread may ask."""

import threading
import time
from collections.abc import Callable
from typing import Literal

import msgspec

from robo.text.brief import brief

Way = Literal["to_ros", "from_ros"]
_MOST = 2_000
"""Topics and faults that are remembered."""
_MOST_TEXT = 500


class Count(msgspec.Struct):
    """Of a topic or a service, in one direction."""

    key: str
    """In robo."""
    name: str
    """In ROS."""
    way: Way
    crossed: int = 0
    dropped: int = 0
    """Lost before they came to the bridge, by their numbers, or because it was too slow."""
    refused: int = 0
    """No messages of their type, without an attachment, of a second source that commands, or that had come before."""
    rate: float = 0.0
    """Messages a second, of late."""


class Tally:
    """All counts and faults."""

    def __init__(self, tell: Callable[[str], None]) -> None:
        """`tell` gets each fault once, in a sentence."""
        self._tell = tell
        self._lock = threading.Lock()
        self._counts: dict[tuple[str, str], Count] = {}
        self._faults: dict[str, str] = {}
        self._before: dict[tuple[str, str], int] = {}
        self._looked = time.monotonic()

    def of(self, key: str, name: str, way: Way) -> Count:
        """The count of a topic; one that is too many is counted with `others`."""
        which = (way, key)
        with self._lock:
            if which not in self._counts and len(self._counts) >= _MOST:
                which, key, name = (way, "others"), "others", "others"
            found = self._counts.get(which)
            if found is None:
                found = self._counts[which] = Count(key, name, way)
            return found

    def fault(self, what: str, text: str) -> None:
        """Something is wrong with a topic, a service or a type: told once as long as it is so.

        Args:
            what: with which.
            text: what is wrong.
        """
        text = brief(text, _MOST_TEXT)
        with self._lock:
            if self._faults.get(what) == text or (what not in self._faults and len(self._faults) >= _MOST):
                return
            self._faults[what] = text
        self._tell(text)

    def mend(self, what: str) -> None:
        """It is wrong no more."""
        with self._lock:
            self._faults.pop(what, None)

    def look(self) -> list[Count]:
        """All counts with the rates since the last look, sorted by direction and key."""
        now = time.monotonic()
        with self._lock:
            seconds, self._looked = max(now - self._looked, 1e-3), now
            for which, count in self._counts.items():
                count.rate = (count.crossed - self._before.get(which, 0)) / seconds
                self._before[which] = count.crossed
            return [msgspec.structs.replace(self._counts[which]) for which in sorted(self._counts)]

    def faults(self) -> list[str]:
        """What is wrong now."""
        with self._lock:
            return [self._faults[what] for what in sorted(self._faults)]
