"""What a node says now beside what it said in a recording: counts, times and fields, with tolerances."""

import itertools
import math
import re
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import msgspec

from robo.bag.look.fields import Unequal, number, unequal
from robo.bag.read.reader import Bag
from robo.bag.read.topics import BagMessage
from robo.bag.regression.alignment import Pairs, by_time, in_order
from robo.bag.regression.report import FieldReport, Spot, TopicReport, Value
from robo.bag.regression.tolerances import Tolerance, Tolerances
from robo.errors import BagError
from robo.text.brief import shown
from robo_messages import Duration, Time

WINDOW = 1_000_000_000
"""Messages that are further apart than this are never the same one, ns."""
TAIL = 250_000_000
"""What comes so soon before the end of a recording of a live robot may have come too late for it, ns."""
LIVE = 1.0
"""By how much a message of a live robot may come earlier or later than in lock step, where nothing else is said, s: its
machine was busy with others, too."""

_NUMBERED = re.compile(r"\.\d+(?=\.|$)")


class Extent(msgspec.Struct, frozen=True):
    """Which messages of the recording count, and how exact its times are."""

    exact: bool
    """Whether it was made in lock step, by an earlier replay; else by a live robot."""
    begin: int = 0
    """Messages that were published before do not count, ns."""
    end: int = 2**64
    """When the recording ended, ns."""
    latched: bool = False
    """Whether what was published before counts all the same, whenever that was."""


def compare(expected: Bag, actual: Bag, name: str, tolerances: Tolerances, extent: Extent) -> TopicReport:
    """Compare one topic, message by message.

    Those are compared that belong together: in their order, or by their times where this leaves fewer that differ.

    Raises:
        DamagedBag: a part of a file is damaged.
    """
    topics = expected.topics.get(name), actual.topics.get(name)
    types = (topics[0].type if topics[0] else "", topics[1].type if topics[1] else "")
    if all(types) and types[0] != types[1]:
        counts = expected.topic(name).count, actual.topic(name).count
        return TopicReport(name=name, types=types, counts=counts, same=False)

    begin = 0 if extent.latched else extent.begin

    def then() -> Iterable[_Read]:
        said = expected.messages(name, order="published") if topics[0] is not None else ()
        return (_Read(one) for one in said if one.published >= begin)

    def now() -> Iterable[_Read]:
        said = actual.messages(name) if topics[1] is not None else ()
        return (_Read(one) for one in said if one.published >= begin)

    found = _Comparison(name, types, tolerances, extent).of(in_order(then(), now()))
    if found.same:
        return found
    time_of: Callable[[_Read], int] = _stamp_or_published if _has_stamp(then()) and _has_stamp(now()) else _published
    pairs = by_time(then(), now(), time_of, WINDOW)
    by_times = _Comparison(name, types, tolerances, extent).of(pairs)
    return by_times if by_times.trouble < found.trouble or by_times.same else found


class _Read:
    """A message that is decoded at most once."""

    def __init__(self, message: BagMessage) -> None:
        self.message = message
        self._value: Any = None

    @property
    def value(self) -> Any:
        if self._value is None:
            try:
                self._value = self.message.value
            except BagError:
                self._value = self.message.data
        return self._value


def _published(one: _Read) -> int:
    return one.message.published


def _stamp(one: _Read) -> int:
    """The time to which a message belongs, ns: 0 where it says none."""
    stamp = getattr(getattr(one.value, "header", None), "stamp", None)
    return stamp.to_nanoseconds() if isinstance(stamp, Time) else 0


def _stamp_or_published(one: _Read) -> int:
    return _stamp(one) or one.message.published  # of one that is damaged its bytes are all there is


def _has_stamp(messages: Iterable[_Read]) -> bool:
    """Whether messages say to what time they belong."""
    return any(map(_stamp, itertools.islice(messages, 1)))


