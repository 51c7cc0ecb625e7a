"""Numbers of a recording over time: fields of topics, thinned to what a picture shows, with their units."""

import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import msgspec

from robo.bag.look.fields import at, number
from robo.bag.progress import Tell, counted, silent
from robo.bag.read.reader import Bag
from robo.errors import UsageError
from robo.interfaces.units import unit_of
from robo.text.suggestions import suggest
from robo.text.thinning import Point, Thinned
from robo_messages import Duration, Message, Time

_MOST_CHOSEN = 64
"""Fields of a topic that are looked at where none is named."""
_PATH = re.compile(r"[A-Za-z_]\w*(?:\.\w+|\[-?\d{1,9}\])*")


class Series(NamedTuple):
    """A field over time."""

    topic: str
    field: str
    unit: str
    points: list[Point]
    """s since `begin`, and values; flags are 0 and 1."""
    values: int
    """How many it had."""


def series(
    bag: Bag,
    names: Sequence[str],
    fields: Sequence[str],
    begin: int | None = None,
    end: int | None = None,
    tell: Tell = silent,
) -> list[Series]:
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
    for field in fields:
        if not _PATH.fullmatch(field):
            raise UsageError(
                f"--field {field!r}: write names and indexes, for example pose.pose.position.x or ranges[0]"
            )
    since = bag.begin if begin is None else begin
    for name in names:
        if bag.topic(name).known is None:
            raise UsageError(f"{name} has no fields that can be read: {bag.topic(name).unknown}")
    total = sum(bag.topic(name).count for name in names)
    wanted: dict[str, list[_Line]] = {}
    had: set[str] = set()
    for message in counted(bag.messages(names, begin, end), total, tell):
        name, value = message.topic.name, message.value
        if name not in wanted:
            had.update(_numbers(value))
            wanted[name] = [_Line(type(value), field) for field in _chosen(value, fields)]
        time = ((message.published or message.arrived) - since) * 1e-9
        for line in wanted[name]:
            line.add(time, value)
    _check(fields, wanted, had)
    found = [
        Series(name, line.field, line.unit, line.thinned.points, line.thinned.count)
        for name in names
        for line in wanted.get(name, ())
        if line.thinned.count
    ]
    if not fields:
        found = [one for one in found if _changes(one.points)] or found
    return found


class _Line:
    def __init__(self, type_: type, field: str) -> None:
        self.field = field
        self.unit = unit_of(type_, field) if issubclass(type_, Message) else ""
        self.thinned = Thinned()
        self.other = ""
        """What it was where it was no number."""
        self._walk = _walk(field)

    def add(self, time: float, message: Any) -> None:
        value = self._walk(message)
        if isinstance(value, bool):
            value = int(value)
        figure = number(value)
        if figure is not None:
            self.thinned.add(time, float(figure))
        elif value is not None:
            self.other = type(value).__name__


def _walk(field: str) -> Callable[[Any], Any]:
    return at(re.sub(r"\[(-?\d+)\]", r".\1", field))


def _chosen(message: Any, fields: Sequence[str]) -> list[str]:
    """The fields of a message that are meant."""
    if not fields:
        return [path for path in _numbers(message) if not path.startswith("header.")][:_MOST_CHOSEN]
    return [field for field in fields if _walk(field)(message) is not None]


def _numbers(value: Any, path: str = "") -> Iterator[str]:
    """The paths of all numbers outside of lists."""
    if isinstance(value, msgspec.Struct) and not isinstance(value, (Time, Duration)):
        for name in value.__struct_fields__:
            yield from _numbers(getattr(value, name), f"{path}.{name}" if path else name)
    elif isinstance(value, (int, float)):
        yield path


def _check(fields: Sequence[str], found: Mapping[str, Sequence[_Line]], had: Collection[str]) -> None:
    if not found:
        raise UsageError("there is no message of these topics in that time")
    lines = [line for several in found.values() for line in several]
    for field in fields:
        mine = [line for line in lines if line.field == field]
        if not mine:
            raise UsageError(
                f"--field {field}: {', '.join(sorted(found))}: no such field; {suggest(field, had, 'it has')}"
            )
        if not any(line.thinned.count for line in mine):
            raise UsageError(f"--field {field}: it is no number but {mine[0].other}")
    if not lines:
        raise UsageError(f"{', '.join(sorted(found))}: there is no number outside of lists; say --field")


def _changes(points: Sequence[Point]) -> bool:
    return any(value != points[0][1] for _, value in points)
