"""The topics that pages show: the newest message of each, as often as a page can be drawn.

Nothing runs for a single message: Zenoh keeps the newest ones of each topic, and a thread looks.
"""

import threading
import time
from collections.abc import Callable, Iterable
from typing import NamedTuple

import zenoh

from robo.wire import codec
from robo.wire.latched import kept

PERIOD = 0.05
"""How often somebody looks, s: of a quicker topic a page shows the newest one 20 times a second."""
_SLOTS = 64
"""Messages of a key that wait for a look. Transforms count all: each may be of other frames."""
_LATCHED_WAIT = 0.5
"""For what latched publishers keep, s."""
_OF_PARTS = "tf2/TFMessage"
"""Of this type the newest message is not all that holds."""
_MOST_KEPT = 32
"""Of a latched topic: it may have as many publishers."""


class Message(NamedTuple):
    """A message as it came."""

    key: str
    encoding: str
    published: int | None
    """ns since the epoch, by the publisher's clock; None where it has not said."""
    arrived: int
    """ns since the epoch, by this machine's clock."""
    payload: bytes

    @property
    def is_of_parts(self) -> bool:
        """Whether others of the same topic hold beside it."""
        return self.encoding.endswith(_OF_PARTS)


class Topics:
    """Receives what is watched."""

    def __init__(self, session: zenoh.Session, deliver: Callable[[list[Message]], None]) -> None:
        """
        Args:
            session: the network.
            deliver: gets what has come, by threads, some 20 times a second.
        """
        self._session = session
        self._deliver = deliver
        self._lock = threading.Lock()
        self._ends: dict[str, zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]]] = {}
        self._heard: set[str] = set()
        """Keys on which something has come since they are watched: what was said before is older."""
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="robo-dashboard-topics", daemon=True)
        self._thread.start()

    def watch(self, keys: Iterable[str]) -> None:
        """Receive these, and no others; of those that are new what latched publishers said last, too.

        Raises:
            zenoh.ZError: one is no key.
        """
        wanted = {key: zenoh.KeyExpr(key) for key in keys}
        with self._lock:
            gone, new = self._ends.keys() - wanted.keys(), wanted.keys() - self._ends.keys()
            for key in gone:
                self._ends.pop(key).undeclare()
                self._heard.discard(key)
            for key in new:
                self._ends[key] = self._session.declare_subscriber(wanted[key], zenoh.handlers.RingChannel(_SLOTS))
        self.say_again(sorted(new))

    def say_again(self, keys: list[str]) -> None:
        """What latched publishers said last is wanted: somebody looks who has not heard it."""
        if keys:
            threading.Thread(target=self._ask, args=(keys,), name="robo-dashboard-latched", daemon=True).start()

    def close(self) -> None:
        """Receive no more."""
        self._over.set()
        self._thread.join()
        with self._lock:
            for end in self._ends.values():
                end.undeclare()
            self._ends.clear()

    def _run(self) -> None:
        while not self._over.wait(PERIOD):
            with self._lock:
                handlers = [end.handler for end in self._ends.values()]
            parts: list[Message] = []
            newest: dict[str, Message] = {}
            for handler in handlers:
                while (sample := handler.try_recv()) is not None:
                    message = _message(sample)
                    if message is None:
                        continue
                    if message.is_of_parts:
                        parts.append(message)
                    else:
                        newest[message.key] = message
            if parts or newest:
                self._heard.update(newest)
                self._deliver([*parts, *newest.values()])

    def _ask(self, keys: list[str]) -> None:
        found: list[Message] = []
        for key in keys:
            try:
                said = kept(self._session, key, _MOST_KEPT, _LATCHED_WAIT)
            except zenoh.ZError:
                return  # the network has been left
            found += [one for one in map(_message, said) if one is not None]
        fresh = [one for one in found if one.is_of_parts or one.key not in self._heard]
        if fresh and not self._over.is_set():
            self._deliver(fresh)


def _message(sample: zenoh.Sample) -> Message | None:
    if sample.kind != zenoh.SampleKind.PUT:
        return None
    stamp = codec.unpack_attachment(sample.attachment.to_bytes()) if sample.attachment is not None else None
    published = stamp.source_time if stamp is not None else None
    payload = sample.payload.to_bytes()
    return Message(str(sample.key_expr), str(sample.encoding), published, time.time_ns(), payload)
