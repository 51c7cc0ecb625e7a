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
    """The last messages of each publisher of each latched topic. A topic whose quality of service changes has several
    channels: what is said on one takes the place of what was said on the others.
    """

    def __init__(self) -> None:
        self._latched: dict[int, tuple[str, int]] = {}
        """By channel the topic, and how many messages of a publisher are kept."""
        self._said: dict[str, OrderedDict[Hashable, deque[Said]]] = {}

    def begin(self, channel: int, topic: str, depth: int) -> None:
        """A channel is latched, with the last `depth` messages."""
        self._latched[channel] = topic, max(depth, 1)

    def add(self, said: Said, source: Hashable) -> None:
        """A message of a channel that may be latched."""
        latched = self._latched.get(said.channel)
        if latched is None:
            return
        topic, depth = latched
        publishers = self._said.setdefault(topic, OrderedDict())
        last = publishers.get(source)
        if last is None or last.maxlen != depth:
            last = publishers[source] = deque(last or (), maxlen=depth)
            if len(publishers) > _MOST_PUBLISHERS:
                publishers.popitem(last=False)
        last.append(said)

    def forget(self, topic: str, source: Hashable) -> None:
        """What a publisher has said holds no more."""
        self._said.get(topic, OrderedDict()).pop(source, None)

    def forget_topic(self, topic: str) -> None:
        """A topic is latched no more."""
        self._said.pop(topic, None)

    def __contains__(self, channel: int) -> bool:
        return channel in self._latched

    def __iter__(self) -> Iterator[Said]:
        """All of it, in the order in which it came."""
        every = [said for of_one in self._said.values() for last in of_one.values() for said in last]
        return iter(sorted(every, key=lambda said: said.arrived))
