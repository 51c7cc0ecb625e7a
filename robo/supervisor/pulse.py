"""The signs of life of one child: its heartbeats, and what comes on the topics that it publishes."""

from collections.abc import Callable, Iterable, Mapping

import msgspec

from robo.supervisor.topic_watch import Flow
from robo.text.readable import readable
from robo.text.unreadable import UNREADABLE
from robo.wire.reports import EVERY_NODES, Beat, HealthLevel, Input, NodeStatus, check_name, health_of
from robo_messages import DiagnosticStatus

BEAT_PERIOD = 1.0
"""How often nodes give a sign of life, s; more often where the watchdog is shorter than a few of these."""

_AT_REST = ("", "unconfigured", "inactive", "active", "finalized")
"""States of a managed node, or of none, in which no hook runs."""

_FRESH = 3 * BEAT_PERIOD
"""For how long a rate is shown after the last sign of life, s; and what a node said last counts for so long."""

_TO_NOTICE = 2.0
"""How long a check of a node's own may take to notice what ails it, s: it is asked once a second, and machines are
busy."""


def beat_period(watchdog: float) -> float:
    """The time between two beats of a node that hangs after `watchdog` s without one; 0 for never, s."""
    return min(BEAT_PERIOD, watchdog / 4) if watchdog else BEAT_PERIOD


