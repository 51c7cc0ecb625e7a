"""What a regression by replay has found, and how that is told. Pure."""

import time
from collections.abc import Iterator
from typing import Literal

import msgspec

Value = float | int | bool | str
Verdict = Literal["same", "different", "not deterministic", "failed", "accepted"]

_MOST = 20
"""Fields of a topic that are told."""


class Spot(msgspec.Struct, frozen=True, kw_only=True):
    """One message, and in which field it differs."""

    index: int
    """Which message of the recording's topic, from 0."""
    time: int
    """When that was published, ns since the epoch."""
    field: str
    expected: Value
    actual: Value
    size: float | None
    """How far apart both are, in the field's unit; None where they are no numbers, or one is not finite."""


class FieldReport(msgspec.Struct, kw_only=True):
    """One field that differs in some messages."""

    field: str
    """With `*` for places in lists."""
    differing: int
    """Values that differ."""
    first: Spot
    largest: Spot | None
    """None where none has a size."""


class TopicReport(msgspec.Struct, kw_only=True):
    """One topic as it was, and as it is now."""

    name: str
    types: tuple[str, str]
    counts: tuple[int, int]
    """Messages then and now."""
    compared: int = 0
    differing: int = 0
    """Messages of which a field differs."""
    missing: int = 0
    """Messages that do not come any more."""
    first_missing: int | None = None
    """When the first of them was published, ns."""
    additional: int = 0
    """Messages that have not come then."""
    first_additional: int | None = None
    moved: int = 0
    """Messages that come earlier or later than is allowed."""
    first_moved: int | None = None
    shift: float = 0.0
    """By how much a message comes earlier or later, the most, s."""
    fields: list[FieldReport] = []
    same: bool = True

    @property
    def trouble(self) -> int:
        """How many messages are not as they were."""
        return self.differing + self.missing + self.additional

    @property
    def first(self) -> int:
        """When it first is not as it was, ns since the epoch; 0 where that is no matter of time."""
        times = [self.first_missing, self.first_additional, self.first_moved, *(one.first.time for one in self.fields)]
        return min((time for time in times if time is not None), default=0)


class Input(msgspec.Struct, frozen=True):
    """A topic that was fed."""

    topic: str
    type: str
    count: int


class NodeTopics(msgspec.Struct, frozen=True):
    """A node, and the topics by which it was judged."""

    node: str
    service: str
    outputs: list[str]


class Trouble(msgspec.Struct, frozen=True):
    """What a node raised, or how it ended."""

    node: str
    time: int
    """By the recording's clock, ns since the epoch."""
    text: str
    ended_by: str = ""
    """The signal that ended its process, such as SIGKILL; empty for none."""


class ReplayReport(msgspec.Struct, kw_only=True):
    """What came of a replay."""

    bag: str
    begin: int
    """When the recording begins, ns since the epoch."""
    verdict: Verdict = "same"
    nodes: list[NodeTopics] = []
    inputs: list[Input] = []
    topics: list[TopicReport] = []
    """Against the recording; where the runs differ, against each other, and the earliest first."""
    troubles: list[Trouble] = []
    notes: list[str] = []
    """What could not be replayed or compared, and what else one has to know."""
    runs: int = 0
    duration: float = 0.0
    """Of the recording, s."""
    seconds: float = 0.0
    """How long a run took, s."""
    accepted: str | None = None
    """The new reference, where one was written."""
    plots: list[str] = []
    """Pictures that were written."""

    @property
    def fine(self) -> bool:
        """Whether a test passes."""
        return self.verdict in ("same", "accepted")


def lines(report: ReplayReport) -> Iterator[str]:
    """A report for people."""
    names = ", ".join(one.node for one in report.nodes)
    fed = sum(one.count for one in report.inputs)
    yield (
        f"{names}: {_of(fed, 'message')} of {_of(len(report.inputs), 'topic')} from {report.bag}, "
        f"{report.duration:.1f} s in {report.seconds:.1f} s, {_of(report.runs, 'run')}"
    )
    for note in report.notes:
        yield f"note: {note}"
    for trouble in report.troubles[:_MOST]:
        yield f"{trouble.node} at {_when(trouble.time, report)}: {trouble.text}"
    again = report.verdict == "not deterministic"
    for topic in report.topics:
        yield from _topic(topic, report, ("one run", "another") if again else ("recorded", "now"))
    for plot in report.plots:
        yield f"plot: {plot}"
    yield verdict_line(report)


