"""Nodes that no supervisor runs: those of `robo run`, of containers, of Kubernetes. They tell of themselves."""

import time
from collections.abc import Iterable, Iterator
from typing import Literal

import zenoh

from robo.tools import nodes
from robo.tools.replies import read, samples
from robo.wire import names
from robo.wire.keys import NodeToken, lines_key
from robo.wire.reports import LastWords, LogRecord, NodeStatus, ProcessStatus, health_of

_TIMEOUT = 1.0
"""How long they may take to answer, s."""
_PERIOD = 0.5
"""How often they are asked for new lines, s."""
_MARGIN = 1_000_000_000
"""A line may be written a little after its time, ns."""


class Processes:
    """Rows of `robo ps` for such nodes. Figures are of the time since the look before, at first since their start."""

    def __init__(self, session: zenoh.Session, timeout: float = _TIMEOUT) -> None:
        """`timeout` is how long nodes may take to answer, s."""
        self._session, self._timeout = session, timeout
        self._before: dict[tuple[str, int, str], NodeStatus] = {}

    def look(self, there: list[NodeToken], supervised: list[ProcessStatus], namespace: str = "") -> list[ProcessStatus]:
        """Those of the nodes that are there and in a namespace, without those of which supervisors tell."""
        told = {one.node for one in supervised}
        alone = [one for one in of_robot(there, namespace) if one.full_name not in told]
        asked = nodes.all_status(self._session, self._timeout) if alone else {}
        before, self._before = self._before, {}
        found = []
        for token in alone:
            status = asked.get(token.full_name)
            same = token.full_name, token.pid, token.host
            if status is not None:
                self._before[same] = status
            found.append(row_of(token, status, before.get(same)))
        return found


def row_of(token: NodeToken, status: NodeStatus | None, before: NodeStatus | None) -> ProcessStatus:
    """A node as a process. Pure.

    Args:
        token: the node.
        status: what it says of itself; None where it does not answer.
        before: what it said before; None for the first time.
    """
    health, trouble = ("stale", "it does not answer") if status is None else health_of(status.checks)
    return ProcessStatus(
        robot=token.namespace,
        group="",
        node=token.full_name,
        state="ready",
        reason="its supervisor does not answer" if token.run else "",
        pid=token.pid,
        restarts=0,
        uptime=None if status is None else status.uptime,
        cpu=_cpu(status, before),
        memory=None if status is None else status.memory,
        published=_rates("published", status, before),
        received=_rates("received", status, before),
        run=token.run,
        host=token.host,
        running=status.running if status is not None and status.running_for >= nodes.LONG_CALLBACK else "",
        running_for=status.running_for if status is not None else 0.0,
        health=health,
        trouble=trouble,
    )


class Lines:
    """What such nodes of a robot, or of all, have logged, and log from now on."""

    def __init__(self, session: zenoh.Session, namespace: str = "") -> None:
        """`namespace` is the robot's; empty for all."""
        self._session = session
        self._key = lines_key(names.join(namespace, "**"), "*")
        self._asked: dict[str, int] = {}
        """When each node was asked, by its own clock, ns."""
        self._newest: dict[str, int] = {}
        """The time of the last line of each; each node's times only grow."""

    def new(self) -> list[LogRecord]:
        """The lines since the last time, in order; at first all that nodes keep."""
        since = max(0, min(self._asked.values(), default=0) - _MARGIN)
        self._asked.clear()  # who has gone is asked no more
        found: list[LogRecord] = []
        for sample in samples(
            self._session.get(
                f"{self._key}?since={since}", timeout=_TIMEOUT, consolidation=zenoh.ConsolidationMode.NONE
            )
        ):
            told, key = read(sample, LastWords), str(sample.key_expr)
            if told is None:
                continue
            self._asked[key], newest = told.time, self._newest.get(key, 0)
            lines = [line for line in told.lines if line.time > newest]
            self._newest[key] = max((line.time for line in lines), default=newest)
            found += lines
        return sorted(found, key=lambda line: line.time)

    def coming(self) -> Iterator[LogRecord]:
        """Lines as they are logged, without end."""
        while True:
            yield from self.new()
            time.sleep(_PERIOD)


def of_robot(there: Iterable[NodeToken], namespace: str) -> list[NodeToken]:
    """The nodes in a namespace, or in one within that; all where it is empty."""
    return [one for one in there if not namespace or one.full_name.startswith(f"/{namespace}/")]


def _span(status: NodeStatus, before: NodeStatus | None) -> float:
    """How much time figures are of, s."""
    return max(status.uptime - (0.0 if before is None else before.uptime), 1e-9)


def _cpu(status: NodeStatus | None, before: NodeStatus | None) -> float | None:
    """Percent of a core."""
    if status is None or status.processor_time is None:
        return None
    used = status.processor_time - ((before.processor_time or 0.0) if before is not None else 0.0)
    return max(0.0, 100.0 * used / _span(status, before))


def _rates(
    counters: Literal["published", "received"], status: NodeStatus | None, before: NodeStatus | None
) -> dict[str, float]:
    """Messages a second, by topic."""
    if status is None:
        return {}
    counted: dict[str, int] = getattr(status, counters)
    already: dict[str, int] = {} if before is None else getattr(before, counters)
    span = _span(status, before)
    return {topic: max(0.0, (count - already.get(topic, 0)) / span) for topic, count in counted.items()}
