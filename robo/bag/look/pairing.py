"""The messages of two recordings side by side, topic by topic, while each is read once. Pure but for the reading.

The first message of a topic in one stands beside its first in the other, and so on. Both are read as their times go,
so that little waits for its fellow. Topics of which much would wait, because the other recording has them at another
time, are left: whoever pairs reads those by themselves.
"""

from collections import deque
from collections.abc import Collection, Iterable, Iterator
from typing import Final, NamedTuple

from robo.bag.read.topics import BagMessage

MOST_WAITING: Final = 2**26
"""Of messages that wait for their fellows, bytes: 67 MB."""
_MESSAGE_SIZE = 300
"""Of one that waits, beside its data, bytes."""


class Pair(NamedTuple):
    """Two messages of one topic, with the same number in each recording."""

    topic: str
    number: int
    """From 0."""
    first: BagMessage
    second: BagMessage


class Pairing:
    """Pairs the messages of two recordings."""

    def __init__(self, topics: Collection[str], most: int = MOST_WAITING) -> None:
        """`topics` are in both; at most so many bytes wait."""
        self.counts = {topic: [0, 0] for topic in topics}
        """Messages of each topic in each recording, so far."""
        self.left: set[str] = set()
        """Topics that are to be read by themselves: what was told of them does not count."""
        self._most = most
        self._waiting: dict[str, deque[BagMessage]] = {topic: deque() for topic in topics}
        self._sizes = dict.fromkeys(topics, 0)
        self._size = 0

    def pairs(
        self, first: Iterable[BagMessage], second: Iterable[BagMessage], begins: tuple[int, int]
    ) -> Iterator[Pair]:
        """Pairs in the order of times.

        Args:
            first, second: messages of the topics, in the order of their arrivals.
            begins: the first arrival in each, ns.
        """
        streams = iter(first), iter(second)
        heads: list[BagMessage | None] = [next(streams[0], None), next(streams[1], None)]
        while (side := _next_side(heads, begins)) is not None:
            message = heads[side]
            assert message is not None
            found = self._take(message, side)
            if found is not None:
                yield found
            heads[side] = next(streams[side], None)

    def _take(self, message: BagMessage, side: int) -> Pair | None:
        name = message.topic.name
        if name in self.left:
            return None
        counts = self.counts[name]
        index = counts[side]
        counts[side] += 1
        waiting = self._waiting[name]
        if index >= counts[1 - side]:
            waiting.append(message)
            self._count(name, len(message.data) + _MESSAGE_SIZE)
            while self._size > self._most:
                self._leave_one()
            return None
        fellow = waiting.popleft()
        self._count(name, -len(fellow.data) - _MESSAGE_SIZE)
        return Pair(name, index, *((message, fellow) if side == 0 else (fellow, message)))

    def _count(self, topic: str, size: int) -> None:
        self._sizes[topic] += size
        self._size += size

    def _leave_one(self) -> None:
        """Leave the topic of which most waits."""
        most = max(self._sizes, key=self._sizes.__getitem__)
        self._size -= self._sizes.pop(most)
        del self._waiting[most], self.counts[most]
        self.left.add(most)


def _next_side(heads: list[BagMessage | None], begins: tuple[int, int]) -> int | None:
    """Which recording goes on: the one that is behind; None where both are over."""
    first, second = heads
    if first is None or second is None:
        return 0 if first is not None else 1 if second is not None else None
    return 0 if first.arrived - begins[0] <= second.arrived - begins[1] else 1
