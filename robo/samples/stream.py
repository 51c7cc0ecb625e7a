"""Receiving topics for tools: every message with the time at which it came, in order, without ever
holding up who publishes.

A thread drains Zenoh's channel at once; what the tool has not yet handled waits here, up to a number
of bytes. Beyond it the oldest messages are left out and counted: a tool whose output is slow neither
eats the machine's memory nor makes a robot wait.
"""

import math
import threading
import time
from collections import deque
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import zenoh

from robo.wire import codec
from robo.wire.codec import Attachment
from robo.wire.latched import kept
from robo.wire.qos import KEEP_ALL

MOST_BYTES = 256_000_000
"""What may wait for a tool."""

LONGEST_LOOK = 0.5
"""How long to wait for a latched publisher that does not say what it keeps, s."""

SIGNALS = 0.25
"""How often one who waits without end looks for a signal, s: Python's locks wait on where it came just before."""

_CHANNEL = 10_000
"""Messages that Zenoh may hand over before the thread has run."""


class Arrival(NamedTuple):
    """A message as it came."""

    key: str
    arrived: int
    """By this machine's clock, ns since the epoch."""
    size: int
    """Of the payload, bytes."""
    attachment: Attachment | None
    sample: zenoh.Sample


class Stream:
    """The messages of key expressions, until closed."""

    def __init__(
        self, session: zenoh.Session, keys: Sequence[str], most_bytes: int = MOST_BYTES, *, latched: bool = False
    ) -> None:
        """
        Args:
            session: the network.
            keys: they may overlap: each message comes once.
            most_bytes: what may wait.
            latched: begin with what latched publishers have said last.
        """
        self._most_bytes = most_bytes
        self._waiting: deque[Arrival] = deque()
        self._bytes = 0
        self._changed = threading.Condition()
        self._closed = False
        self.left_out = 0
        """Messages that were not handed out, because too many waited."""
        self._expressions = [zenoh.KeyExpr(key) for key in keys]
        self._first_of: dict[str, int] = {}
        self._subscribers = [
            session.declare_subscriber(key, zenoh.handlers.FifoChannel(_CHANNEL)) for key in self._expressions
        ]
        self._said_before: set[tuple[str, int]] = set()
        """What has come so and may come once more: publisher and number."""
        for number, expression in enumerate(self._expressions if latched else ()):
            for sample in kept(session, str(expression), KEEP_ALL, LONGEST_LOOK):
                self._said_before.update(_numbered(sample))
                self._take(number, sample)
        for number, subscriber in enumerate(self._subscribers):
            threading.Thread(
                target=self._drain, args=(number, subscriber.handler), name="robo-stream", daemon=True
            ).start()

    def get(self, until: float | None = None) -> Arrival | None:
        """The next message; None where none has come until a time by the monotonic clock, or it is closed."""
        end = math.inf if until is None else until
        with self._changed:
            while not self._waiting and not self._closed:
                left = end - time.monotonic()
                if left <= 0:
                    return None
                self._changed.wait(min(left, SIGNALS))
            if not self._waiting:
                return None
            arrival = self._waiting.popleft()
            self._bytes -= arrival.size
            return arrival

    def until(self, end: float | None) -> Iterator[Arrival]:
        """Messages as they come, until a time by the monotonic clock; without end where there is none."""
        while (arrival := self.get(end)) is not None:
            yield arrival
            if end is not None and time.monotonic() >= end:
                return

    @property
    def waiting(self) -> bool:
        """Whether there are more messages at once."""
        return bool(self._waiting)

    def close(self) -> None:
        """End the stream."""
        for subscriber in self._subscribers:
            subscriber.undeclare()
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def _drain(self, number: int, handler: "zenoh.handlers.Handler[zenoh.Sample]") -> None:
        recv = handler.recv
        while True:
            try:
                sample = recv()
            except zenoh.ZError:
                return  # undeclared
            if self._said_before and not self._said_before.isdisjoint(_numbered(sample)):
                continue
            self._take(number, sample)

    def _take(self, number: int, sample: zenoh.Sample) -> None:
        arrived = time.time_ns()
        key = str(sample.key_expr)
        if sample.kind != zenoh.SampleKind.PUT or not self._is_mine(number, key):
            return
        attachment = codec.unpack_attachment(sample.attachment.to_bytes()) if sample.attachment is not None else None
        arrival = Arrival(key, arrived, len(sample.payload), attachment, sample)
        with self._changed:
            self._waiting.append(arrival)
            self._bytes += arrival.size
            while self._bytes > self._most_bytes and len(self._waiting) > 1:
                self._bytes -= self._waiting.popleft().size
                self.left_out += 1
            self._changed.notify()

    def _is_mine(self, number: int, key: str) -> bool:
        """Whether a key is this expression's: the first one that matches it has it."""
        if len(self._expressions) == 1:
            return True
        first = self._first_of.get(key)
        if first is None:
            exact = zenoh.KeyExpr(key)
            first = next(i for i, expression in enumerate(self._expressions) if expression.intersects(exact))
            self._first_of[key] = first
        return first == number


def _numbered(sample: zenoh.Sample) -> list[tuple[str, int]]:
    """Publisher and number of a message, where it says them."""
    source = sample.source_info
    return [(str(source.source_id), source.source_sn)] if source is not None else []
