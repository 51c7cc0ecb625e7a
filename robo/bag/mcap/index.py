"""What is in a file, and where, as its summary says.

Messages stand in blocks: a chunk is one; where a file has none, a run of records is.
"""

from collections.abc import Callable, Iterable
from typing import Final, NamedTuple, TypeVar

import msgspec

from robo.bag.mcap import format as mcap
from robo.bag.mcap.format import Malformed
from robo.bag.mcap.source import Place, Source
from robo.errors import DamagedBag

T = TypeVar("T")

REPEATED: Final = "robo.latched"
"""Metadata behind the first blocks of a file, which say again what latched topics have said in the files before it:
by the number of a channel, how many messages of it."""

COUNTS: Final = "robo.counts"
"""Metadata with exact counts of a file's messages, as JSON by topic."""

MOST_NAMED: Final = 100_000
"""Attachments and metadata of a file that are told of: no more make sense."""

_MOST_FAULTS = 1_000
"""Of a file that are told of."""
_MOST_DEFINITION = 2**22
"""Of a schema, bytes: 4 MB."""
_MOST_SAID = 2**26
"""Of a file's schemas and channels together, bytes: 67 MB. Chunks would unfold to any number of them."""
_WORD = 100
"""What a word of a channel takes beside its letters, bytes."""


class Block(NamedTuple):
    """Records that are read together."""

    place: Place
    """Of a chunk; of a run of records its `kind` is 0, and there is nothing before its content."""
    begin: int
    """Of the arrival times in it, ns."""
    end: int
    channels: frozenset[int] | None
    """Those of its messages; None where that is not known."""


class Index(msgspec.Struct):
    """What is in a file."""

    header: mcap.Header = msgspec.field(default_factory=lambda: mcap.Header("", ""))
    schemas: dict[int, mcap.Schema] = msgspec.field(default_factory=dict)
    channels: dict[int, mcap.Channel] = msgspec.field(default_factory=dict)
    blocks: list[Block] = msgspec.field(default_factory=list)
    """In the order of the file."""
    counts: dict[int, int] = msgspec.field(default_factory=dict)
    """Messages by channel."""
    attachments: list[mcap.AttachmentIndex] = msgspec.field(default_factory=list)
    metadata: list[mcap.MetadataIndex] = msgspec.field(default_factory=list)
    begin: int = 0
    """The first arrival, ns; 0 where there is no message."""
    end: int = 0
    faults: list[DamagedBag] = msgspec.field(default_factory=list)
    """What is wrong with the file; empty for a whole one."""
    summarized: bool = False
    """Whether all this stands in its summary."""
    data_end: int = 0
    """Where the data end that can be read, bytes."""
    only_said: set[tuple[int, int]] = msgspec.field(default_factory=set)
    """Schemas and channels, by what they are and their numbers, that nothing but the summary has said."""
    said: int = 0
    """What schemas and channels take, bytes."""

    @property
    def repeats(self) -> mcap.MetadataIndex | None:
        """What stands behind blocks that say again what files before have said; None where there are none."""
        return next((words for words in self.metadata if words.name == REPEATED), None)

    def add_fault(self, fault: DamagedBag) -> None:
        """Keep what is wrong, unless that is very much."""
        if len(self.faults) < _MOST_FAULTS:
            self.faults.append(fault)

    def learn(self, kind: int, content: bytes | memoryview) -> None:
        """Add a schema or a channel. What the data say takes the place of what only the summary has said.

        Raises:
            Malformed: it makes no sense, another one has its number, or there is too much of them.
        """
        if kind == mcap.SCHEMA:
            if len(content) > _MOST_DEFINITION:
                raise Malformed(f"a schema has {len(content):,} bytes, and at most {_MOST_DEFINITION:,} are read")
            schema = mcap.schema(content)
            self._know(self.schemas, schema.id, schema, (kind, len(content)))
        elif kind == mcap.CHANNEL:
            channel = mcap.channel(content)
            if channel.schema_id and channel.schema_id not in self.schemas and not self.summarized:
                raise Malformed(f"channel {channel.id} has no schema")
            self._know(self.channels, channel.id, channel, (kind, len(content) + _WORD * len(channel.metadata)))
        else:
            raise Malformed(f"a record of kind {kind:#04x} is among messages, where none can be")

    def _know(self, known: dict[int, T], number: int, new: T, what: tuple[int, int]) -> None:
        kind, size = what
        there = known.get(number)
        if there is not None and (kind, number) not in self.only_said:
            if there != new:
                raise Malformed(f"two {'schemas' if kind == mcap.SCHEMA else 'channels'} have the number {number}")
            return
        self.said += size
        if self.said > _MOST_SAID:
            raise Malformed(f"schemas and channels have more than {_MOST_SAID:,} bytes")
        self.only_said.discard((kind, number))
        known[number] = new


def header_of(source: Source) -> mcap.Header:
    """The first record.

    Raises:
        DamagedBag: it is another one.
    """
    place = source.place(len(mcap.MAGIC))
    if place.kind != mcap.HEADER:
        raise source.damaged(place.offset, "there is no header")
    return parsed(source, place, mcap.header)


def parsed(source: Source, place: Place, read: Callable[[bytes], T]) -> T:
    """What a record says.

    Raises:
        DamagedBag: it makes no sense.
    """
    try:
        return read(source.content(place))
    except Malformed as error:
        raise source.damaged(place.offset, str(error)) from None


