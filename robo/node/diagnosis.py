"""What a node's counters say of how well it does. Pure, from what was seen once a second to diagnostic statuses."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping, Set

import msgspec

from robo.text.brief import brief
from robo.wire.reports import EVERY_NODES, NodeStatus
from robo_messages.diagnostic import DiagnosticStatus, KeyValue

PERIOD = 1.0
"""How often a node looks at itself and reports, s; ROS's period too."""

WINDOW = 5
"""Over how many periods rates are measured and troubles are told, as in ROS's FrequencyStatus."""

LONG_CALLBACK = 1.0
"""A callback that holds its turn for longer is a warning, s."""

HANGING = 5.0
"""One that does so just now is an error, s: the watchdog's default."""

TOLERANCE = 0.1
"""By which part a deadline may be missed before that is told, as in ROS's FrequencyStatus."""

SKIPPED = 0.1
"""The part of its ticks that a timer may skip before that is told: a machine that is busy for a moment skips some."""

MOST_VALUES = 100
"""A status has no more figures: a node may have a thousand topics."""

OK, WARN, ERROR, STALE = (
    DiagnosticStatus.OK,
    DiagnosticStatus.WARN,
    DiagnosticStatus.ERROR,
    DiagnosticStatus.STALE,
)

TOPICS, CALLBACKS = EVERY_NODES

Trouble = tuple[int, str]
"""A level, and what is wrong, in words."""


class Look(msgspec.Struct, frozen=True):
    """What there was to see at one moment."""

    wall: float
    """The wall's monotonic clock, s."""
    time: float
    """The node's clock, s, which may be simulated."""
    jumps: int
    """How often that one was set instead of gone on."""
    status: NodeStatus
    longest: float = 0.0
    """For how long the longest callback since the look before has held its turn, s."""
    longest_of: str = ""
    """Which one that was."""


class Promises(msgspec.Struct, frozen=True):
    """What is known of a node's topics beside their counters; by key."""

    published: Mapping[str, float] = {}
    """Deadlines of publishers, s."""
    received: Mapping[str, float] = {}
    """Deadlines of subscriptions, s."""
    newest_only: Set[str] = frozenset()
    """Subscriptions with a depth of 1: what they drop is dropped on purpose."""
    apart: Set[str] = frozenset()
    """What every node publishes, of which nothing is told here."""
    ticks: Mapping[str, float] = {}
    """How often timers tick, by the name of their callback, Hz."""


