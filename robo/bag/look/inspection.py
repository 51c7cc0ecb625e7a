"""Looking for what is wrong with a recording: with its files, with its times, with its messages.

Of each kind and topic there is one finding, with how often and the worst of it, so that a report stays short.
"""

from enum import StrEnum
from pathlib import Path

import msgspec

from robo.bag.look import indexes
from robo.bag.look.losses import Losses, recorder_counts
from robo.bag.look.ordering import Ordering
from robo.bag.mcap.index import Index
from robo.bag.mcap.scan import index_of
from robo.bag.mcap.source import Source
from robo.bag.progress import Tell, counted, silent
from robo.bag.read.files import Files, files_of, missing_parts
from robo.bag.read.reader import Bag
from robo.bag.read.topics import BagMessage, Topic
from robo.bag.types import Find
from robo.errors import BagError, DamagedBag

_NS = 10**9
_LEAST_HOLE = 1.0
"""s."""
_HOLE = 10
"""Times the mean time from one message to the next."""
_LEAST_COUNT = 20
"""Of messages that tell how often a topic comes."""
_JUMP = _NS
"""Of a clock that is set back, ns."""
_PAUSE = 60 * _NS
"""In which nothing comes at all, ns: a clock that is set forward looks like this."""
_FIRST_YEAR = 946_684_800 * _NS
"""2000: no recording is older, but many clocks begin in 1970."""
_MOST_DAMAGED = 1_000


class Kind(StrEnum):
    """What may be wrong."""

    CUT = "cut"
    """A file ends too early."""
    DAMAGED = "damaged"
    """Bytes make no sense."""
    INDEX = "index"
    """A summary or an index says something else than the file."""
    MISSING = "missing"
    """A file of several is not there."""
    HOLE = "hole"
    """A topic is silent for long."""
    JUMP = "time jump"
    """The recorder's clock was set."""
    EPOCH = "epoch"
    """Times begin in 1970: the clock was not set yet."""
    DISORDER = "out of order"
    """Messages of a publisher come after some that it published later."""
    LOST = "lost"
    """Messages did not come."""
    MALFORMED = "malformed"
    """Messages came that the recorder could not write down."""
    UNDECODABLE = "undecodable"
    """Messages are none of their type."""
    UNKNOWN = "unknown type"
    """Messages stay bytes."""


FATAL = (Kind.CUT, Kind.DAMAGED, Kind.INDEX, Kind.MISSING, Kind.UNDECODABLE)
"""What is wrong with the recording; all else may be so in what it tells of."""


class Finding(msgspec.Struct, kw_only=True):
    """Something that is wrong."""

    kind: Kind
    topic: str = ""
    """Empty where it is none in particular."""
    count: int = 1
    """How often."""
    time: int | None = None
    """When the first one arrived, ns since the epoch."""
    text: str
    """What, in words: of the worst one, or of the first."""


class Report(msgspec.Struct, frozen=True):
    """What is wrong with a recording."""

    path: str
    messages: int
    """That were looked at."""
    findings: list[Finding]

    @property
    def whole(self) -> bool:
        """Whether nothing is wrong with the recording itself."""
        return not any(finding.kind in FATAL for finding in self.findings)


def check(path: str | Path, find: Find, tell: Tell = silent) -> Report:
    """Look at every byte of a recording; `tell` is told how many bytes of each file, then how many messages.

    Raises:
        BagError: it cannot be read.
        DamagedBag: it is no recording at all.
    """
    paths = files_of(path)
    files = Files(paths, scan=True, tell=tell)
    with Bag(str(path), files, find) as bag:
        look = _Look(bag)
        for name in missing_parts(paths) if Path(path).is_dir() else ():
            look.found(Kind.MISSING, "", None, f"{name} is missing")
        for fault in bag.faults:
            look.fault(fault)
        for number, index in enumerate(files.indexes):
            look.compare(files.paths[number], index)
        for topic in bag.topics.values():
            if topic.unknown and topic.count:
                look.found(Kind.UNKNOWN, topic.name, None, topic.unknown, topic.count)
        for message in counted(bag.in_file_order(), bag.count, tell):
            look.message(message)
        look.end(bag)
        return Report(str(path), look.messages, look.findings)


class _Seen(msgspec.Struct):
    """The messages of one topic so far."""

    losses: Losses
    order: Ordering
    longest: float
    """From here on a silence is a hole, s; 0 for never."""
    arrived: int = 0