class Pulse:
    """What one child has said of itself since its start. Times are of any clock that does not step back, s."""

    def __init__(
        self,
        watchdog: float,
        publishes: Iterable[str],
        flow: Callable[[str], Flow | None],
        now: float,
        hooks: float = 0.0,
    ) -> None:
        """
        Args:
            watchdog: after how long without a sign of life it hangs, s; 0 for never.
            publishes: the topics that it is known to publish, as long as it has not said so itself.
            flow: what comes on a topic; None where nothing is promised of it.
            now: when it was started.
            hooks: how long a hook of a managed node may take instead, s; 0 for ever.
        """
        self._watchdog = watchdog
        self._hooks = hooks
        self._publishes = tuple(publishes)
        self._flow = flow
        self._started_at = self._ready_at = self._heard_at = self._said_at = self._excused_at = now
        self._counted: Beat | None = None
        """The beat since which messages are counted for the next rate."""
        self._counted_at = now
        self._beat: Beat | None = None
        self._late: Beat | None = None
        """What it says while a callback holds its beat back."""
        self._rates: tuple[dict[str, float], dict[str, float]] = {}, {}
        self._input_seen: dict[str, tuple[int, float]] = {}
        self.cpu: float | None = None
        """The processor time that it uses, in percent of one core; None where that is all that its process uses."""

    def became_ready(self, now: float) -> None:
        """From now on it is held to its promises."""
        self._ready_at = self._heard_at = now

    def excuse_silence(self, now: float) -> None:
        """The supervisor itself has slept: nobody can be blamed for beats that it did not hear."""
        self._heard_at = self._said_at = now

    def hear(self, data: bytes, now: float) -> Beat | None:
        """A beat has come; None where it means nothing: a command may write something else there."""
        try:
            beat = msgspec.msgpack.decode(data, type=readable(Beat))
        except UNREADABLE:
            return None
        self._late = beat if beat.late else None
        self._said_at = now
        if _own_trouble(beat.status.checks) is not None:
            self._excused_at = now
        if beat.late:
            return beat
        self._count(beat, now)
        for topic, count in beat.status.received.items():
            if self._input_seen.get(topic, (-1, 0.0))[0] != count:
                self._input_seen[topic] = (count, now)
        self._beat, self._heard_at = beat, now
        return beat

    def _count(self, beat: Beat, now: float) -> None:
        """Work out rates, over about the time between two beats: a managed node also has some with each new state."""
        old, span = self._counted, now - self._counted_at
        if old is None or span > 0.5 * beat_period(self._watchdog):
            self._counted, self._counted_at = beat, now
            if old is not None:
                self._rates = (
                    _rates(old.status.published, beat.status.published, span),
                    _rates(old.status.received, beat.status.received, span),
                )
            if beat.cpu is not None:
                before = old.cpu if old is not None and old.cpu is not None else beat.cpu
                self.cpu = round(100 * (beat.cpu - before) / span, 1) if span > 0 else 0.0

    def hang(self, now: float) -> str | None:
        """Why it hangs: its beats have ceased."""
        silent = now - self._heard_at
        limit = self._watchdog if self.lifecycle in _AT_REST else self._hooks
        if not (self._watchdog and limit) or self._beat is None or silent <= max(limit, self._watchdog):
            return None
        running = self._late.status.running if self._late is not None else ""
        return f"hangs: no sign of life for {silent:.1f} s" + (f"; {running} does not return" if running else "")

    def problem(self, now: float) -> str | None:
        """Which promise about its topics is not kept."""
        if now - self._ready_at < 2 * BEAT_PERIOD:
            return None  # its topics have to come first
        problems = (flow.problem(now, self._ready_at) for flow in self._flows())
        problem = next((problem for problem in problems if problem is not None), None)
        if problem is None or (trouble := _own_trouble(self.checks)) is None:
            return problem
        return f"{problem}; {check_name(trouble)}: {trouble.message}"

    def silent_topic(self, now: float) -> str | None:
        """Why it hangs: nothing comes on a topic that it promised, for as long as the watchdog allows.

        The time does not count in which a check of its own said what ails it, such as a port that is not there: it is
        alive and knows, and a new one would have to wait for the same. A node with such checks has the time to say so.
        """
        limit = self._watchdog
        if _own(self.checks):
            limit = max(limit, _TO_NOTICE + beat_period(self._watchdog))
        for flow in self._flows():
            silent = flow.silent(now, max(self._ready_at, self._excused_at)) or 0.0
            if self._watchdog and silent > limit:
                return f"hangs: nothing on {flow.promise.key} for {silent:.1f} s"
        return None

    def rates(self, now: float) -> tuple[dict[str, float], dict[str, float]]:
        """Messages per second that it publishes and receives, by topic; none where its last word is old."""
        return self._rates if now - self._heard_at < _FRESH else ({}, {})

    @property
    def lifecycle(self) -> str:
        """The state of a managed node, as it said last; empty for a plain node, and before the first beat."""
        return self._beat.status.lifecycle if self._beat is not None else ""

    @property
    def held_up(self) -> NodeStatus | None:
        """What it says while a callback holds its beat back."""
        return self._late.status if self._late is not None else None

    @property
    def checks(self) -> list[DiagnosticStatus]:
        """What it said last of how well it does."""
        beat = self._late or self._beat
        return beat.status.checks if beat is not None else []

    def health(self, now: float) -> tuple[HealthLevel | None, str]:
        """What that comes to: see `health_of`."""
        silent = now - self._said_at
        if self._beat is not None and silent > _FRESH:
            return "stale", f"has said nothing for {silent:.1f} s"
        return health_of(self.checks)

    @property
    def callback_errors(self) -> int:
        """Exceptions that its callbacks raised."""
        return self._beat.status.callback_errors if self._beat is not None else 0

    def inputs(self, now: float) -> list[Input]:
        """The topics that it subscribes."""
        if self._beat is None:
            return []
        status = self._beat.status
        return [
            Input(
                topic=topic,
                received=count,
                age=round(now - (self._input_seen[topic][1] if count else self._started_at), 3),
                malformed=status.malformed.get(topic, 0),
                dropped=status.dropped.get(topic, 0),
            )
            for topic, count in status.received.items()
        ]

    def _flows(self) -> Iterable[Flow]:
        said = self._beat.status.published if self._beat is not None else {}
        return (flow for key in said or self._publishes if (flow := self._flow(key)) is not None)


def _own_trouble(checks: Iterable[DiagnosticStatus]) -> DiagnosticStatus | None:
    """The first error that a check of the node's own has found."""
    return next((one for one in _own(checks) if one.level == DiagnosticStatus.ERROR), None)


def _own(checks: Iterable[DiagnosticStatus]) -> list[DiagnosticStatus]:
    """What checks of the node's own have found, well or not."""
    return [one for one in checks if check_name(one) not in EVERY_NODES]


def _rates(old: Mapping[str, int], new: Mapping[str, int], span: float) -> dict[str, float]:
    return {topic: round((count - old.get(topic, 0)) / span, 1) for topic, count in new.items()}
