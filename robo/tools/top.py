"""What a live view of a system shows: nodes with their processes, topics with their flow."""

import time

import msgspec
import zenoh

from robo.samples.meters import Meter
from robo.samples.stream import Arrival, Stream
from robo.tools import nodes, runs, topics, unsupervised
from robo.wire.reports import HealthLevel, ProcessStatus

STALE_PERIODS = 5.0
"""A topic is stale when its last message is so many times older than what is usual between two."""
LEAST_STALE = 1.0
"""A younger message is never stale, s."""
_STATUS_TIMEOUT = 0.2
"""How long a node that no supervisor runs may take to tell how it is, s."""
_SMOOTHING = 0.2
"""How much the newest time between two messages counts for what is usual."""


class NodeFigures(msgspec.Struct, frozen=True):
    """A node or another process of a run."""

    node: str
    state: str
    reason: str
    pid: int | None
    host: str
    cpu: float | None
    """% of a core."""
    memory: int | None
    """Bytes."""
    restarts: int | None
    """None for a node that no supervisor runs."""
    uptime: float | None
    """s."""
    running: str = ""
    """The callback that holds up all others of the node; empty while none does."""
    running_for: float = 0.0
    """How long it has been running, s."""
    health: HealthLevel | None = None
    """What its checks come to; None where it has said nothing of them."""
    trouble: str = ""
    """The worst check, and what it says; empty where all is well."""


class TopicFigures(msgspec.Struct, frozen=True):
    """A topic and what came on it."""

    key: str
    types: list[str]
    publishers: int
    subscribers: int
    rate: float
    """Messages a second, as published."""
    bandwidth: float
    """Bytes a second."""
    age: float | None
    """Since the last message came, s; None where none has come."""
    stale: bool
    """The last message is far older than the topic's own pace."""
    lost: int
    """Messages that were published and did not come, since the beginning."""
    count: int
    """Messages that came, since the beginning."""


class Snapshot(msgspec.Struct, frozen=True):
    """One look at a system."""

    time: int
    """ns since the epoch."""
    interval: float
    """Over how long rates were measured, s."""
    nodes: list[NodeFigures]
    topics: list[TopicFigures]


class Traffic:
    """What has come on one topic. Pure: who tells it of messages tells it the time."""

    def __init__(self, key: str, publishers: int = 1) -> None:
        self._meter = Meter(key, publishers)
        self._seen_lost = 0
        self._count = 0
        self._bytes = 0
        self._last: float | None = None
        self._period: float | None = None

    def add(self, arrival: Arrival, now: float) -> None:
        """Count a message; `now` in s by a monotonic clock."""
        number, published = arrival.attachment or (None, arrival.arrived)
        self._meter.add(number, published, arrival.arrived, arrival.size)
        self._count += 1
        self._bytes += arrival.size
        if self._last is not None:
            gap = now - self._last
            self._period = gap if self._period is None else self._period + _SMOOTHING * (gap - self._period)
        self._last = now

    def figures(self, topic: topics.Topic, interval: float, now: float) -> TopicFigures:
        """The figures since the last time this was asked."""
        published = self._count + self._meter.total_lost - self._seen_lost
        age = None if self._last is None else max(0.0, now - self._last)
        result = TopicFigures(
            topic.key,
            topic.types,
            len(topic.publishers),
            len(topic.subscribers),
            published / interval,
            self._bytes / interval,
            age,
            self._is_stale(age),
            self._meter.total_lost,
            self._meter.total_count,
        )
        self._seen_lost = self._meter.total_lost
        self._count = self._bytes = 0
        self._meter.forget()
        return result

    def _is_stale(self, age: float | None) -> bool:
        if age is None or self._period is None:  # a single message has no pace
            return False
        return age > max(LEAST_STALE, STALE_PERIODS * self._period)


class Watch:
    """Looks at a system again and again."""

    def __init__(self, session: zenoh.Session, namespace: str, timeout: float) -> None:
        """`namespace` is the robot's; empty for all."""
        self._session = session
        self._namespace = namespace
        self._timeout = timeout
        self._stream = Stream(session, [f"{namespace}/**" if namespace else "**"])
        self._flows: dict[str, Traffic] = {}
        self._publishers: dict[str, int] = {}
        self._begin = time.monotonic()
        self._alone = unsupervised.Processes(session, min(timeout, _STATUS_TIMEOUT))

    def take_in(self, until: float) -> None:
        """Receive until a time by the monotonic clock."""
        while (arrival := self._stream.get(until)) is not None:
            flow = self._flows.get(arrival.key)
            if flow is None:
                flow = self._flows[arrival.key] = Traffic(arrival.key, self._publishers.get(arrival.key, 1))
            behind = (time.time_ns() - arrival.arrived) * 1e-9
            now = time.monotonic()
            flow.add(arrival, now - max(0.0, behind))
            if now >= until:
                return

    def look(self) -> Snapshot:
        """The figures since the last look."""
        now = time.monotonic()
        interval = max(now - self._begin, 1e-6)
        self._begin = now
        known = {topic.key: topic for topic in topics.list_topics(self._session, self._timeout, ())}
        self._publishers = {key: len(topic.publishers) for key, topic in known.items()}
        found = []
        for key in sorted({*filter(self._is_wanted, known), *self._flows}):
            topic = known.get(key) or topics.Topic(key, "", [], [], [])
            flow = self._flows.setdefault(key, Traffic(key, len(topic.publishers)))
            found.append(flow.figures(topic, interval, now))
            if key not in known and not found[-1].count:
                del self._flows[key]
        return Snapshot(time.time_ns(), interval, self._nodes(), found)

    def close(self) -> None:
        """Receive no more."""
        self._stream.close()

    def _is_wanted(self, key: str) -> bool:
        return not self._namespace or key.startswith(f"{self._namespace}/")

    def _nodes(self) -> list[NodeFigures]:
        processes = runs.processes(self._session, timeout=self._timeout)
        there = nodes.list_nodes(self._session, self._timeout)
        found = [*processes, *self._alone.look(there, processes, self._namespace)]
        return sorted(
            (_figures(one) for one in found if self._is_wanted(one.node.strip("/"))), key=lambda one: one.node
        )


def _figures(status: ProcessStatus) -> NodeFigures:
    return NodeFigures(
        status.node,
        status.state,
        status.reason,
        status.pid,
        status.host,
        status.cpu,
        status.memory,
        status.restarts if status.run else None,
        status.uptime,
        status.running,
        status.running_for,
        status.health,
        status.trouble,
    )
