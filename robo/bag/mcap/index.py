"""What is in a file, and where: from its summary, or by looking at all of it where there is none.

Messages stand in blocks: a chunk is one; where a file has none, a run of records is.
"""

from collections.abc import Callable
from typing import Final, NamedTuple, TypeVar

import msgspec

from robo.bag.mcap import format as mcap
from robo.bag.mcap.format import Malformed
from robo.bag.mcap.source import Place, Source
from robo.bag.progress import Tell, silent
from robo.errors import BagError, DamagedBag

T = TypeVar("T")

REPEATED: Final = "robo.latched"
"""Metadata behind the first blocks of a file, which say again what latched topics have said in the files before it:
by the number of a channel, how many messages of it."""

COUNTS: Final = "robo.counts"
"""Metadata with exact counts of a file's messages, as JSON by topic."""

_RUN = 2**20
"""Of records outside of chunks, that are a block together, bytes."""

_MOST_NAMED = 100_000
"""Attachments and metadata of a file that are told of: no more make sense."""

_MOST_FAULTS = 1_000
"""Of a file that are told of."""


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

    @property
    def repeats(self) -> mcap.MetadataIndex | None:
        """What stands behind blocks that say again what files before have said; None where there are none."""
        return next((words for words in self.metadata if words.name == REPEATED), None)

    def add_fault(self, fault: DamagedBag) -> None:
        """Keep what is wrong, unless that is very much."""
        if len(self.faults) < _MOST_FAULTS:
            self.faults.append(fault)


def index_of(source: Source) -> Index:
    """What is in a file; one that is cut or damaged tells what can be read of it, and its faults.

    Raises:
        DamagedBag: it has not even a header.
        BagError: it cannot be read.
    """
    try:
        found = _from_summary(source)
    except DamagedBag as fault:
        found = scanned(source)
        if not found.faults:  # else they say the same, and better
            found.add_fault(fault)
    return found if found is not None else scanned(source)


def _header(source: Source) -> mcap.Header:
    place = source.place(len(mcap.MAGIC))
    if place.kind != mcap.HEADER:
        raise source.damaged(place.offset, "there is no header")
    return _parse(source, place, mcap.header)


def _parse(source: Source, place: Place, read: Callable[[bytes], T]) -> T:
    try:
        return read(source.content(place))
    except Malformed as error:
        raise source.damaged(place.offset, str(error)) from None


def _from_summary(source: Source) -> Index | None:
    """As the summary says; None where a whole file has none, or none of its messages.

    Raises:
        DamagedBag: the file is cut, or its summary makes no sense.
    """
    found = Index(header=_header(source), summarized=True)
    tail = source.size - len(mcap.MAGIC) - mcap.FOOTER_SIZE
    if tail < len(mcap.MAGIC) or not source.ends:
        raise source.ended(source.size, "it does not end as it should")
    place = source.place(tail)
    if place.kind != mcap.FOOTER:
        raise source.damaged(tail, "there is no footer")
    footer = _parse(source, place, mcap.footer)
    if not footer.summary_start:
        return None
    if footer.summary_start > tail:
        raise source.damaged(tail, "the footer says that the summary is behind it")
    found.data_end = footer.summary_start
    statistics = _read_summary(source, footer.summary_start, found)
    if statistics is None or (statistics.messages and not found.blocks):
        return None
    found.counts = statistics.counts
    found.begin, found.end = (statistics.begin, statistics.end) if statistics.messages else (0, 0)
    _check(source, found)
    return found


def _read_summary(source: Source, start: int, found: Index) -> mcap.Statistics | None:
    statistics = None
    sets: dict[frozenset[int], frozenset[int]] = {}
    for place in source.places(start):
        match place.kind:
            case mcap.SCHEMA:
                schema = _parse(source, place, mcap.schema)
                found.schemas[schema.id] = schema
            case mcap.CHANNEL:
                channel = _parse(source, place, mcap.channel)
                found.channels[channel.id] = channel
            case mcap.CHUNK_INDEX:
                chunk = _parse(source, place, mcap.chunk_index)
                there = frozenset(chunk.channels)
                where = Place(chunk.offset, mcap.CHUNK, chunk.length - mcap.PREFIX.size)
                channels = sets.setdefault(there, there) or None
                found.blocks.append(Block(where, chunk.begin, chunk.end, channels))
            case mcap.ATTACHMENT_INDEX:
                found.attachments.append(_parse(source, place, mcap.attachment_index))
            case mcap.METADATA_INDEX:
                found.metadata.append(_parse(source, place, mcap.metadata_index))
            case mcap.STATISTICS:
                statistics = _parse(source, place, mcap.statistics)
        if len(found.attachments) + len(found.metadata) > _MOST_NAMED:
            raise source.damaged(place.offset, f"there are more than {_MOST_NAMED:,} attachments and metadata")
    return statistics


def _check(source: Source, found: Index) -> None:
    """That blocks are apart, and within the data: else a small file could be read without end.

    Raises:
        DamagedBag: they are not.
    """
    found.blocks.sort(key=lambda block: block.place.offset)
    at = len(mcap.MAGIC)
    for block in found.blocks:
        if block.place.offset < at or block.place.length < 0 or block.place.end > found.data_end:
            raise source.damaged(block.place.offset, "the index says that a chunk is here, where none can be")
        if block.begin > block.end:
            raise source.damaged(block.place.offset, "the index says that a chunk ends before it begins")
        at = block.place.end
    if any(channel.schema_id not in found.schemas for channel in found.channels.values() if channel.schema_id):
        raise source.damaged(found.data_end, "the summary has a channel without its schema")
    if not found.counts.keys() <= found.channels.keys():
        raise source.damaged(found.data_end, "the summary counts messages of a channel that it does not know")


