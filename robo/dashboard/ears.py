"""Who else is at the topic by which pages drive a robot: who listens to it, and who else speaks there."""

from typing import Any

import zenoh

from robo.wire import keys, liveliness
from robo.wire.keys import EndpointToken

_MOST_NAMES = 200
"""Of a topic: a stranger that announces himself again and again fills no memory."""


class Ears:
    """What the network says of one topic. All but its construction and `close` returns at once."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        """
        Args:
            session: the network.
            key: of the topic.
        """
        self._names: dict[str, str] = {}
        self._listeners: set[str] = set()
        self._announced = self._is_plain = False
        # One's own ears do not count: they hear the whole network.
        self._asking = session.declare_publisher(key, allowed_destination=zenoh.Locality.REMOTE)
        meet = zenoh.handlers.Callback(self._meet, indirect=False)
        self._ends: list[Any] = [
            liveliness.hear(session, pattern(key), meet)
            for pattern in (keys.tokens_of_publishers, keys.tokens_of_subscribers)
        ]

    @property
    def somebody_listens(self) -> bool:
        """Whether the robot does: by its node's announcement where there has been one, else whether anybody does.

        One that has been heard without any announcement is a plain client of Zenoh's: what comes and goes beside it,
        such as somebody who looks at the topic, says nothing of it.
        """
        if self._listeners:
            return True
        status: Any = self._asking.matching_status
        self._is_plain = bool(status.matching) and (self._is_plain or not self._announced)
        return self._is_plain

    def name(self, source: str) -> str:
        """The full name of the node that speaks; empty where it has not been announced.

        Args:
            source: its id, as `source_id` makes it.
        """
        return self._names.get(source, "")

    def close(self) -> None:
        """Listen no more."""
        for end in (*self._ends, self._asking):
            end.undeclare()

    def _meet(self, sample: zenoh.Sample) -> None:
        """On Zenoh's own thread."""
        said, comes = str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT
        token = keys.parse_token(said)
        if not isinstance(token, EndpointToken):
            return
        if token.kind == "pub":
            if comes and len(self._names) < _MOST_NAMES:
                self._names[token.id] = token.full_name
            elif not comes:
                self._names.pop(token.id, None)
        elif comes and len(self._listeners) < _MOST_NAMES:
            self._announced = True
            self._listeners.add(said)
        elif not comes:
            self._listeners.discard(said)
