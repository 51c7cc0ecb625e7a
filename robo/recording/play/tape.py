"""A recording as it is played: its messages as robo's, ready to be published, in order, with what was said before."""

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import robo_messages
from robo.bag.read.reader import Bag, Order
from robo.bag.read.topics import BagMessage, last_of_each
from robo.errors import BagError, UsageError
from robo.recording.play.playback import Item
from robo.recording.play.topics import Played
from robo_messages import TFMessage

_MOST_PARTS = 64
"""Publishers of static transforms that are told apart."""
_LONGEST = 1e9
"""Of a recording, s: 30 years."""


class Ready(NamedTuple):
    """A message as it is published."""

    number: int
    """Of its topic among those that are played."""
    part: int
    """By which of several publishers of the topic: what each has said last is latched."""
    payload: bytes


class Converter:
    """Makes robo's messages of recorded ones."""

    def __init__(self, played: Sequence[Played]) -> None:
        self._numbers = {played_topic.topic.name: number for number, played_topic in enumerate(played)}
        self._played = played
        self._parts: dict[int, dict[frozenset[str], int]] = {}
        self.unreadable: Counter[str] = Counter()
        """Messages by topic that are none of their type: they are left out."""
        self.reason = ""
        """Why the first of them is none."""

    def ready(self, message: BagMessage) -> Ready | None:
        """A message as it is published; None where it cannot be read."""
        number = self._numbers[message.topic.name]
        if self._played[number].encoding:
            return Ready(number, 0, message.data)
        try:
            value = message.value
        except BagError as error:
            self.unreadable[message.topic.name] += 1
            self.reason = self.reason or str(error)
            return None
        assert not isinstance(value, bytes)
        part = self._part(number, value) if isinstance(value, TFMessage) and self._played[number].qos.latched else 0
        return Ready(number, part, robo_messages.encode(value))

    def _part(self, number: int, value: TFMessage) -> int:
        """Static transforms come from several nodes, each of which says its own frames.

        Whoever comes later wants them all. Other latched topics have one publisher: of several that follow one another,
        what a former one said is old.
        """
        parts = self._parts.setdefault(number, {})
        frames = frozenset(one.child_frame_id for one in value.transforms)
        return parts.setdefault(frames, min(len(parts), _MOST_PARTS - 1))


class Window(NamedTuple):
    """Which part of a recording is played, s from its beginning."""

    start: float = 0.0
    end: float | None = None
    duration: float | None = None
    """From the start on."""

    def check(self) -> None:
        """Refuse what is no time.

        Raises:
            UsageError: tells which.
        """
        for name, value in self._asdict().items():
            if value is not None and not 0 <= value <= _LONGEST:  # NaN too
                raise UsageError(f"--{name} {value:g}: write seconds from the beginning of the recording")


class BagTape:
    """A recording, or a part of it. Only one thread at a time reads."""

    def __init__(
        self, bag: Bag, played: Sequence[Played], order: Order = "arrived", window: Window | None = None
    ) -> None:
        """
        Args:
            bag: open, as long as this is used.
            played: which of its topics.
            order: by which time they are due.
            window: which part; by default all of it.

        Raises:
            UsageError: nothing is in this part.
            DamagedBag: by publish times: a part of the file is damaged.
        """
        self._bag = bag
        self._names = [one.topic.name for one in played]
        self._latched = [one.topic for one in played if one.topic.qos.latched]
        self._order: Order = order
        self.converter = Converter(played)
        window = window or Window()
        window.check()
        self.first, last = self._span()
        """When the recording begins, ns since the epoch."""
        self.begin = self.first + round(window.start * 1e9)
        ends = [last]
        ends += [self.first + round(window.end * 1e9)] if window.end is not None else []
        ends += [self.begin + round(window.duration * 1e9)] if window.duration is not None else []
        self.end = min(ends)
        if self.begin > last:
            length = (last - self.first) * 1e-9
            raise UsageError(f"it cannot start at {window.start:g} s: the recording has {length:g} s")
        if self.end < self.begin:
            raise UsageError(f"nothing is between the start at {window.start:g} s and the end at {window.end:g} s")

    def run(self, at: int) -> Iterator[Item[Ready]]:
        """What latched topics had said last before a time, then all messages from it on.

        Raises:
            DamagedBag: while messages are read: a part of the file is damaged.
        """
        ready = self.converter.ready
        for message in self._said_before(at):
            if (made := ready(message)) is not None:
                yield Item(at, True, made)
        by_arrival = self._order == "arrived"
        for message in self._bag.messages(self._names, at, self.end + 1, self._order):
            if (made := ready(message)) is not None:
                yield Item(message.arrived if by_arrival else message.published, False, made)

    def _said_before(self, at: int) -> list[BagMessage]:
        if at <= self.first and self._order == "arrived":
            return []
        said: list[BagMessage] = []
        for topic in self._latched:
            messages = self._bag.messages(topic.name, None, at, self._order)
            said += last_of_each(messages, max(topic.qos.depth, 1))
        return sorted(said, key=lambda message: message.arrived)

    def _span(self) -> tuple[int, int]:
        """The first and the last time that counts.

        What is latched was published long before: it is no beginning.
        """
        if self._order == "arrived":
            return self._bag.begin, self._bag.end
        latched = {topic.name for topic in self._latched}
        first = [2**64, 2**64]
        last = 0
        for message in self._bag.messages(self._names):
            which = message.topic.name in latched
            first[which] = min(first[which], message.published)
            last = max(last, message.published)
        return (first[0] if first[0] < 2**64 else min(first[1], last)), last
