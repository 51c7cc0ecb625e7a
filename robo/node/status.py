"""What a node has seen so far: its counters as a `NodeStatus`, and the key on which anybody may ask for it."""

import time
from collections.abc import Callable

import msgspec
import zenoh

from robo.node.endpoints import Endpoints
from robo.node.identity import Identity
from robo.node.turn import Turn
from robo.wire import keys
from robo.wire.queries import QueryLoop, reply
from robo.wire.reports import NodeStatus


class Status:
    """Sums up the counters of one node."""

    def __init__(self, full_name: str, turn: Turn, now: Callable[[], float] = time.monotonic) -> None:
        """
        Args:
            full_name: the node's.
            turn: the node's, which knows what runs.
            now: the time, s, by the clock that the turn uses too.
        """
        self._full_name = full_name
        self._turn = turn
        self._now = now
        self._begun = now()

    def of(self, ends: Endpoints, callback_errors: int) -> NodeStatus:
        """What there is to say just now."""
        subscriptions = list(ends.subscriptions)
        turn, now = self._turn, self._now()
        running = turn.running  # it may end while this looks, and then the time is that of the next one
        running_for = max(0.0, now - turn.since) if running else 0.0
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
            busy=turn.busy + running_for,
            running=running,
            running_for=running_for,
        )


class StatusServer:
    """Answers queries on a node's status key."""

    def __init__(self, session: zenoh.Session, identity: Identity, status: Callable[[], NodeStatus]) -> None:
        self._session = session
        self._status = status
        key = keys.status_key(identity.namespace, identity.name)
        # Not complete: of two nodes with one name both are asked.
        self._loop = QueryLoop(session, key, self._answer, tells=[key], complete=False)
        self._loop.start()

    def stop(self, timeout: float) -> bool:
        """Take no more queries. Returns whether the last one was answered within `timeout` seconds."""
        return self._loop.stop(timeout)

    def _answer(self, query: zenoh.Query, key: str) -> None:
        info = self._session.info
        status = msgspec.structs.replace(
            self._status(),
            zid=str(info.zid()),
            links=[str(zid) for zid in (*info.routers_zid(), *info.peers_zid())],
            time=time.time_ns(),
        )
        reply(query, key, status)


def _missed(ends: Endpoints) -> dict[str, int]:
    """Ticks that were skipped, by the name of the timers' callback: several timers may have one."""
    missed: dict[str, int] = {}
    for timer in list(ends.timers):
        missed[timer.name] = missed.get(timer.name, 0) + timer.missed
    return missed