def scanned(source: Source, tell: Tell = silent) -> Index:
    """What is in a file, by looking at all of it; `tell` is told how far that is, in bytes.

    Of its summary it takes only what helps behind a place that cannot be read: where chunks are, and of what topics.

    Raises:
        DamagedBag: it has not even a header.
        BagError: its compression cannot be read here.
    """
    found = Index(header=_header(source))
    said = _said_by_summary(source)
    found.schemas, found.channels = dict(said.schemas), dict(said.channels)
    scan = _Scan(source, found)
    offset = len(mcap.MAGIC)
    while True:
        try:
            for place in source.places(offset):
                scan.take(place)
                offset = place.end
                tell(offset, source.size)
            break
        except DamagedBag as fault:
            found.add_fault(fault)
            offset = next((block.place.offset for block in said.blocks if block.place.offset > offset), 0)
            if not offset:
                break
    scan.end_run()
    if not found.faults and not source.ends:
        found.add_fault(source.ended(source.size, "it does not end as it should"))
    blocks = [block for block in found.blocks if block.begin <= block.end]
    found.begin = min((block.begin for block in blocks), default=0)
    found.end = max((block.end for block in blocks), default=0)
    return found


def _said_by_summary(source: Source) -> Index:
    """What the summary says; nothing where that cannot be read."""
    try:
        return _from_summary(source) or Index()
    except BagError:
        return Index()


def read_block(data: bytes | memoryview, found: Index) -> tuple[dict[int, int], int, int]:
    """How many messages of each channel are in a block, and their first and last arrival, ns.

    What it says of schemas and channels is added to `found`.

    Raises:
        Malformed: its records make no sense.
    """
    counts: dict[int, int] = {}
    begin, end = 2**64, -1
    for row in mcap.rows(data, lambda kind, content: learn(found, kind, content)):
        if row.channel not in found.channels:
            raise Malformed(f"a message is of channel {row.channel}, of which nothing was said before")
        counts[row.channel] = counts.get(row.channel, 0) + 1
        begin, end = min(begin, row.arrived), max(end, row.arrived)
    return counts, begin, end


def learn(found: Index, kind: int, content: memoryview) -> None:
    """Add a schema or a channel to what is known of a file.

    Raises:
        Malformed: it makes no sense, or another one has its number.
    """
    if kind == mcap.SCHEMA:
        schema = mcap.schema(content)
        if found.schemas.setdefault(schema.id, schema) != schema:
            raise Malformed(f"two schemas have the number {schema.id}")
    elif kind == mcap.CHANNEL:
        channel = mcap.channel(content)
        if channel.schema_id and channel.schema_id not in found.schemas:
            raise Malformed(f"channel {channel.id} has no schema")
        if found.channels.setdefault(channel.id, channel) != channel:
            raise Malformed(f"two channels have the number {channel.id}")


class _Scan:
    """Takes the records of a file, one after another."""

    def __init__(self, source: Source, found: Index) -> None:
        self._source = source
        self._found = found
        self._run: Place | None = None
        self._sets: dict[frozenset[int], frozenset[int]] = {}

    def take(self, place: Place) -> None:
        """One more record; what is wrong within it is a fault of the index."""
        found, source = self._found, self._source
        try:
            match place.kind:
                case mcap.CHUNK:
                    self.end_run()
                    self._add(place, source.restored(place, source.chunk(place)))
                case mcap.MESSAGE | mcap.SCHEMA | mcap.CHANNEL:
                    self._extend_run(place)
                case mcap.ATTACHMENT:
                    self._take_attachment(place)
                case mcap.METADATA:
                    words = _parse(source, place, mcap.metadata)
                    if len(found.metadata) < _MOST_NAMED:
                        found.metadata.append(mcap.MetadataIndex(place.offset, place.end - place.offset, words.name))
        except DamagedBag as fault:
            found.add_fault(fault)
        found.data_end = place.offset if place.kind in (mcap.DATA_END, mcap.FOOTER) else place.end

    def end_run(self) -> None:
        """The records so far are a block, if there are any."""
        run, self._run = self._run, None
        if run is not None:
            try:
                self._add(run, self._source.content(run))
            except DamagedBag as fault:
                self._found.add_fault(fault)

    def _extend_run(self, place: Place) -> None:
        run = self._run
        if run is not None and (run.end != place.offset or run.length + place.length > _RUN):
            self.end_run()
            run = None
        begin = run.content if run is not None else place.offset
        self._run = Place(begin - mcap.PREFIX.size, 0, place.end - begin)

    def _add(self, place: Place, data: bytes | memoryview) -> None:
        try:
            counts, begin, end = read_block(data, self._found)
        except Malformed as error:
            raise self._source.damaged(place.offset, str(error)) from None
        there = frozenset(counts)
        if counts:
            self._found.blocks.append(Block(place, begin, end, self._sets.setdefault(there, there)))
        for channel, count in counts.items():
            self._found.counts[channel] = self._found.counts.get(channel, 0) + count

    def _take_attachment(self, place: Place) -> None:
        head = self._source.read(place.content, min(place.length, 2**16))
        cursor = mcap.Cursor(head, "attachment")
        try:
            times = cursor.number(8), cursor.number(8)
            names = cursor.text(), cursor.text()
            size = cursor.number(8)
        except Malformed as error:
            raise self._source.damaged(place.offset, str(error)) from None
        if len(self._found.attachments) < _MOST_NAMED:
            self._found.attachments.append(
                mcap.AttachmentIndex(place.offset, place.end - place.offset, *times, size, *names)
            )
