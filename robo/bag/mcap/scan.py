"""What is in a file, by looking at all of it: where it has no summary, is cut or damaged, or is to be checked."""

from bisect import bisect_right
from collections.abc import Iterator
from typing import Final

from robo.bag.mcap import format as mcap
from robo.bag.mcap.format import Malformed
from robo.bag.mcap.index import (
    MOST_NAMED,
    Block,
    Index,
    footer_at,
    from_summary,
    header_of,
    leaves_out,
    parsed,
    summary_of,
)
from robo.bag.mcap.source import Place, Source
from robo.bag.progress import Tell, silent
from robo.errors import BagError, DamagedBag

_RUN = 2**20
"""Of records outside of chunks, that are a block together, bytes."""

_IN_DATA: Final = (
    mcap.SCHEMA, mcap.CHANNEL, mcap.MESSAGE, mcap.CHUNK, mcap.MESSAGE_INDEX, mcap.ATTACHMENT, mcap.METADATA,
)  # fmt: skip
"""What stands before the summary."""
_PRIVATE = 0x80
"""From here on records are what somebody else wants them to be."""


def index_of(source: Source) -> Index:
    """What is in a file; one that is cut or damaged tells what can be read of it, and its faults.

    Raises:
        DamagedBag: it has not even a header.
        BagError: it cannot be read.
    """
    try:
        found = from_summary(source)
        if found is not None:
            found.header = header_of(source)
    except DamagedBag as fault:
        found = scanned(source)
        if not found.faults:  # else they say the same, and better
            found.add_fault(fault)
    return found if found is not None else scanned(source)


def scanned(source: Source, tell: Tell = silent) -> Index:
    """What is in a file, by looking at all of it; `tell` is told how far that is, in bytes.

    Of its summary it takes only what helps behind a place that cannot be read: where chunks are, and of what topics.
    What the summary tells of and is not there is a fault, too.

    Raises:
        DamagedBag: it has not even a header.
        BagError: its compression cannot be read here.
    """
    said = _said_by_summary(source)
    found = Index(schemas=dict(said.schemas), channels=dict(said.channels))
    found.only_said = {(mcap.SCHEMA, number) for number in said.schemas}
    found.only_said |= {(mcap.CHANNEL, number) for number in said.channels}
    scan = _Scan(source, found)
    try:
        found.header = header_of(source)
    except DamagedBag as fault:
        if not said.blocks:
            found.header = _header_of_another_kind(source, fault)
        scan.fault(fault)
    for place in _places(source, said, scan):
        scan.take(place)
        tell(place.end, source.size)
    scan.end_run()
    if scan.unreadable is not None and not found.blocks:
        raise scan.unreadable
    for offset in _offsets(said):
        if offset not in scan.seen:
            scan.fault(source.damaged(offset, "the summary says that something is here, and there is nothing of it"))
    if not found.faults and not source.ends:
        scan.fault(source.ended(source.size, "it does not end as it should"))
    blocks = [block for block in found.blocks if block.begin <= block.end]
    found.begin = min((block.begin for block in blocks), default=0)
    found.end = max((block.end for block in blocks), default=0)
    return found


def _said_by_summary(source: Source) -> Index:
    """What the summary says; nothing where that cannot be read, or does not tell all messages."""
    try:
        found, taken = summary_of(source)
    except BagError:
        return Index()
    try:
        return Index() if found is None or leaves_out(source, found, taken) else found
    except DamagedBag:
        return found if found is not None else Index()  # the fault is that of the data beside


def _offsets(said: Index) -> list[int]:
    """Where the summary says that chunks, attachments and metadata are."""
    found = [block.place.offset for block in said.blocks]
    found += [one.offset for one in said.attachments]
    return sorted(found + [one.offset for one in said.metadata])


def _header_of_another_kind(source: Source, fault: DamagedBag) -> mcap.Header:
    """What the first record says as a header, though it claims to be another one.

    Raises:
        DamagedBag: it is none.
    """
    try:
        return mcap.header(source.content(source.place(len(mcap.MAGIC))))
    except (Malformed, DamagedBag):
        raise fault from None


def _places(source: Source, said: Index, scan: "_Scan") -> Iterator[Place]:
    """The records of the data, one after another.

    Behind one that cannot be, it goes on with the next one, if one stands there, else where the summary says that one
    is.
    """
    there = _offsets(said)
    offset = len(mcap.MAGIC)
    while not said.data_end or offset < said.data_end:
        known = bisect_right(there, offset)
        behind = 0
        try:
            place = source.place(offset)
            if known < len(there) and place.end > there[known]:
                raise source.damaged(offset, f"a record claims {place.length:,} bytes, and another one begins before")
            if _is_end(source, place, scan):
                return
            behind = place.end
            if offset > len(mcap.MAGIC):
                _check(source, place, said)
        except DamagedBag as fault:
            scan.fault(fault)
            if not behind or not _is_record(source, behind):
                if known == len(there):
                    return
                behind = there[known]
        else:
            if offset > len(mcap.MAGIC):
                yield place
        offset = behind
    scan.fault(source.damaged(said.data_end, "the summary begins here, and the data have not ended"))


