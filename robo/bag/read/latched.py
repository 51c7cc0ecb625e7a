"""What latched topics had said last at a time, as far as a recording tells their publishers apart. Pure."""

from collections import deque
from collections.abc import Hashable, Iterable
from typing import Final

import msgspec

from robo.bag.read.topics import BagMessage, Topic
from robo.errors import BagError
from robo_messages import TFMessage

_MOST_PUBLISHERS = 256
"""Of a topic that are told apart."""
_MOST: Final = 2**27
"""Of what one topic had said, bytes: 134 MB; the oldest goes first."""
_AT_ONCE = 5 * 10**9
"""A recorder has heard within this time what was said before it began, ns."""


def last_said(messages: Iterable[BagMessage], begin: int) -> list[BagMessage]:
    """Of what latched topics have said: the last messages of each publisher, as many as it keeps.

    A recording does not name publishers. Those of static transforms are told apart by their frames, others by their
    sequence numbers; where nobody counts, each one that was announced has its share. Where that does not tell them
    apart, there is one more rather than one less: what is latched and missing is missed.

    Args:
        messages: of latched topics, in their order, from the beginning of the recording on.
        begin: when that began, ns since the epoch.

    Returns:
        Some of the messages, in the same order.
    """
    topics: dict[Topic, _Said] = {}
    for number, message in enumerate(messages):
        said = topics.get(message.topic)
        if said is None:
            said = topics[message.topic] = _Said(message.topic, begin)
        said.add(number, message)
    return [message for _, message in sorted(one for said in topics.values() for one in said.left())]


class _Series(msgspec.Struct):
    """What one publisher has said."""

    key: Hashable
    said: deque[tuple[int, BagMessage]]
    """With the places among all messages."""


class _Said:
    """What counts of one topic."""

    def __init__(self, topic: Topic, begin: int) -> None:
        self._depth = topic.qos.depth or None
        self._publishers = topic.publishers
        self._begin = begin
        self._series: list[_Series] = []
        self._size = 0

    def add(self, number: int, message: BagMessage) -> None:
        """The next message."""
        key = _key(message)
        series = self._of(key, message)
        if series is None:
            depth = self._depth
            if depth is not None and key is _NOBODY_COUNTS:
                depth *= self._publishers
            series = _Series(key, deque(maxlen=depth))
            self._series.append(series)
            if len(self._series) > _MOST_PUBLISHERS:
                self._size -= sum(len(one.data) for _, one in self._series.pop(0).said)
        if len(series.said) == series.said.maxlen:
            self._size -= len(series.said[0][1].data)
        series.said.append((number, message))
        self._size += len(message.data)
        while self._size > _MOST and (len(self._series) > 1 or len(series.said) > 1):
            self._forget_oldest()

    def left(self) -> Iterable[tuple[int, BagMessage]]:
        """What counts, with its places among all messages."""
        return (one for series in self._series for one in series.said)

    def _of(self, key: Hashable, message: BagMessage) -> _Series | None:
        """The series that a message continues."""
        if key is not None:
            return next((one for one in self._series if one.key == key), None)
        if message.published < self._begin and message.arrived - self._begin < _AT_ONCE:
            return None  # said before the recording began: its publisher's word, whatever number others have come to
        before = (message.sequence - 1) % 2**32
        fitting = [one for one in self._series if one.key is None and one.said[-1][1].sequence == before]
        return fitting[0] if len(fitting) == 1 else None

    def _forget_oldest(self) -> None:
        oldest = min(self._series, key=lambda one: one.said[0][0])
        self._size -= len(oldest.said.popleft()[1].data)
        if not oldest.said:
            self._series.remove(oldest)


_NOBODY_COUNTS = object()


def _key(message: BagMessage) -> Hashable:
    """By what the publisher of a message is told from others; None where its number is to do it."""
    known = message.topic.known
    if known is not None and known.name == "tf2/TFMessage":
        try:
            value = message.value
        except BagError:
            value = b""
        if isinstance(value, TFMessage):
            return frozenset(one.child_frame_id for one in value.transforms)
    return _NOBODY_COUNTS if not message.sequence else None
