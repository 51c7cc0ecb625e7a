"""Whether promises about topics are kept: the supervisor counts the messages of the topics concerned."""

import math
import time
from collections import deque
from collections.abc import Iterable
from functools import partial

import zenoh

from robo.launch.plan import ProcessPlan, TopicPlan

_WINDOW = 2.0
"""Over how long a rate is measured at least, s."""
_TOLERANCE = 0.9
"""A rate is kept from this part of it on: messages do not come evenly."""


class Flow:
    """How much comes on one topic; times in s, of any clock that does not step back."""

    def __init__(self, promise: TopicPlan, now: float) -> None:
        self.promise = promise
        self.count = 0
        self.last = now
        """When the last message came; before there is one, when the watch began."""
        self._window = max(_WINDOW, 3.0 / promise.min_rate if promise.min_rate else 0.0)
        self._marks: deque[tuple[float, int]] = deque([(now, 0)])

    def begin(self, now: float) -> None:
        """The watch begins: what was before does not count."""
        self.last = now
        self._marks = deque([(now, self.count)])

    def add(self, now: float) -> None:
        """A message has come."""
        self.count += 1
        self.last = now

    def mark(self, now: float) -> None:
        """Remember how many there are; called a few times a second."""
        self._marks.append((now, self.count))
        while len(self._marks) > 2 and now - self._marks[1][0] >= self._window:
            self._marks.popleft()

    def silent(self, now: float, since: float = -math.inf) -> float | None:
        """For how long nothing has come, where that is longer than is promised, s.

        Args:
            now: the time.
            since: when its publisher became ready: silence before that does not count.
        """
        promise, age = self.promise, now - max(self.last, since)
        limit = promise.max_age if promise.max_age is not None else self._window if promise.min_rate else None
        return age if limit is not None and age > limit else None

    def problem(self, now: float, since: float = -math.inf) -> str | None:
        """Which promise is not kept.

        Args:
            now: the time.
            since: when its publisher became ready: what was before that does not count.
        """
        promise = self.promise
        silent = self.silent(now, since)
        if silent is not None:
            return f"nothing on {promise.key} for {silent:.1f} s"
        begin, before = next((mark for mark in self._marks if mark[0] >= since), (now, self.count))
        if promise.min_rate is not None and now - begin >= self._window:
            rate = (self.count - before) / (now - begin)
            if rate < promise.min_rate * _TOLERANCE:
                return f"{promise.key} comes at {rate:.1f} Hz, promised are {promise.min_rate:g}"
        return None

    def flows(self, now: float) -> bool:
        """Whether data come as they should: for readiness."""
        begin, before = self._marks[0]
        if self.promise.min_rate is None:
            return self.count > before
        needed = max(2.0, min(self.promise.min_rate, 10.0))
        came, span = self.count - before, now - begin
        return came >= needed and came >= self.promise.min_rate * _TOLERANCE * span


def promises(topics: Iterable[TopicPlan], processes: Iterable[ProcessPlan]) -> list[TopicPlan]:
    """The topics whose messages are counted: something is promised of them, or somebody waits for them to be ready."""
    promised = (one for one in topics if one.min_rate is not None or one.max_age is not None)
    found = {one.key: one for one in promised if not one.external}
    for process in processes:
        for key in process.ready.topics:
            found.setdefault(key, TopicPlan(key=key, source=process.source))
    return list(found.values())


class TopicWatch:
    """The flows of all topics that somebody has promised something of, or waits for; nothing comes before `begin`."""

    def __init__(self, promises: Iterable[TopicPlan]) -> None:
        now = time.monotonic()
        self.flows = {promise.key: Flow(promise, now) for promise in promises}
        """By key."""
        self._subscribers: list[object] = []

    def begin(self, session: zenoh.Session) -> None:
        """Begin to count what comes."""
        for key, flow in self.flows.items():
            flow.begin(time.monotonic())
            self._subscribers.append(session.declare_subscriber(key, partial(_count, flow)))

    def mark(self, now: float) -> None:
        """Remember how much has come; called a few times a second."""
        for flow in self.flows.values():
            flow.mark(now)


def _count(flow: Flow, _: zenoh.Sample) -> None:
    flow.add(time.monotonic())
