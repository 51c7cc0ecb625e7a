"""How two recordings differ: in topics, counts, times and values."""

from itertools import zip_longest
from typing import Any

import msgspec

from robo.bag.look.fields import Unequal, unequal
from robo.bag.look.pairing import Pair, Pairing
from robo.bag.progress import Tell, counted, silent
from robo.bag.read.reader import Bag
from robo.bag.read.topics import BagMessage, Topic
from robo.errors import BagError
from robo.text.brief import shown

_NS = 1e-9


class Difference(msgspec.Struct, frozen=True):
    """Where messages differ."""

    index: int
    """Which message of the topic, from 0."""
    time: int
    """When it was published, ns since the epoch, in the first recording."""
    field: str
    """`pose.pose.position.x`; empty where that cannot be told."""
    first: str
    second: str


class TopicDifference(msgspec.Struct, kw_only=True):
    """One topic in two recordings."""

    name: str
    types: tuple[str, str]
    """In each; empty where it is not there."""
    counts: tuple[int, int]
    differing: int = 0
    """Messages whose bytes differ, by their order."""
    first: Difference | None = None
    """The first of those."""
    shift: float = 0.0
    """The largest change of a message's publish time, s."""
    delay: float = 0.0
    """The largest change of a message's arrival, each counted from the first of its recording, s."""

    @property
    def same(self) -> bool:
        """Whether types, counts and messages are the same; times may differ."""
        return self.types[0] == self.types[1] and self.counts[0] == self.counts[1] and not self.differing


class Diff(msgspec.Struct, frozen=True):
    """Two recordings beside each other."""

    paths: tuple[str, str]
    topics: list[TopicDifference]

    @property
    def same(self) -> bool:
        """Whether all topics are the same; times may differ."""
        return all(topic.same for topic in self.topics)


def diff(first: Bag, second: Bag, tell: Tell = silent) -> Diff:
    """Compare the messages of each topic in the order of their arrivals; `tell` is told how far that is.

    Each recording is read once, and once more for topics that it has at quite another time than the other one.

    Raises:
        DamagedBag: a part of one of them is damaged.
    """
    both = first.topics.keys() & second.topics.keys()
    found = {name: _topic(first.topics.get(name), second.topics.get(name)) for name in first.topics | second.topics}
    begins = first.begin, second.begin
    pairing = Pairing(both)
    total = sum(first.topics[name].count + second.topics[name].count for name in both)
    one = counted(first.messages(both), total // 2, tell)
    for pair in pairing.pairs(one, second.messages(both), begins):
        if pair.topic not in pairing.left:
            _compare(found[pair.topic], pair, begins)
    for name in pairing.left:
        found[name] = _topic(first.topics[name], second.topics[name])
        counts = pairing.counts[name] = [0, 0]
        for index, (mine, other) in enumerate(zip_longest(first.messages(name), second.messages(name))):
            counts[0] += mine is not None
            counts[1] += other is not None
            if mine is not None and other is not None:
                _compare(found[name], Pair(name, index, mine, other), begins)
    for name, counts in pairing.counts.items():
        found[name].counts = counts[0], counts[1]
    return Diff((first.path, second.path), [found[name] for name in sorted(found)])


def _topic(first: Topic | None, second: Topic | None) -> TopicDifference:
    """A topic before its messages are compared."""
    there = first or second
    assert there is not None
    return TopicDifference(name=there.name, types=(_type(first), _type(second)), counts=(_count(first), _count(second)))


def _compare(found: TopicDifference, pair: Pair, begins: tuple[int, int]) -> None:
    one, other = pair.first, pair.second
    found.shift = max(found.shift, abs(one.published - other.published) * _NS)
    found.delay = max(found.delay, abs((one.arrived - begins[0]) - (other.arrived - begins[1])) * _NS)
    if one.data != other.data:
        found.differing += 1
        if found.first is None:
            found.first = _difference(pair.number, one, other)


def _type(topic: Topic | None) -> str:
    return topic.type if topic is not None else ""


def _count(topic: Topic | None) -> int:
    return topic.count if topic is not None else 0


def _difference(index: int, one: BagMessage, other: BagMessage) -> Difference:
    try:
        values: tuple[Any, Any] = one.value, other.value
    except BagError:
        values = one.data, other.data
    field, a, b = next(unequal(*values), Unequal("", *values))
    return Difference(index, one.published, field, shown(a), shown(b))