def _is_end(source: Source, place: Place, scan: "_Scan") -> bool:
    """Whether the data are over; what ends too early is a fault."""
    if place.kind == mcap.FOOTER and place.offset == footer_at(source):
        return True
    if place.kind != mcap.DATA_END or place.length != 4:
        return False
    if source.ends and place.end not in (footer_at(source), _summary_at(source)):
        scan.fault(source.damaged(place.offset, "the data end here, and something else than the summary follows"))
    scan.end(place)
    return True


def _summary_at(source: Source) -> int:
    try:
        return parsed(source, source.place(footer_at(source)), mcap.footer).summary_start
    except DamagedBag:
        return 0


def _check(source: Source, place: Place, said: Index) -> None:
    """That a record may stand among the data.

    Raises:
        DamagedBag: it may not.
    """
    if place.kind not in _IN_DATA and (place.kind < _PRIVATE or not said.summarized):
        raise source.damaged(place.offset, f"a record is of kind {place.kind:#04x}, and none such can be here")
    if place.kind == mcap.MESSAGE and said.summarized:
        raise source.damaged(place.offset, "a message is here, and the summary says that all are in chunks")
    if place.kind == mcap.MESSAGE_INDEX:
        head = source.read(place.content, min(place.length, 6))
        length = int.from_bytes(head[2:], "little")
        if length + 6 != place.length or length % 16:
            raise source.damaged(place.offset, "an index of messages has another length than it says")


def _is_record(source: Source, offset: int) -> bool:
    """Whether a record may begin here."""
    try:
        kind = source.place(offset).kind
    except DamagedBag:
        return False
    return kind in (*_IN_DATA, mcap.DATA_END, mcap.FOOTER)


def _read_block(data: bytes | memoryview, found: Index) -> tuple[dict[int, int], int, int]:
    """How many messages of each channel are in a block, and their first and last arrival, ns.

    What it says of schemas and channels is added to `found`.

    Raises:
        Malformed: its records make no sense.
    """
    counts: dict[int, int] = {}
    begin, end = 2**64, -1
    for row in mcap.rows(data, found.learn):
        if row.channel not in found.channels:
            raise Malformed(f"a message is of channel {row.channel}, of which nothing was said before")
        counts[row.channel] = counts.get(row.channel, 0) + 1
        begin, end = min(begin, row.arrived), max(end, row.arrived)
    return counts, begin, end


class _Scan:
    """Takes the records of a file, one after another."""

    def __init__(self, source: Source, found: Index) -> None:
        self._source = source
        self._found = found
        self._run: Place | None = None
        self._sets: dict[frozenset[int], frozenset[int]] = {}
        self._faulty: set[int] = set()
        self.seen: set[int] = set()
        """Where chunks, attachments and metadata stand."""
        self.unreadable: BagError | None = None
        """Why chunks cannot be restored here, whole as they may be."""

    def take(self, place: Place) -> None:
        """One more record; what is wrong within it is a fault of the index."""
        found, source = self._found, self._source
        try:
            match place.kind:
                case mcap.CHUNK:
                    self.seen.add(place.offset)
                    self.end_run()
                    self._add(place, self._restored(place))
                case mcap.MESSAGE | mcap.SCHEMA | mcap.CHANNEL:
                    self._extend_run(place)
                case mcap.ATTACHMENT:
                    self.seen.add(place.offset)
                    self._take_attachment(place)
                case mcap.METADATA:
                    self.seen.add(place.offset)
                    words = parsed(source, place, mcap.metadata)
                    if len(found.metadata) < MOST_NAMED:
                        found.metadata.append(mcap.MetadataIndex(place.offset, place.end - place.offset, words.name))
        except DamagedBag as fault:
            self.fault(fault)
        found.data_end = place.end

    def end(self, place: Place) -> None:
        """The data end with a record."""
        self._found.data_end = place.offset

    def fault(self, fault: DamagedBag) -> None:
        """Something is wrong; of one place once."""
        if fault.offset not in self._faulty:
            self._faulty.add(fault.offset or 0)
            self._found.add_fault(fault)

    def end_run(self) -> None:
        """The records so far are a block, if there are any."""
        run, self._run = self._run, None
        if run is not None:
            try:
                self._add(run, self._source.content(run))
            except DamagedBag as fault:
                self.fault(fault)

    def _restored(self, place: Place) -> bytes | memoryview:
        chunk = self._source.chunk(place)
        try:
            return self._source.restored(place, chunk)
        except DamagedBag:
            raise
        except BagError as error:
            self.unreadable = error  # of all chunks, or has one only another name for its compression?
            raise self._source.damaged(place.offset, error.reason) from None

    def _extend_run(self, place: Place) -> None:
        run = self._run
        if run is not None and (run.end != place.offset or run.length + place.length > _RUN):
            self.end_run()
            run = None
        begin = run.content if run is not None else place.offset
        self._run = Place(begin - mcap.PREFIX.size, 0, place.end - begin)

    def _add(self, place: Place, data: bytes | memoryview) -> None:
        try:
            counts, begin, end = _read_block(data, self._found)
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
        if len(self._found.attachments) < MOST_NAMED:
            self._found.attachments.append(
                mcap.AttachmentIndex(place.offset, place.end - place.offset, *times, size, *names)
            )