def verdict_line(report: ReplayReport) -> str:
    """The verdict as a sentence."""
    names = ", ".join(one.node for one in report.nodes)
    if report.verdict == "not deterministic":
        broken = [topic for topic in report.topics if not topic.same]
        said = [one.node for topic in broken for one in report.nodes if topic.name in one.outputs]
        who, *others = list(dict.fromkeys(said)) or [names]
        where = [f"{topic.name} {field.field}" for topic in broken for field in topic.fields]
        where = where or [topic.name for topic in broken]
        more = f" and {len(where) - 4} more" if len(where) > 4 else ""
        also = f" So then does {', '.join(others)}, and may only pass it on" if others else ""
        return (
            f"NOT DETERMINISTIC: {who} says something else in each run, in {', '.join(where[:4])}"
            f"{more}; does it read the wall clock, random numbers without a seed, or the order of a set?{also}"
        )
    if report.verdict == "failed":
        return f"FAILED: {', '.join(dict.fromkeys(one.node for one in report.troubles)) or names}"
    if report.verdict == "accepted":
        return f"ACCEPTED: {report.accepted} is what {names} says now"
    if report.verdict == "same":
        return f"SAME: {names} says what it said"
    broken = [topic for topic in report.topics if not topic.same]
    return f"DIFFERENT: {', '.join(topic.name for topic in broken)}"


def _topic(topic: TopicReport, report: ReplayReport, names: tuple[str, str]) -> Iterator[str]:
    if topic.types[0] and topic.types[1] and topic.types[0] != topic.types[1]:
        yield f"{topic.name}: it was a {topic.types[0]}, and is a {topic.types[1]}"
        return
    then, now = topic.counts
    if topic.same:
        yield f"{topic.name}: same, {_of(topic.compared, 'message')}"
        return
    yield f"{topic.name}: {_of(then, 'message')} {names[0]}, {now} {names[1]}"
    for count, first, what in (
        (topic.missing, topic.first_missing, "missing"),
        (topic.additional, topic.first_additional, "additional"),
        (topic.moved, topic.first_moved, f"earlier or later, by up to {topic.shift:.6g} s"),
    ):
        if count and first is not None:
            yield f"  {_of(count, 'message')} {what}, the first at {_when(first, report)}"
    for field in topic.fields[:_MOST]:
        yield from _field(field, topic, report, names)
    if len(topic.fields) > _MOST:
        yield f"  and {len(topic.fields) - _MOST} fields more"


def _field(field: FieldReport, topic: TopicReport, report: ReplayReport, names: tuple[str, str]) -> Iterator[str]:
    yield f"  {field.field}: {_of(field.differing, 'value')} in {_of(topic.differing, 'message')} of {topic.compared}"
    yield f"    first   {_spot(field.first, field, report, names)}"
    if field.largest is not None and field.largest != field.first:
        yield f"    largest {_spot(field.largest, field, report, names)}"


def _spot(spot: Spot, field: FieldReport, report: ReplayReport, names: tuple[str, str]) -> str:
    apart = f", {spot.size:.6g} apart" if spot.size is not None else ""
    where = f" {spot.field}" if spot.field != field.field else ""
    return (
        f"at {_when(spot.time, report)}, message {spot.index}{where}: "
        f"{spot.expected} {names[0]}, {spot.actual} {names[1]}{apart}"
    )


def _when(nanoseconds: int, report: ReplayReport) -> str:
    clock = time.strftime("%H:%M:%S", time.localtime(nanoseconds / 1e9))
    return f"{(nanoseconds - report.begin) * 1e-9:.3f} s ({clock})"


def _of(count: int, what: str) -> str:
    return f"{count:,} {what}{'' if count == 1 else 's'}"