class Diagnosis:
    """Looks back over a few seconds of one node."""

    def __init__(self, begin: Look) -> None:
        self._looks: deque[Look] = deque([begin], maxlen=WINDOW + 1)
        self._grew: dict[tuple[str, str], float] = {}
        """By counter and topic when it was last seen to have grown, by the node's clock, s."""
        self._begin = begin.time

    def of(self, look: Look, promises: Promises) -> list[DiagnosticStatus]:
        """The two statuses that every node has, `topics` and `callbacks`; without the node's name.

        Args:
            look: the newest one, a period after the one before.
            promises: what is known of its topics.
        """
        if look.jumps != self._looks[-1].jumps:  # what was seen before says nothing of how long ago it was
            self._grew, self._begin = {}, look.time
        self._note_growth(look)
        self._looks.append(look)
        return [self._topics(promises), self._callbacks(promises)]

    def _note_growth(self, look: Look) -> None:
        last, new = self._looks[-1].status, look.status
        for kind, before, counts in (("pub", last.published, new.published), ("sub", last.received, new.received)):
            for topic, count in counts.items():
                if count != before.get(topic, 0):
                    self._grew[kind, topic] = look.time

    @property
    def _span(self) -> float:
        return max(self._looks[-1].wall - self._looks[0].wall, 1e-9)

    def _topics(self, promises: Promises) -> DiagnosticStatus:
        old, new = self._looks[0].status, self._looks[-1].status
        out = {key: n - old.published.get(key, 0) for key, n in new.published.items() if key not in promises.apart}
        into = {key: n - old.received.get(key, 0) for key, n in new.received.items()}
        troubles: list[Trouble] = []
        if new.lifecycle in ("", "active"):
            troubles += self._late("pub", new.published, promises.published)
            troubles += self._late("sub", new.received, promises.received)
        troubles += self._lost(promises)
        values = [KeyValue(f"{key} published", f"{n / self._span:.1f} Hz") for key, n in out.items()]
        values += [
            KeyValue(f"{key} received", f"{n / self._span:.1f} Hz{_kept_out(new, key)}") for key, n in into.items()
        ]
        fine = f"{sum(into.values()) / self._span:.1f} Hz in, {sum(out.values()) / self._span:.1f} Hz out"
        return _summed(TOPICS, troubles, fine, values)

    def _late(self, kind: str, counts: Mapping[str, int], deadlines: Mapping[str, float]) -> Iterable[Trouble]:
        """Which deadlines were missed for sure, as far as counts tell: nobody has noted when each message went."""
        old, new = self._looks[0], self._looks[-1]
        before = old.status.published if kind == "pub" else old.status.received
        for topic, deadline in deadlines.items():
            count = counts.get(topic, 0)
            if kind == "sub" and not count:
                continue  # what it hears of may have yet to come
            came = count - before.get(topic, 0)
            gap = max(
                new.time - self._grew.get((kind, topic), self._begin),
                # Of n messages in a span two stand as far apart as n + 1 equal parts of it, or further.
                (new.time - max(old.time, self._begin)) / (came + 1),
            )
            if gap > deadline * (1.0 + TOLERANCE):
                word = "published" if kind == "pub" else "received"
                text = f"nothing {word} on {topic} for {gap:.3g} s, its deadline is {deadline:g} s"
                yield (WARN if came else ERROR), text

    def _lost(self, promises: Promises) -> Iterable[Trouble]:
        old, new = self._looks[0].status, self._looks[-1].status
        for word, before, counts in (
            ("fell behind by", old.dropped, new.dropped),
            ("could not read", old.malformed, new.malformed),
            ("left out", _refused(old), _refused(new)),
        ):
            for topic, count in counts.items():
                grown = count - before.get(topic, 0)
                if grown > 0 and not (counts is new.dropped and topic in promises.newest_only):
                    yield WARN, f"{word} {_messages(grown)} on {topic} in {self._span:.0f} s"

    def _callbacks(self, promises: Promises) -> DiagnosticStatus:
        old, new = self._looks[0].status, self._looks[-1].status
        longest = max(list(self._looks)[1:], key=lambda look: look.longest)
        troubles: list[Trouble] = []
        if new.running_for >= LONG_CALLBACK:
            level = ERROR if new.running_for >= HANGING else WARN
            troubles.append((level, f"{new.running} has been running for {new.running_for:.1f} s"))
        raised = new.callback_errors - old.callback_errors
        if raised > 0:
            troubles.append((ERROR, f"raised {raised} exceptions in {self._span:.0f} s" if raised > 1 else "raised"))
        if longest.longest >= LONG_CALLBACK:
            troubles.append((WARN, f"{longest.longest_of} held up the others for {longest.longest:.1f} s"))
        for timer, count in new.missed.items():
            skipped = count - old.missed.get(timer, 0)
            due = promises.ticks.get(timer, 0.0) * max(0.0, self._looks[-1].time - self._looks[0].time)
            if skipped > SKIPPED * due:
                troubles.append((WARN, f"{timer} skipped {_ticks(skipped)} in {self._span:.0f} s"))
        load = max(0.0, new.busy - old.busy) / self._span
        values = [
            KeyValue("load", f"{load:.1%}"),
            KeyValue("longest", f"{longest.longest * 1e3:.1f} ms, {longest.longest_of}" if longest.longest_of else "-"),
            KeyValue("skipped ticks", str(sum(new.missed.values()))),
            KeyValue("exceptions", str(new.callback_errors)),
        ]
        if new.lifecycle:
            values.append(KeyValue("lifecycle", new.lifecycle))
        return _summed(CALLBACKS, troubles, f"busy for {load:.1%} of the time", values)


def named(full_name: str, name: str, one: DiagnosticStatus) -> DiagnosticStatus:
    """A status of a node under the name that the world knows it by, `/r1/base: battery`, as ROS's updater has it.

    Its texts may quote anything; they become such as can be sent, and read.
    """
    values = [KeyValue(_sendable(value.key), _sendable(value.value)) for value in one.values[:MOST_VALUES]]
    left_out = len(one.values) - MOST_VALUES
    if left_out > 0:
        values.append(KeyValue("…", f"and {left_out} more"))
    return DiagnosticStatus(one.level, f"{full_name}: {name}", _sendable(one.message), values=values)


def _summed(name: str, troubles: Iterable[Trouble], fine: str, values: list[KeyValue]) -> DiagnosticStatus:
    """A status of the worst level of what is wrong, the worst first."""
    found = sorted(troubles, key=lambda trouble: -trouble[0])
    level = found[0][0] if found else OK
    message = "; ".join(text for _, text in found) or fine
    return DiagnosticStatus(level, name, message, values=values)


def _kept_out(status: NodeStatus, topic: str) -> str:
    """How many messages of a topic have not come to the callback so far, and why not."""
    counts = {
        "dropped": status.dropped.get(topic, 0),
        "malformed": status.malformed.get(topic, 0),
        "left out": _refused(status).get(topic, 0),
    }
    return "".join(f", {count} {word}" for word, count in counts.items() if count)


def _refused(status: NodeStatus) -> dict[str, int]:
    return {topic: sum(one.count for one in refused) for topic, refused in status.refused.items()}


def _messages(count: int) -> str:
    return "1 message" if count == 1 else f"{count} messages"


def _ticks(count: int) -> str:
    return "1 tick" if count == 1 else f"{count} ticks"


def _sendable(text: str) -> str:
    return brief(text).encode("utf-8", "replace").decode()
