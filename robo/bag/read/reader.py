"""Reading recordings: their topics, and their messages, lazily, in the order of their times."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from types import TracebackType
from typing import Any, Literal

from robo.bag.mcap.format import Attachment, Malformed, Metadata, Row, rows
from robo.bag.mcap.index import COUNTS, REPEATED
from robo.bag.read.files import Files
from robo.bag.read.latched import last_said
from robo.bag.read.order import Data, Span, in_order
from robo.bag.read.topics import BagMessage, ChannelOf, Topic, own_name, topics_of
from robo.bag.types import Find
from robo.errors import BagError, DamagedBag
from robo.text.suggestions import suggest

Order = Literal["arrived", "published"]
"""By which time."""


class Bag:
    """A recording: one file, or the files of a folder as one. Also a context manager that closes it."""

    def __init__(self, path: str, files: Files, find: Find) -> None:
        """
        Args:
            path: what it is called in messages.
            files: of the recording; they are closed with it.
            find: types by their names in ROS.
        """
        self.path = path
        self.files = files
        self._by_channel: dict[ChannelOf, Topic] = {}
        self.topics: dict[str, Topic] = {}
        """By name."""
        try:
            for topic in topics_of(files.indexes, files.counts, find):
                self.topics[topic.name] = topic
                self._by_channel.update(dict.fromkeys(topic.channels, topic))
        except BaseException:
            files.close()
            raise
        spans = [Span(index.begin, index.end) for index in files.indexes if any(index.counts.values())]
        self.begin = min((span.begin for span in spans), default=0)
        """The first arrival, ns since the epoch; 0 where there is no message."""
        self.end = max((span.end for span in spans), default=0)
        """The last arrival, ns since the epoch."""
        self.count = sum(topic.count for topic in self.topics.values())
        """Of all messages."""
        self._published: list[Span] | None = None

    @property
    def faults(self) -> list[DamagedBag]:
        """What is wrong with its files; what can be read of them is there all the same."""
        return [*self.files.faults, *(fault for index in self.files.indexes for fault in index.faults)]

    @property
    def duration(self) -> float:
        """From the first arrival to the last, s."""
        return (self.end - self.begin) * 1e-9

    def topic(self, name: str) -> Topic:
        """The topic of a name, with or without a leading slash.

        Raises:
            BagError: there is none; names what comes close.
        """
        found = self.topics.get(name) or self.topics.get(own_name(name))
        if found is None:
            raise BagError(f"it has no topic {name}; {suggest(name, self.topics, 'it has')}", self.path)
        return found

    def messages(
        self,
        topics: str | Iterable[str] | None = None,
        begin: int | None = None,
        end: int | None = None,
        order: Order = "arrived",
    ) -> Iterator[BagMessage]:
        """Messages in the order of their times, one after another; those of one time in the order of the file.

        Args:
            topics: one or several; None for all.
            begin: from this time on, ns since the epoch.
            end: before this time, ns since the epoch.
            order: by which time: of arrival, or of publishing, where that is said. By the latter, the recording is
                read twice.

        Raises:
            BagError: it has no such topic.
            DamagedBag: while messages are read: a part of the file is damaged.
        """
        names = [topics] if isinstance(topics, str) else topics
        wanted = None if names is None else {channel for name in names for channel in self.topic(name).channels}
        return self._messages(wanted, begin, end, order)

    def _messages(
        self, wanted: set[ChannelOf] | None, begin: int | None, end: int | None, order: Order
    ) -> Iterator[BagMessage]:
        time_of = _TIMES[order]
        least, most = begin if begin is not None else 0, end if end is not None else 2**64
        blocks = _Selection(self.files, self._spans(order), (self._by_channel, wanted), least, most)
        is_bounded = begin is not None or end is not None

        def is_wanted(number: int, row: Row) -> bool:
            yes = blocks.channels[number].get(row.channel)
            if yes is None:
                raise Malformed(f"a message is of channel {row.channel}, which the file does not know, or not here")
            arrived = blocks.arrived[number]
            if not arrived.begin <= row.arrived <= arrived.end:
                raise Malformed(f"a message came at {row.arrived} ns, and its chunk says that none did then")
            return yes and (not is_bounded or least <= time_of(row) < most)

        count = 0
        for number, row, data in in_order(blocks, is_wanted, time_of):
            topic = self._by_channel[blocks.file(number), row.channel]
            count += 1
            yield BagMessage(topic, row.arrived, row.published, row.sequence, bytes(data[row.begin : row.end]))
        if not is_bounded and count < (said := self._said(wanted)):
            raise DamagedBag(
                f"its index leaves out {said - count:,} messages; `robo bag recover` makes a whole file of what can be "
                "read", self.path)  # fmt: skip

    def _said(self, wanted: set[ChannelOf] | None) -> int:
        """How many messages of channels there are, as its files say."""
        return sum(
            count
            for file, counts in enumerate(self.files.counts)
            for channel, count in counts.items()
            if wanted is None or (file, channel) in wanted
        )

    def in_file_order(self) -> Iterator[BagMessage]:
        """All messages as they stand in the files, whatever their times.

        Raises:
            DamagedBag: while messages are read: a part of a file is damaged.
        """
        for number in range(len(self.files.spans)):
            file, _ = self.files.block(number)
            data = self.files.data(number)
            try:
                for row in rows(data):
                    topic = self._by_channel.get((file, row.channel))
                    if topic is None:
                        raise Malformed(f"a message is of channel {row.channel}, which the file does not know")
                    yield BagMessage(topic, row.arrived, row.published, row.sequence, bytes(data[row.begin : row.end]))
            except Malformed as error:
                raise self.files.damaged(number, str(error)) from None

    def latched(self, at: int) -> list[BagMessage]:
        """What latched topics had said last at a time, as a subscription that begins then would get it.

        Args:
            at: arrivals before it count, ns since the epoch.
        """
        wanted = {channel for topic in self.topics.values() if topic.qos.latched for channel in topic.channels}
        return last_said(self._messages(wanted, None, at, "arrived"), self.begin) if wanted else []

    def column(self, topic: str, field: str, order: Order = "arrived") -> Any:
        """One field of all messages of a topic: an array where numpy is installed, else a list.

        Args:
            topic: its name.
            field: `pose.pose.position.x`; `ranges.0` is the first of a list.
            order: of the messages.

        Raises:
            BagError: there is no such topic or field, or the topic's type is not known.
        """
        found = self.topic(topic)
        if found.known is None:
            raise BagError(f"{found.name} has no fields that can be read: {found.unknown}", self.path)
        steps = field.split(".")
        return _array([_walk(message.value, steps, found) for message in self.messages(found.name, order=order)])

    def times(self, topic: str, order: Order = "arrived") -> Any:
        """Arrival or publish times of all messages of a topic, ns: an array where numpy is installed, else a list."""
        return _array([getattr(message, order) for message in self.messages(topic, order=order)])

    @property
    def metadata(self) -> dict[str, dict[str, str]]:
        """Words about the recording, by name; those of later files hold.

        Raises:
            DamagedBag: they cannot be read.
        """
        return {words.name: words.words for words in self.all_metadata() if words.name not in (REPEATED, COUNTS)}

    def all_metadata(self) -> Iterator[Metadata]:
        """All words about the recording, as they stand in its files.

        Raises:
            DamagedBag: they cannot be read.
        """
        for number, index in enumerate(self.files.indexes):
            for where in index.metadata:
                yield self.files.metadata(number, where)

    @property
    def attachments(self) -> dict[str, int]:
        """Files within the recording, with their sizes in bytes."""
        return {where.name: where.size for index in self.files.indexes for where in index.attachments}

    def attachment(self, name: str) -> bytes:
        """A file within the recording; of several of one name the last.

        Raises:
            BagError: there is none.
            DamagedBag: it cannot be read.
        """
        for found in self.all_attachments(name):
            return found.data
        raise BagError(f"it has no attachment {name}; {suggest(name, self.attachments, 'it has')}", self.path)

    def all_attachments(self, name: str | None = None, *, newest_first: bool = True) -> Iterator[Attachment]:
        """All files within the recording, one at a time, the last first; or those of a name.

        Raises:
            DamagedBag: one cannot be read, or is too large for that.
        """
        every = [(number, where) for number, index in enumerate(self.files.indexes) for where in index.attachments]
        for number, where in reversed(every) if newest_first else every:
            if name is None or where.name == name:
                yield self.files.source(number).attachment(where.offset)

    def close(self) -> None:
        """Close its files."""
        self.files.close()

    def __enter__(self) -> "Bag":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _spans(self, order: Order) -> list[Span]:
        if order == "arrived":
            return self.files.spans
        if self._published is None:
            self._published = [self._published_span(number) for number in range(len(self.files.spans))]
        return self._published

    def _published_span(self, number: int) -> Span:
        data = self.files.data(number)
        try:
            times = [_published(row) for row in rows(data)]
        except Malformed as error:
            raise self.files.damaged(number, str(error)) from None
        return Span(min(times, default=0), max(times, default=0))


def _published(row: Row) -> int:
    """When a message was published; where nobody says so, when it came."""
    return row.published or row.arrived


_TIMES: dict[Order, Callable[[Row], int]] = {"arrived": lambda row: row.arrived, "published": _published}


class _Selection:
    """The blocks of files in which messages may be that somebody wants."""

    def __init__(
        self,
        files: Files,
        spans: Sequence[Span],
        channels: tuple[Mapping[ChannelOf, Topic], set[ChannelOf] | None],
        least: int,
        most: int,
    ) -> None:
        known, wanted = channels
        self._files = files
        self._numbers = [
            number for number, span in enumerate(spans)
            if span.end >= least and span.begin < most and (wanted is None or _may_have(files, number, wanted))
        ]  # fmt: skip
        self.spans = [spans[number] for number in self._numbers]
        self.arrived = [files.spans[number] for number in self._numbers]
        """From when to when the messages of each came."""
        self._file = [files.block(number)[0] for number in self._numbers]
        of_files: dict[int, dict[int, bool]] = {}
        for file, channel in known:
            of_files.setdefault(file, {})[channel] = wanted is None or (file, channel) in wanted
        same: dict[tuple[int, frozenset[int] | None], dict[int, bool]] = {}
        self.channels: list[dict[int, bool]] = []
        """Those that each may have, and whether they are wanted."""
        for number in self._numbers:
            file, block = files.block(number)
            of_file = of_files.get(file, {})
            here = same.get((file, block.channels))
            if here is None:
                here = of_file if block.channels is None else {c: of_file[c] for c in block.channels if c in of_file}
                same[file, block.channels] = here
            self.channels.append(here)

    def file(self, number: int) -> int:
        """The file of a block."""
        return self._file[number]

    def data(self, number: int) -> Data:
        """The records of a block."""
        return self._files.data(self._numbers[number])

    def damaged(self, number: int, reason: str) -> DamagedBag:
        """An error of a block."""
        return self._files.damaged(self._numbers[number], reason)


def _may_have(files: Files, number: int, wanted: set[ChannelOf]) -> bool:
    file, block = files.block(number)
    return block.channels is None or any((file, channel) in wanted for channel in block.channels)


def _walk(value: Any, steps: Sequence[str], topic: Topic) -> Any:
    for step in steps:
        try:
            value = value[int(step)] if step.isdecimal() else getattr(value, step)
        except (AttributeError, IndexError, TypeError):
            fields = getattr(value, "__struct_fields__", ())
            there = f"{suggest(step, fields, 'there are')}" if fields else "it has no fields, or not so many"
            raise BagError(f"{topic.name}: a {topic.type} has no {'.'.join(steps)}; at {step}: {there}") from None
    return value


def _array(values: list[Any]) -> Any:
    try:
        import numpy as np
    except ModuleNotFoundError:
        return values
    return np.array(values)
