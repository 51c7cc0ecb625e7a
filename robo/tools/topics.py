"""Looking at topics: which there are, what they carry, how often."""

import math
import statistics
import threading
import time
from collections.abc import Iterator
from itertools import pairwise

import msgspec
import zenoh

from robo import codec
from robo.codec import Malformed
from robo.discovery import ALL_TOKENS, EndpointToken, parse_token


class Topic(msgspec.Struct, frozen=True):
    """A topic that somebody publishes or subscribes."""

    key: str
    types: list[str]
    """More than one is a clash."""
    publishers: list[str]
    """Full names of nodes."""
    subscribers: list[str]


class Received(msgspec.Struct, frozen=True):
    """One sample as it came."""

    key: str
    type: str
    """From the encoding; empty where the publisher does not say."""
    time: int
    """When it was published, ns since the epoch; when it came, where the publisher does not say."""
    sequence_number: int | None
    message: object
    """Plain data; None where the payload cannot be read."""
    error: str | None = None


class Rate(msgspec.Struct, frozen=True):
    """How often messages were published within a window."""

    key: str
    rate: float
    """Hz, from the times at which they were published."""
    count: int
    min: float
    """Shortest time between two, s."""
    max: float
    """Longest time between two, s."""
    std: float
    """Standard deviation of the times between two, s."""
    lost: int
    """Gaps in the sequence numbers."""


def list_topics(session: zenoh.Session, timeout: float = 1.0) -> list[Topic]:
    """Every topic that a node of robo's publishes or subscribes, sorted by key."""
    found: dict[str, tuple[set[str], set[str], set[str]]] = {}
    for reply in session.liveliness().get(ALL_TOKENS, timeout=timeout):
        token = parse_token(str(reply.ok.key_expr)) if reply.ok is not None else None
        if isinstance(token, EndpointToken) and token.kind != "srv":
            types, publishers, subscribers = found.setdefault(token.topic, (set(), set(), set()))
            types.add(token.type_name)
            (publishers if token.kind == "pub" else subscribers).add("/" + token.namespace + "/" + token.node)
    return [
        Topic(key, sorted(types), *([n.replace("//", "/") for n in sorted(who)] for who in (publishers, subscribers)))
        for key, (types, publishers, subscribers) in sorted(found.items())
    ]


class Stream:
    """The samples of a key expression, in order of arrival, until closed."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self._subscriber = session.declare_subscriber(key, zenoh.handlers.FifoChannel(10_000))
        self._handler = self._subscriber.handler

    def samples(self, timeout: float | None = None) -> Iterator[zenoh.Sample]:
        """Samples as they come. Ends when the stream is closed, or `timeout` seconds from now."""
        timer = None
        if timeout is not None:
            timer = threading.Timer(timeout, self.close)
            timer.daemon = True
            timer.start()
        try:
            while True:
                try:
                    yield self._handler.recv()
                except zenoh.ZError:
                    return  # closed
        finally:
            if timer is not None:
                timer.cancel()

    def close(self) -> None:
        """End the stream."""
        self._subscriber.undeclare()


def read(sample: zenoh.Sample) -> Received:
    """A sample as plain data, whatever its type."""
    attachment = codec.unpack_attachment(sample.attachment.to_bytes()) if sample.attachment is not None else None
    encoding = str(sample.encoding)
    kind, _, schema = encoding.partition(";")
    message, error = None, None
    try:
        message = codec.decode_any(sample.payload.to_bytes())
    except Malformed as reason:
        error = str(reason)
    return Received(
        key=str(sample.key_expr),
        type=schema if kind in (codec.MSGPACK, codec.JSON) else "",
        time=attachment.source_time if attachment is not None else time.time_ns(),
        sequence_number=attachment.sequence_number if attachment is not None else None,
        message=message,
        error=error,
    )


class RateMeter:
    """Works out the rate of one topic from publish times and sequence numbers, so that neither this
    program's own delays nor lost messages falsify it.
    """

    def __init__(self, key: str) -> None:
        self.key = key
        self._times: list[int] = []
        self._numbers: list[int] = []

    @property
    def count(self) -> int:
        """Messages in the window so far."""
        return len(self._times)

    def add(self, sample: zenoh.Sample) -> None:
        """Count one message."""
        data = sample.attachment.to_bytes() if sample.attachment is not None else b""
        attachment = codec.unpack_attachment(data)
        self.add_times(*(attachment or (None, time.time_ns())))

    def add_times(self, sequence_number: int | None, source_time: int) -> None:
        """Count one message by its numbers."""
        self._times.append(source_time)
        if sequence_number is not None:
            self._numbers.append(sequence_number)

    def window(self) -> Rate | None:
        """The figures since the last window; None for less than two messages.

        The last message of a window is the first of the next one, so that no gap goes unseen.
        """
        if len(self._times) < 2:
            return None
        gaps = [(b - a) * 1e-9 for a, b in pairwise(self._times)]
        steps = [b - a - 1 for a, b in pairwise(self._numbers)]
        lost = sum(step for step in steps if step > 0)
        span = (self._times[-1] - self._times[0]) * 1e-9
        # Lost messages were published too: they count for the rate.
        rate = (len(gaps) + lost) / span if span > 0 else math.inf
        result = Rate(
            self.key, rate, len(gaps), min(gaps), max(gaps), statistics.pstdev(gaps) if len(gaps) > 1 else 0.0, lost
        )
        self._times, self._numbers = self._times[-1:], self._numbers[-1:]
        return result
