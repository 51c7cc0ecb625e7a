"""What is in a recording, in figures: for each topic its rate, its longest silence, its losses, its size."""

import msgspec

from robo.bag.look.losses import Losses, recorder_counts
from robo.bag.progress import Tell, counted, silent
from robo.bag.read.reader import Bag
from robo.bag.read.topics import Topic
from robo.bag.write.counts import Counts


class TopicInfo(msgspec.Struct, kw_only=True):
    """One topic. What only its messages say is None where they were not looked at."""

    name: str
    type: str
    """Robo's name; of a type that is not known, what the file calls it."""
    unknown: str
    """Why its messages stay bytes; empty where they are robo's."""
    latched: bool
    count: int
    lost: int | None = None
    """Messages that did not come, as the recorder counted or by the gaps in the sequence numbers; None where there are
    none."""
    malformed: int | None = None
    """Messages that came and could not be written down, as the recorder counted; None where it did not."""
    rate: float | None = None
    """Hz, by publish times; what is lost counts. None for less than two messages."""
    gap: float | None = None
    """The longest time between two arrivals, s."""
    gap_at: int | None = None
    """When that began, ns since the epoch."""
    begin: int | None = None
    """The first arrival, ns since the epoch."""
    end: int | None = None
    size: int | None = None
    """Of its messages, bytes."""
    delay: float | None = None
    """Mean time from publishing to arrival, s. Between machines their clocks decide."""


class Info(msgspec.Struct, kw_only=True):
    """A recording."""

    path: str
    files: list[str]
    size: int
    """Of its files, bytes."""
    begin: int
    """The first arrival, ns since the epoch; 0 where there is no message."""
    end: int
    duration: float
    """s."""
    count: int
    profile: str
    """ros2 for a recording that ROS 2 reads."""
    library: str
    """What wrote it."""
    topics: list[TopicInfo]
    attachments: dict[str, int]
    """Sizes in bytes."""
    metadata: dict[str, dict[str, str]]
    faults: list[str]
    """What is wrong with its files."""


def info(bag: Bag, *, quick: bool = False, tell: Tell = silent) -> Info:
    """What is in a recording. `quick` looks at no message: counts and times of the whole alone.

    `tell` is told how many messages have been looked at.

    Raises:
        DamagedBag: a part of it is damaged.
    """
    header = bag.files.indexes[0].header
    return Info(
        path=bag.path,
        files=list(bag.files.paths),
        size=sum(bag.files.sizes),
        begin=bag.begin,
        end=bag.end,
        duration=bag.duration,
        count=bag.count,
        profile=header.profile,
        library=header.library,
        topics=_quick(bag) if quick else _whole(bag, tell),
        attachments=bag.attachments,
        metadata=bag.metadata,
        faults=[str(fault) for fault in bag.faults],
    )


def _quick(bag: Bag) -> list[TopicInfo]:
    return [_plain(topic) for topic in bag.topics.values()]


def _plain(topic: Topic) -> TopicInfo:
    return TopicInfo(
        name=topic.name, type=topic.type, unknown=topic.unknown, latched=topic.qos.latched, count=topic.count
    )


class _Tally:
    """The figures of one topic, message by message."""

    def __init__(self) -> None:
        self.count = self.size = self.delay = self.gap_at = 0
        self.gap = -1
        self.begin = self.end = 0
        self.first = self.last = 0
        self.losses = Losses()

    def add(self, arrived: int, published: int, sequence: int, size: int) -> None:
        if not self.count:
            self.begin, self.first, self.last = arrived, published, published
        elif arrived - self.end > self.gap:
            self.gap, self.gap_at = arrived - self.end, self.end
        self.end = arrived
        self.first, self.last = min(self.first, published), max(self.last, published)
        self.count += 1
        self.size += size
        self.delay += arrived - published
        self.losses.add(sequence, published)

    def told(self, topic: Topic, counts: Counts | None) -> TopicInfo:
        """As figures; `counts` are the recorder's."""
        lost = counts.lost if counts is not None else self.losses.lost if self.losses.counted else None
        found = _plain(topic)
        found.malformed = counts.malformed if counts is not None else None
        found.count, found.lost, found.size = self.count, lost, self.size
        if self.count:
            found.begin, found.end, found.delay = self.begin, self.end, self.delay * 1e-9 / self.count
        span = self.last - self.first
        if self.count > 1 and span:
            found.rate = (self.count - 1 + (lost or 0)) / (span * 1e-9)
        if self.count > 1:
            found.gap, found.gap_at = self.gap * 1e-9, self.gap_at
        return found


def _whole(bag: Bag, tell: Tell) -> list[TopicInfo]:
    tallies = {name: _Tally() for name in bag.topics}
    by_topic = {topic: tallies[name] for name, topic in bag.topics.items()}
    for message in counted(bag.messages(), bag.count, tell):
        by_topic[message.topic].add(message.arrived, message.published, message.sequence, len(message.data))
    counts = recorder_counts(bag)
    return [tallies[name].told(topic, counts.get(name)) for name, topic in bag.topics.items()]
