"""Numbers of a recording over time: fields of topics, thinned to what a picture shows, with their units."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import msgspec

from robo.bag.look.fields import number
from robo.bag.progress import Tell, counted, silent
from robo.bag.read.readable import Readable
from robo.bag.read.reader import Bag
from robo.errors import UsageError
from robo.interfaces.parts import Field, Missing
from robo.interfaces.units import unit_of
from robo.text.suggestions import suggest
from robo.text.thinning import Point, Thinned
from robo_messages import Duration, Message, Time

_MOST_CHOSEN = 64
"""Fields of a topic that are looked at where none is named."""
_OTHER_CLOCK = 86_400 * 10**9
"""By which times of publishing and of arrival differ where they are of two clocks, as of a simulation, ns."""


class Series(NamedTuple):
    """A field over time."""

    topic: str
    field: str
    unit: str
    points: list[Point]
    """s since `begin`, and values; flags are 0 and 1."""
    values: int
    """How many it had."""


class Found(NamedTuple):
    """What a recording has of what is asked for."""

    series: list[Series]
    by_arrival: list[str]
    """Topics whose times are those of arrival, for the clock of their publishers is another one."""
    readable: Readable
    """What cannot be read."""


def series(
    bag: Bag,
    names: Sequence[str],
    fields: Sequence[str],
    begin: int | None = None,
    end: int | None = None,
    tell: Tell = silent,
) -> Found:
    """What fields of topics were over time, by the times at which messages were published.

    Args:
        bag: the recording.
        names: of its topics.
        fields: `pose.pose.position.x`, `ranges[0]`: of each topic those that it has. Empty for all numbers that change.
        begin: arrivals from then on, ns since the epoch; None for all. Points count from it, or from the beginning.
        end: arrivals before then.
        tell: is told how far it is.

    Raises:
        UsageError: a field is no path, is no number, or no topic has it.
        BagError: the recording cannot be read.
    """
    fields = list(dict.fromkeys(fields))
    asked = [Field(field) for field in fields]
    since = bag.begin if begin is None else begin
    for name in names:
        if bag.topic(name).known is None:
            raise UsageError(f"{name} has no fields that can be read: {bag.topic(name).unknown}")
    total = sum(bag.topic(name).count for name in names)
    wanted: dict[str, list[_Line]] = {}
    had: dict[str, None] = {}
    by_arrival: set[str] = set()
    readable = Readable()
    for message, value in readable.of(counted(bag.messages(names, begin, end), total, tell)):
        name = message.topic.name
        if name not in wanted:
            had.update(dict.fromkeys(_numbers(value)))
            wanted[name] = [_Line(type(value), field) for field in asked or _chosen(value)]
            if message.published and abs(message.published - message.arrived) > _OTHER_CLOCK:
                by_arrival.add(name)
        published = 0 if name in by_arrival else message.published
        time = ((published or message.arrived) - since) * 1e-9
        for line in wanted[name]:
            line.add(time, value)
    _check(fields, wanted, had, readable)
    found = [
        Series(name, line.field.path, line.unit, line.thinned.points, line.thinned.count)
        for name in names
        for line in wanted.get(name, ())
        if line.thinned.count
    ]
    if not fields:
        found = [one for one in found if _changes(one.points)] or found
    return Found(found, [name for name in names if name in by_arrival], readable)


class _Line:
    def __init__(self, type_: type, field: Field) -> None:
        self.field = field
        self.unit = unit_of(type_, field.path) if issubclass(type_, Message) else ""
        self.thinned = Thinned()
        self.other = ""
        """What it was where it was no number."""
        self.missing: Missing | None = None
        """What it was where it was not there."""

    def add(self, time: float, message: Message) -> None:
        try:
            value = self.field.of(message)
        except Missing as error:
            self.missing = self.missing or error
            return
        if isinstance(value, bool):
            value = int(value)
        figure = number(value)
        if figure is not None:
            self.thinned.add(time, float(figure))
        elif value is not None:
            self.other = type(value).__name__


def _chosen(message: Message) -> list[Field]:
    """The fields of a message that are meant where none is named."""
    return [Field(path) for path in _numbers(message) if not path.startswith("header.")][:_MOST_CHOSEN]


def _numbers(value: Any, path: str = "") -> Iterator[str]:
    """The paths of all numbers outside of lists."""
    if isinstance(value, msgspec.Struct) and not isinstance(value, (Time, Duration)):
        for name in value.__struct_fields__:
            yield from _numbers(getattr(value, name), f"{path}.{name}" if path else name)
    elif isinstance(value, (int, float)):
        yield path


def _check(
    fields: Sequence[str], found: Mapping[str, Sequence[_Line]], had: Collection[str], readable: Readable
) -> None:
    if not found:
        raise UsageError("; ".join(["there is no message of these topics in that time", *readable.notes()]))
    lines = [line for several in found.values() for line in several]
    topics = ", ".join(sorted(found))
    for field in fields:
        mine = [line for line in lines if line.field.path == field]
        if any(line.thinned.count for line in mine):
            continue
        for line in mine:
            if line.other:
                raise UsageError(f"--field {field}: it is no number but {line.other}")
            if line.missing is not None and line.missing.may_come:
                raise UsageError(f"--field {field}: {topics}: {line.missing}")
        raise UsageError(f"--field {field}: {topics}: no such field; {suggest(field, had, 'it has')}")
    if not lines:
        raise UsageError(f"{topics}: there is no number outside of lists; say --field")


def _changes(points: Sequence[Point]) -> bool:
    return any(value != points[0][1] for _, value in points)