class _Comparison:
    """Compares the messages of one topic that belong together."""

    def __init__(self, name: str, types: tuple[str, str], tolerances: Tolerances, extent: Extent) -> None:
        self._report = TopicReport(name=name, types=types, counts=(0, 0))
        self._tolerances = tolerances
        self._extent = extent
        said = tolerances.time_of(name)
        self._time = round((said if said is not None else 0.0 if extent.exact else LIVE) * 1e9)
        self._fields: dict[str, FieldReport] = {}

    def of(self, pairs: Pairs[_Read]) -> TopicReport:
        """What comes of it."""
        then = now = 0
        report = self._report
        for one, other in pairs:
            if one is not None and other is not None:
                self._compare(then, one, other)
            elif one is not None:
                report.missing += 1
                if report.first_missing is None:
                    report.first_missing = one.message.published
            elif other is not None and (self._extent.exact or other.message.published < self._extent.end - TAIL):
                report.additional += 1
                if report.first_additional is None:
                    report.first_additional = other.message.published
            then, now = then + (one is not None), now + (other is not None)
        report.counts = then, now
        report.fields = list(self._fields.values())
        report.same = not (report.trouble or report.moved)
        return report

    def _compare(self, index: int, one: _Read, other: _Read) -> None:
        report = self._report
        report.compared += 1
        moved = 0
        if one.message.published >= self._extent.begin:
            moved = abs(one.message.published - other.message.published)
        report.shift = max(report.shift, moved * 1e-9)
        if moved > self._time:
            report.moved += 1
            if report.first_moved is None:
                report.first_moved = one.message.published
        if one.message.data == other.message.data:
            return
        differs = False
        for found in unequal(one.value, other.value, (Time, Duration)):
            tolerance = self._tolerances.of(report.name, found.field)
            if tolerance.ignored:
                continue
            if _allowed(tolerance, found.first, found.second):
                continue
            differs = True
            self._add(index, one.message.published, found)
        report.differing += differs

    def _add(self, index: int, time: int, found: Unequal) -> None:
        expected, actual = _value(found.first), _value(found.second)
        size = _size(found.first, found.second)
        spot = Spot(index=index, time=time, field=found.field, expected=expected, actual=actual, size=size)
        name = _NUMBERED.sub(".*", found.field)
        known = self._fields.get(name)
        if known is None:
            largest = spot if size is not None else None
            self._fields[name] = FieldReport(field=name, differing=1, first=spot, largest=largest)
            return
        known.differing += 1
        if size is not None and (known.largest is None or size > (known.largest.size or 0.0)):
            known.largest = spot


def earliest_first(topics: Sequence[TopicReport], said: Bag) -> list[TopicReport]:
    """Topics that differ by when they first do; those of one time in the order in which they were said.

    Args:
        topics: of the comparison of a recording with another one.
        said: that recording.

    Raises:
        DamagedBag: a part of the file is damaged.
    """
    first = {topic.name: topic.first for topic in topics}
    there = [name for name in first if name in said.topics]
    order: dict[str, int] = {}
    for message in said.messages(there, min(first.values()), max(first.values()) + 1) if there else ():
        if message.arrived == first[message.topic.name]:
            order.setdefault(message.topic.name, len(order))
    return sorted(topics, key=lambda topic: (topic.first, order.get(topic.name, len(first))))


def _allowed(tolerance: Tolerance, a: Any, b: Any) -> bool:
    if isinstance(a, (Time, Duration)):
        size = _size(a, b)
        return size is not None and size <= tolerance.absolute
    first, second = number(a), number(b)
    return first is not None and second is not None and tolerance.allows(first, second)


def _size(a: Any, b: Any) -> float | None:
    if isinstance(a, (Time, Duration)) and isinstance(b, (Time, Duration)):
        return abs(_nanoseconds(a) - _nanoseconds(b)) * 1e-9  # as floats they lose their last digits
    first, second = number(a), number(b)
    size = abs(first - second) if first is not None and second is not None else math.nan
    return size if math.isfinite(size) else None


def _nanoseconds(value: Time | Duration) -> int:
    return value.sec * 10**9 + value.nanosec


def _value(value: Any) -> Value:
    if isinstance(value, (Time, Duration)):
        seconds, rest = divmod(_nanoseconds(value), 10**9)
        return f"{seconds}.{rest:09d}"
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, (bool, int, float)):
        return value
    if isinstance(value, (list, tuple)):
        return f"{len(value)} elements"
    return value if isinstance(value, str) and len(value) <= 60 else shown(value)
