"""A recording as it is played: its messages as robo's, ready to be published, in order, with what was said before."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import robo_messages
from robo.bag.moments import moment
from robo.bag.read.latched import last_said
from robo.bag.read.reader import Bag, Order
from robo.bag.read.topics import BagMessage
from robo.errors import BagError, UsageError
from robo.recording.play.ahead import Wanted
from robo.recording.play.playback import Item
from robo.recording.play.topics import Played
from robo.text.dates import date
from robo_messages import TFMessage

_MOST_PARTS = 64
"""Publishers of static transforms that are told apart."""
_LOOK = 1_000
"""Messages from one look whether they are wanted to the next."""
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
        self._parts: dict[int, list[frozenset[str]]] = {}
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
        parts = self._parts.setdefault(number, [])
        frames = frozenset(one.child_frame_id for one in value.transforms)
        # A node says all that it has said so far once more, with what is new.
        part = next((part for part, known in enumerate(parts) if known <= frames), len(parts))
        if part == len(parts) < _MOST_PARTS:
            parts.append(frames)
        elif part < len(parts):
            parts[part] = frames
        return min(part, _MOST_PARTS - 1)


class Window(NamedTuple):
    """Which part of a recording is played: times as `moment` has them."""

    start: str = ""
    """From then on; empty for the beginning."""
    end: str = ""
    """Before then; empty for the end."""
    duration: float | None = None
    """From the start on, s."""

    def of(self, first: int, last: int) -> tuple[int, int]:
        """From when on, and before when.

        Args:
            first: when the recording begins, ns since the epoch.
            last: the time of its last message.

        Raises:
            UsageError: one of them is no time, or nothing is between them.
        """
        begin = max(moment(self.start, first, last, "--start"), first) if self.start else first
        until = moment(self.end, first, last, "--end") if self.end else last + 1
        if self.duration is not None:
            if not 0 < self.duration <= _LONGEST:  # NaN too
                raise UsageError(f"--duration {self.duration:g}: write seconds")
            until = min(until, begin + max(round(self.duration * 1e9), 1))
        if begin > last or until <= first:
            word, text = ("--start", self.start) if begin > last else ("--end", self.end)
            there = f"it begins {date(first)} and lasts {(last - first) * 1e-9:g} s"
            raise UsageError(f"nothing is there {'after' if begin > last else 'before'} {word} {text}: {there}")
        if until <= begin:
            raise UsageError(f"--end {self.end} is not after --start {self.start}")
        return begin, min(until, last + 1)


class BagTape:
    """A recording, or a part of it. Only one thread at a time reads."""

    def __init__(
        self, bag: Bag, played: Sequence[Played], order: Order = "arrived", window: Window | None = None
    ) -> None:
        """
        Args:
            bag: open, as long as this is used.
            played: which of its topics.
            order: by which time they are due, and what `window` means; a message of which nobody says when it was
                published counts as published when it came.
            window: which part; by default all of it.

        Raises:
            UsageError: a time is none, or no message is in this part.
            DamagedBag: by publish times: a part of the file is damaged.
        """
        self._bag = bag
        self._names = [one.topic.name for one in played]
        self._latched = [one.topic for one in played if one.topic.qos.latched]
        self._order: Order = order
        self.converter = Converter(played)
        self.first, last = self._span()
        """When the recording begins, ns since the epoch."""
        self.begin, self.until = (window or Window()).of(self.first, last)
        """From when on it is played, and before when, ns since the epoch."""
        self.end = min(self.until, last)
        """Where it ends for whoever looks, ns since the epoch."""

    def run(self, at: int, wanted: Wanted = lambda: True) -> Iterator[Item[Ready]]:
        """What latched topics had said last before a time, then all messages from it on, as long as they are wanted.

        Raises:
            DamagedBag: while messages are read: a part of the file is damaged.
        """
        ready = self.converter.ready
        for message in self._said_before(at, wanted):
            if (made := ready(message)) is not None:
                yield Item(at, True, made)
        time_of = _arrived if self._order == "arrived" else _published
        for message in self._bag.messages(self._names, at, self.until, self._order):
            if (made := ready(message)) is not None:
                yield Item(time_of(message), False, made)

    def _said_before(self, at: int, wanted: Wanted) -> list[BagMessage]:
        if at <= self.first and self._order == "arrived":
            return []
        latched = [topic.name for topic in self._latched]
        if not latched:
            return []
        messages = _as_long_as(wanted, self._bag.messages(latched, None, at, self._order))
        return last_said(messages, self._bag.begin)

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
            time = _published(message)
            first[which] = min(first[which], time)
            last = max(last, time)
        return (first[0] if first[0] < 2**64 else min(first[1], last)), last


def _arrived(message: BagMessage) -> int:
    return message.arrived


def _published(message: BagMessage) -> int:
    return message.published or message.arrived


def _as_long_as(wanted: Wanted, messages: Iterable[BagMessage]) -> Iterator[BagMessage]:
    for number, message in enumerate(messages):
        if number % _LOOK == 0 and not wanted():
            return
        yield message
