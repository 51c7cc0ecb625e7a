"""What latched topics have said last, for the beginning of the next file. Pure."""

from collections import OrderedDict, deque
from collections.abc import Hashable, Iterator
from typing import NamedTuple

_MOST_PUBLISHERS = 256
"""Of one topic."""


class Said(NamedTuple):
    """A message, as it was written."""

    channel: int
    sequence: int
    arrived: int
    published: int
    data: bytes


class Kept:
    """The last messages of each publisher of each latched topic."""

    def __init__(self) -> None:
        self._depths: dict[int, int] = {}
        self._said: dict[int, OrderedDict[Hashable, deque[Said]]] = {}

    def begin(self, channel: int, depth: int) -> None:
        """A channel is latched, with the last `depth` messages."""
        self._depths[channel] = max(depth, 1)
        self._said.setdefault(channel, OrderedDict())

    def add(self, said: Said, source: Hashable) -> None:
        """A message of a channel that may be latched."""
        publishers = self._said.get(said.channel)
        if publishers is None:
            return
        last = publishers.get(source)
        if last is None:
            last = publishers[source] = deque(maxlen=self._depths[said.channel])
            if len(publishers) > _MOST_PUBLISHERS:
                publishers.popitem(last=False)
        last.append(said)

    def __contains__(self, channel: int) -> bool:
        return channel in self._said

    def __iter__(self) -> Iterator[Said]:
        """All of it, in the order in which it came."""
        every = [said for of_one in self._said.values() for last in of_one.values() for said in last]
        return iter(sorted(every, key=lambda said: said.arrived))
