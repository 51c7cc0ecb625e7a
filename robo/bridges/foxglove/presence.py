"""Who is on the network: the tokens of nodes, and who hears that others have come or gone."""

import threading
from collections.abc import Callable

import zenoh

from robo.bridges.foxglove.offered import MOST_TOKENS
from robo.wire import liveliness
from robo.wire.keys import ALL_TOKENS, EndpointToken, NodeToken, parse_token


class Presence:
    """Knows the ends of all nodes. Any thread may ask."""

    def __init__(self, session: zenoh.Session, changed: Callable[[], None]) -> None:
        """`changed` is called by Zenoh's threads, and does not wait."""
        self._changed = changed
        self._lock = threading.Lock()
        self._ends: dict[str, EndpointToken] = {}
        self._nodes: set[str] = set()
        self._published: dict[str, int] = {}
        at_once = zenoh.handlers.Callback(self._notice, indirect=False)
        self._subscriber = liveliness.hear(session, ALL_TOKENS, at_once)

    def ends(self) -> list[EndpointToken]:
        """All publishers, subscriptions, services and so on."""
        with self._lock:
            return list(self._ends.values())

    def nodes(self) -> frozenset[str]:
        """The full names of all nodes that are ready."""
        with self._lock:
            return frozenset(self._nodes)

    def is_published(self, topic: str) -> bool:
        """Whether a node publishes a topic, by its key."""
        return self._published.get(topic, 0) > 0

    def close(self) -> None:
        """Look no more."""
        self._subscriber.undeclare()

    def _notice(self, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        token = parse_token(key)
        is_there = sample.kind == zenoh.SampleKind.PUT
        with self._lock:
            if isinstance(token, NodeToken):
                (self._nodes.add if is_there else self._nodes.discard)(token.full_name)
            elif not isinstance(token, EndpointToken) or (is_there and len(self._ends) >= MOST_TOKENS):
                return
            elif is_there != (key in self._ends):
                if token.kind == "pub":
                    self._published[token.topic] = self._published.get(token.topic, 0) + (1 if is_there else -1)
                if is_there:
                    self._ends[key] = token
                else:
                    del self._ends[key]
        self._changed()