class _Look:
    """Takes messages in the order of the file, and finds what is wrong."""

    def __init__(self, bag: Bag) -> None:
        self.messages = 0
        self._found: dict[tuple[Kind, str], Finding] = {}
        self._worst: dict[tuple[Kind, str], float] = {}
        self._damaged = 0
        self._latest = 0
        self._seen: dict[Topic, _Seen] = {}
        self._begin = bag.begin
        span = bag.duration
        for topic in bag.topics.values():
            often = topic.count >= _LEAST_COUNT and not topic.qos.latched
            self._seen[topic] = _Seen(
                Losses(), Ordering(topic.publishers), max(_LEAST_HOLE, _HOLE * span / topic.count) if often else 0.0
            )

    @property
    def findings(self) -> list[Finding]:
        """What was found, the gravest kinds first."""
        order = list(Kind)
        return sorted(self._found.values(), key=lambda finding: (order.index(finding.kind), finding.topic))

    def found(self, kind: Kind, topic: str, time: int | None, text: str, count: int = 1, size: float = 0.0) -> None:
        """Something is wrong; of one kind and topic the text of the largest `size` stays."""
        known = self._found.get((kind, topic))
        if known is None:
            self._found[kind, topic] = Finding(kind=kind, topic=topic, count=count, time=time, text=text)
            self._worst[kind, topic] = size
        else:
            known.count += count
            if size > self._worst[kind, topic]:
                self._worst[kind, topic] = size
                known.text = text

    def fault(self, fault: DamagedBag) -> None:
        """A file is cut or damaged."""
        kind = Kind.CUT if fault.cut else Kind.DAMAGED
        if self._damaged < _MOST_DAMAGED:
            self._damaged += 1
            self._found[kind, str(fault)] = Finding(kind=kind, text=str(fault))

    def compare(self, path: str, seen: Index) -> None:
        """Whether the summary of a file says what was seen in it."""
        if seen.faults:
            return  # more is wrong than that
        with Source(path) as source:
            said = index_of(source)
            beside = indexes.untrue(source, seen)
        if beside:
            self.found(Kind.INDEX, "", None, f"{path}: {beside}")
        if said.faults:
            self.found(Kind.INDEX, "", None, str(said.faults[0]))
        elif said.summarized:
            counted = {channel: count for channel, count in said.counts.items() if count}
            if counted != {channel: count for channel, count in seen.counts.items() if count}:
                text = f"{path}: its summary counts {sum(counted.values()):,} messages, and it has "
                self.found(Kind.INDEX, "", None, f"{text}{sum(seen.counts.values()):,}")
            elif not _same_blocks(said, seen):
                self.found(Kind.INDEX, "", None, f"{path}: its summary has other chunks, times or topics than the file")

    def message(self, message: BagMessage) -> None:
        """One more message."""
        topic = message.topic
        seen = self._seen[topic]
        arrived, published = message.arrived, message.published
        self.messages += 1
        self._clock(arrived)
        if arrived < _FIRST_YEAR:
            self.found(Kind.EPOCH, topic.name, arrived, "times are before the year 2000: was the clock set?")
        self._silence(topic, seen, arrived, "without a message" if seen.arrived else "until the first message")
        if late := seen.order.late(message.sequence, published):
            self.found(Kind.DISORDER, topic.name, arrived, f"up to {late / _NS:.3g} s late", size=late)
        seen.arrived = arrived
        before = seen.losses.lost
        seen.losses.add(message.sequence, published)
        if (lost := seen.losses.lost - before) > 0:
            self.found(Kind.LOST, topic.name, arrived, f"up to {lost:,} in a row", lost, size=lost)
        try:
            message.value  # noqa: B018 - it is decoded
        except BagError as error:
            self.found(Kind.UNDECODABLE, topic.name, arrived, str(error))

    def end(self, bag: Bag) -> None:
        """All messages were looked at.

        Raises:
            DamagedBag: metadata cannot be read.
        """
        for topic, seen in self._seen.items():
            if seen.arrived:
                self._silence(topic, seen, bag.end, "without a message, up to the end")
        for name, counts in recorder_counts(bag).items():
            known = self._found.get((Kind.LOST, name))
            if known is not None:
                known.count = max(counts.lost, known.count)
            elif counts.lost:
                self.found(Kind.LOST, name, None, "as the recorder counted", counts.lost)
            if counts.malformed:
                text = "they came, and could not be written down"
                self.found(Kind.MALFORMED, name, None, text, counts.malformed)

    def _clock(self, arrived: int) -> None:
        """Whether the recorder's clock goes on as it should."""
        back = self._latest - arrived
        if back > _JUMP:
            self.found(Kind.JUMP, "", arrived, f"the clock went back by {back / _NS:.1f} s", size=back)
            self._latest = arrived
        elif self._latest and -back > _PAUSE:
            text = f"nothing came for {-back / _NS:.1f} s: all was silent, or the clock was set forward"
            self.found(Kind.JUMP, "", self._latest, text, size=-back)
        self._latest = max(self._latest, arrived)

    def _silence(self, topic: Topic, seen: _Seen, now: int, which: str) -> None:
        """Whether a topic was silent for long up to a time."""
        since = seen.arrived or self._begin
        silence = (now - since) / _NS
        if seen.longest and silence > seen.longest:
            self.found(Kind.HOLE, topic.name, since, f"{silence:.1f} s {which}", size=silence)


def _same_blocks(said: Index, seen: Index) -> bool:
    """Whether blocks are where a summary says, of those times and topics.

    Those that have no messages say 0, and a scan leaves them out; what a summary says nothing of is not compared.
    """
    one, other = ([block for block in index.blocks if block.begin or block.end] for index in (said, seen))
    return len(one) == len(other) and all(
        mine[:3] == theirs[:3] and mine.channels in (None, theirs.channels)
        for mine, theirs in zip(one, other, strict=True)
    )
