"""What a test hears of a robot: the messages of all its topics."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

import msgspec
import zenoh

from robo.interfaces import catalogue
from robo.text.brief import brief
from robo.text.unreadable import UNREADABLE
from robo.wire import codec

MOST_BYTES = 32_000_000
"""How much of one topic is kept, bytes; of more the newest."""

_SHOWN = 300
"""How much of a message is shown, characters."""


class _Message(NamedTuple):
    payload: bytes
    encoding: str
    number: int
    """Counts the messages of its topic, from 0."""


class _Topic:
    """The messages of one topic."""

    def __init__(self) -> None:
        self.kept: deque[_Message] = deque()
        self.count = 0
        self._bytes = 0

    def add(self, payload: bytes, encoding: str) -> None:
        self.kept.append(_Message(payload, encoding, self.count))
        self.count += 1
        self._bytes += len(payload)
        while self._bytes > MOST_BYTES and len(self.kept) > 1:
            self._bytes -= len(self.kept.popleft().payload)

    def clear(self) -> None:
        self.kept.clear()
        self._bytes = 0


class Heard:
    """Keeps what comes on a key expression."""

    def __init__(self, session: zenoh.Session, keys: str) -> None:
        self._topics: dict[str, _Topic] = {}
        self._changed = threading.Condition()
        self._subscriber = session.declare_subscriber(keys, self._take)

    def messages(self, key: str) -> list[Any]:
        """All that is kept of a topic, in order."""
        with self._changed:
            topic = self._topics.get(key)
            kept = list(topic.kept) if topic is not None else []
        return [_decoded(message) for message in kept]

    def wait_for(self, key: str, condition: Callable[[Any], bool], timeout: float, *, anew: bool = False) -> Any:
        """The first message of a topic that fulfils a condition, of those that are kept and those to come.

        Args:
            key: of the topic.
            condition: what it has to fulfil.
            timeout: how long to wait, s.
            anew: only of those to come.

        Raises:
            LookupError: there is none in time.
        """
        end = time.monotonic() + timeout
        with self._changed:
            looked = self._topics[key].count - 1 if anew and key in self._topics else -1
        while True:
            with self._changed:
                topic = self._topics.get(key)
                new = [one for one in topic.kept if one.number > looked] if topic is not None else []
                if not new:
                    left = end - time.monotonic()
                    if left <= 0:
                        raise LookupError(key)
                    self._changed.wait(left)
            for message in new:
                looked = message.number
                decoded = _decoded(message)
                if condition(decoded):
                    return decoded

    def wait_for_count(self, key: str, count: int, timeout: float) -> None:
        """Wait until so many messages of a topic are kept.

        Raises:
            LookupError: they do not come in time.
        """

        def there() -> bool:
            return key in self._topics and len(self._topics[key].kept) >= count

        with self._changed:
            if not self._changed.wait_for(there, timeout):
                raise LookupError(key)

    def clear(self) -> None:
        """Forget what has been heard so far."""
        with self._changed:
            for topic in self._topics.values():
                topic.clear()

    def topics(self) -> list[str]:
        """On which topics something has come."""
        with self._changed:
            return sorted(self._topics)

    def last(self) -> list[str]:
        """The last message of each topic, as text."""
        with self._changed:
            newest = {key: (topic.count, topic.kept[-1]) for key, topic in sorted(self._topics.items()) if topic.kept}
        return [f"{key}, message {count}: {_shown(message)}" for key, (count, message) in newest.items()]

    def close(self) -> None:
        """Listen no more."""
        self._subscriber.undeclare()

    def _take(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            with self._changed:
                topic = self._topics.setdefault(str(sample.key_expr), _Topic())
                topic.add(sample.payload.to_bytes(), str(sample.encoding))
                self._changed.notify_all()


def _decoded(message: _Message) -> Any:
    """A message of the type that its encoding names; plain data where nobody here knows the type."""
    kind = catalogue.find_here(message.encoding.partition(";")[2])
    if kind is None:
        return msgspec.msgpack.decode(message.payload)
    return codec.Decoder(kind).decode(message.payload, message.encoding)


def _shown(message: _Message) -> str:
    try:
        text = msgspec.json.encode(msgspec.msgpack.decode(message.payload)).decode()
    except UNREADABLE:
        text = repr(message.payload[:_SHOWN])
    return brief(text, _SHOWN)
