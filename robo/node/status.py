"""What a node has seen so far: its counters as a `NodeStatus`, and the key on which anybody may ask for it."""

import os
import time
from collections.abc import Callable, Sequence

import msgspec
import zenoh

from robo.node.endpoints import Endpoints
from robo.node.identity import Identity
from robo.node.turn import Turn
from robo.node.turns import Turns
from robo.wire import keys, shared_memory
from robo.wire.queries import QueryLoop, reply
from robo.wire.reports import LastWords, NodeStatus, TurnStatus
from robo_messages import DiagnosticStatus

_LONGEST_TIME = 19
"""Digits."""


class Status:
    """Sums up the counters of one node."""

    def __init__(self, full_name: str, turns: Turns, now: Callable[[], float] = time.monotonic) -> None:
        """
        Args:
            full_name: the node's.
            turns: the node's, which know what runs.
            now: the time, s, by the clock that the turns use too.
        """
        self._full_name = full_name
        self._turns = turns
        self._now = now
        self._begun = now()

    def of(self, ends: Endpoints, callback_errors: int, checks: Sequence[DiagnosticStatus] = ()) -> NodeStatus:
        """What there is to say just now; `checks` is what was said last of how well the node does."""
        subscriptions = list(ends.subscriptions)
        now, callbacks = self._now(), self._turns.callbacks
        own = _look(self._turns.own, [], now)
        others = {name: _look(turn, callbacks.get(name, []), now) for name, turn in self._turns.others.items()}
        longest = max((own, *others.values()), key=lambda one: one.running_for)
        return NodeStatus(
            node=self._full_name,
            published={p.topic: p.published for p in list(ends.publishers)},
            received={s.topic: s.received for s in subscriptions},
            malformed={s.topic: s.malformed for s in subscriptions},
            dropped={s.topic: s.dropped for s in subscriptions},
            refused={s.topic: s.refused for s in subscriptions if s.refused},
            callback_errors=callback_errors,
            missed=_missed(ends),
            served={s.key: s.served for s in list(ends.services)},
            uptime=now - self._begun,
            busy=own.busy + sum(turn.busy for turn in others.values()),
            running=longest.running,
            running_for=longest.running_for,
            turns=others,
            checks=list(checks),
        )


class StatusServer:
    """Answers queries on a node's status key, and on that of its last lines where nobody else keeps them."""

    def __init__(
        self,
        session: zenoh.Session,
        identity: Identity,
        status: Callable[[], NodeStatus],
        lines: Callable[[int], LastWords] | None = None,
    ) -> None:
        self._session = session
        self._status = status
        self._lines = lines
        key = keys.status_key(identity.namespace, identity.name)
        self._lines_key = keys.lines_key(identity.namespace, identity.name)
        served, tells = (key, [key]) if lines is None else (f"{key}/**", [key, self._lines_key])
        # Not complete: of two nodes with one name both are asked.
        self._loop = QueryLoop(session, served, self._answer, tells=tells, complete=False)
        self._loop.start()

    def stop(self, timeout: float) -> bool:
        """Take no more queries. Returns whether the last one was answered within `timeout` seconds."""
        return self._loop.stop(timeout)

    def _answer(self, query: zenoh.Query, key: str) -> None:
        if self._lines is not None and key == self._lines_key:
            reply(query, key, self._lines(_time_of(str(query.parameters))))
            return
        info = self._session.info
        status = msgspec.structs.replace(
            self._status(),
            zid=str(info.zid()),
            links=[str(zid) for zid in (*info.routers_zid(), *info.peers_zid())],
            time=time.time_ns(),
            large_messages=shared_memory.way_of(self._session),
            memory=_resident(),
            processor_time=time.process_time(),
        )
        reply(query, key, status)


def _resident() -> int | None:
    """Memory of this process, bytes; None where the system has no /proc."""
    try:
        with open("/proc/self/statm", "rb") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return None


def _time_of(selector: str) -> int:
    """The time that somebody has asked for, ns since the epoch; 0, which is all, where it is none."""
    word = dict(part.partition("=")[::2] for part in selector.split(";")).get("since", "")
    return int(word) if len(word) <= _LONGEST_TIME and word.isascii() and word.isdigit() else 0


def _look(turn: Turn, callbacks: list[str], now: float) -> TurnStatus:
    running = turn.running  # it may end while this looks, and then the time is that of the next one
    running_for = max(0.0, now - turn.since) if running else 0.0
    return TurnStatus(callbacks, turn.busy + running_for, running, running_for)


def _missed(ends: Endpoints) -> dict[str, int]:
    """Ticks that were skipped, by the name of the timers' callback: several timers may have one."""
    missed: dict[str, int] = {}
    for timer in list(ends.timers):
        missed[timer.name] = missed.get(timer.name, 0) + timer.missed
    return missed