def footer_at(source: Source) -> int:
    """Where the footer of a whole file stands, bytes."""
    return source.size - len(mcap.MAGIC) - mcap.FOOTER_SIZE


Taken = list[tuple[int, int]]
"""Where what a summary tells of begins and ends, bytes, in their order."""


def from_summary(source: Source) -> Index | None:
    """What is in a file but its header; None where a whole file has no summary, or that does not tell all messages.

    Raises:
        DamagedBag: the file is cut, or its summary makes no sense, or what is beside of what it tells.
    """
    found, taken = summary_of(source)
    return None if found is None or leaves_out(source, found, taken) else found


def summary_of(source: Source) -> tuple[Index | None, Taken]:
    """What the summary says, whether that is all or not; None where a whole file has none, or none of its messages.

    Raises:
        DamagedBag: the file is cut, or its summary makes no sense.
    """
    tail = footer_at(source)
    if tail < len(mcap.MAGIC) or not source.ends:
        raise source.ended(source.size, "it does not end as it should")
    place = source.place(tail)
    if place.kind != mcap.FOOTER:
        raise source.damaged(tail, "there is no footer")
    footer = parsed(source, place, mcap.footer)
    start = footer.summary_start
    if start > tail:
        raise source.damaged(tail, "the footer says that the summary is behind it")
    if footer.crc and source.checksum(start or tail, source.size - len(mcap.MAGIC) - 4) != footer.crc:
        raise source.damaged(start or tail, "the summary has another checksum than it says")
    if not start:
        return None, []
    found = Index(summarized=True, data_end=start)
    statistics, taken = _read_summary(source, start, found)
    if statistics is None or (statistics.messages and not (found.blocks and statistics.counts)):
        return None, []
    counted = sum(statistics.counts.values())
    if counted != statistics.messages:
        text = f"the summary counts {statistics.messages:,} messages, and by their topics {counted:,}"
        raise source.damaged(start, text)
    found.counts = statistics.counts
    found.begin, found.end = (statistics.begin, statistics.end) if statistics.messages else (0, 0)
    _check(source, found, taken)
    return found, taken


def _read_summary(source: Source, start: int, found: Index) -> tuple[mcap.Statistics | None, Taken]:
    statistics = None
    taken: Taken = []
    sets: dict[frozenset[int], frozenset[int]] = {}
    for place in source.places(start, footer_at(source)):
        match place.kind:
            case mcap.SCHEMA | mcap.CHANNEL:
                try:
                    found.learn(place.kind, source.content(place))
                except Malformed as error:
                    raise source.damaged(place.offset, str(error)) from None
            case mcap.CHUNK_INDEX:
                chunk = parsed(source, place, mcap.chunk_index)
                there = frozenset(chunk.channels)
                where = Place(chunk.offset, mcap.CHUNK, chunk.length - mcap.PREFIX.size)
                channels = sets.setdefault(there, there) or None
                found.blocks.append(Block(where, chunk.begin, chunk.end, channels))
                taken.append((chunk.offset, where.end))
                taken.append((where.end, where.end + chunk.message_index_length))
            case mcap.ATTACHMENT_INDEX:
                found.attachments.append(parsed(source, place, mcap.attachment_index))
            case mcap.METADATA_INDEX:
                found.metadata.append(parsed(source, place, mcap.metadata_index))
            case mcap.STATISTICS:
                statistics = parsed(source, place, mcap.statistics)
        if len(found.attachments) + len(found.metadata) > MOST_NAMED:
            raise source.damaged(place.offset, f"there are more than {MOST_NAMED:,} attachments and metadata")
    beside: Iterable[mcap.AttachmentIndex | mcap.MetadataIndex] = (*found.attachments, *found.metadata)
    taken += [(one.offset, one.offset + one.length) for one in beside]
    return statistics, sorted(taken)


def _check(source: Source, found: Index, taken: Taken) -> None:
    """That what it says goes together, and is apart and within the data: else a small file could be read without end.

    Raises:
        DamagedBag: it does not, or is not.
    """
    at = len(mcap.MAGIC)
    for begin, end in taken:
        if begin < at or not begin <= end <= found.data_end:
            raise source.damaged(begin, "the index says that something is here, where it cannot be")
        at = end
    found.blocks.sort(key=lambda block: block.place.offset)
    for block in found.blocks:
        if block.begin > block.end:
            raise source.damaged(block.place.offset, "the index says that a chunk ends before it begins")
    if any(channel.schema_id not in found.schemas for channel in found.channels.values() if channel.schema_id):
        raise source.damaged(found.data_end, "the summary has a channel without its schema")
    if not found.counts.keys() <= found.channels.keys():
        raise source.damaged(found.data_end, "the summary counts messages of a channel that it does not know")


def leaves_out(source: Source, found: Index, taken: Taken) -> bool:
    """Whether messages stand where the summary tells of nothing: outside of chunks, or in one that it leaves out.

    Raises:
        DamagedBag: what stands there makes no sense.
    """
    at = len(mcap.MAGIC)
    for begin, end in [*taken, (found.data_end, found.data_end)]:
        if any(place.kind in (mcap.CHUNK, mcap.MESSAGE) for place in source.places(at, begin)):
            return True
        at = end
    return False
