"""Publishing on topics from outside of any node: typed, with sequence numbers and times as nodes send them."""

import math
import os
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import msgspec
import zenoh

from robo.errors import InvalidName, MessageError
from robo.samples.records import Record, payload_of, sample_of
from robo.samples.stream import SIGNALS
from robo.text.readable import readable
from robo.text.unreadable import UNREADABLE
from robo.wire import codec, sources
from robo.wire.keys import EndpointToken, source_id
from robo.wire.latched import LatchedPublisher
from robo.wire.names import split
from robo.wire.qos import QoS, zenoh_priority

_REMEMBERED = 10_000
"""Own messages that are remembered, to know them when they come back."""
_LONGEST_KEY = 500
"""Of a topic, characters: Zenoh ends the process where an announcement becomes too long."""


class Line(msgspec.Struct, frozen=True):
    """A message from a line of text, ready to be published."""

    key: str
    type: str
    payload: bytes
    encoding: str
    origin: tuple[int, int | None] | None
    """Publish time and sequence number of the message that the line tells of, if it does."""


class Sender:
    """Publishes on one topic."""

    def __init__(
        self,
        session: zenoh.Session,
        key: str,
        type_name: str,
        qos: QoS = QoS.DEFAULT,
        node: str = "",
        remembered: int = _REMEMBERED,
    ) -> None:
        """Announces itself as nodes do, so that tools show it.

        Args:
            session: the network.
            key: of the topic.
            type_name: of its messages; empty where each says its own.
            qos: what it latches, and what goes first.
            node: the full name by which it is announced; by default one that tells this process.
            remembered: so many of its messages `has_sent` knows.

        Raises:
            InvalidName: the key, the type or the name is too long to be announced.
            zenoh.ZError: the key is none, or the network has been left.
        """
        for what, text in (("topic", key), ("type", type_name), ("node", node)):
            if len(text) > _LONGEST_KEY:
                raise InvalidName(f"{text[:20]}… is no {what}: it has more than {_LONGEST_KEY} characters")
        encoding = f"{codec.MSGPACK};{type_name}" if type_name else codec.MSGPACK
        # What a person or a file says is to arrive: nothing is dropped on the way out.
        control, priority = zenoh.CongestionControl.BLOCK, zenoh_priority(qos.priority)
        self._session = session
        self._publisher: zenoh.Publisher | LatchedPublisher
        if qos.latched:
            self._publisher = LatchedPublisher(session, key, qos.depth, encoding, control, priority)
        else:
            self._publisher = session.declare_publisher(
                key, encoding=encoding, congestion_control=control, priority=priority
            )
        self._key = key
        namespace, name = split(node) if node else (key.rpartition("/")[0], f"topic_pub_{os.getpid()}")
        known_type = type_name if _is_key(type_name) else ""
        self.id = source_id(self._publisher.id)
        """Zenoh's id of it, as `source_id` makes it."""
        token = EndpointToken(namespace, name, "pub", known_type, qos, key, self.id)
        self._put: Callable[..., None] = self._publisher.put
        # A latched publisher says by itself whose its messages are.
        self._source = None if qos.latched else sources.counted(self._publisher.id)
        self._token = session.liveliness().declare_token(token.key())
        self._number = 0
        self._sent: deque[tuple[int, int | None]] = deque(maxlen=remembered)

    def send(self, payload: bytes, encoding: str | None = None) -> None:
        """Publish one message with the next sequence number and the time of now."""
        self._number += 1
        now = time.time_ns()
        self._sent.append((now, self._number))
        stamp = codec.pack_attachment(self._number, now)
        whose = {} if self._source is None else {"source_info": self._source()}
        self._put(payload, encoding=encoding, attachment=stamp, **whose)

    def has_sent(self, origin: tuple[int, int | None]) -> bool:
        """Whether a message, by publish time and sequence number, is one of its own that has come back."""
        return origin in self._sent

    def wait_for_subscriber(self, timeout: float | None = None) -> bool:
        """Wait until somebody subscribes, for at most so long, s. Returns whether somebody does."""
        audience = Audience(self._session, [self._key])
        try:
            return audience.wait(timeout)
        finally:
            audience.close()

    def close(self) -> None:
        """Withdraw the announcement and stop publishing."""
        self._token.undeclare()
        self._publisher.undeclare()


class Audience:
    """Whether somebody listens to each of some topics, or has."""

    def __init__(self, session: zenoh.Session, keys: Iterable[str]) -> None:
        self._missing = dict.fromkeys(keys)
        self._changed = threading.Condition()
        self._ends: list[Any] = []
        for key in list(self._missing):
            asking = session.declare_publisher(key)  # one that latches cannot tell
            notice = partial(self._notice, key)
            self._ends += [asking.declare_matching_listener(notice), asking]
            notice(asking.matching_status)

    @property
    def missing(self) -> list[str]:
        """The topics to which nobody has listened."""
        return list(self._missing)

    def wait(self, timeout: float | None = None) -> bool:
        """Wait until none is missing, for at most so long, s. Returns whether none is."""
        end = math.inf if timeout is None else time.monotonic() + timeout
        with self._changed:
            while self._missing and (left := end - time.monotonic()) > 0.0:
                self._changed.wait(min(left, SIGNALS))
            return not self._missing

    def close(self) -> None:
        """Look no more."""
        for end in self._ends:
            end.undeclare()

    def _notice(self, key: str, status: Any) -> None:  # zenoh's stub says bool, it is an object
        if status.matching:
            with self._changed:
                self._missing.pop(key, None)
                self._changed.notify_all()


def flush(session: zenoh.Session, timeout: float = 5.0) -> None:
    """Wait until the routers have all that was published so far: a query follows it on the same link."""
    for _ in session.get("@/*/router", timeout=timeout):
        pass


def line_of(text: str, key: str | None, type_name: str | None) -> Line:
    """A line of JSON: a message, or a record of `robo topic echo --json`.

    Args:
        text: the line.
        key: where to publish; None where the record says it.
        type_name: as what; None where the record says it.

    Raises:
        MessageError: it is no JSON, no message of the type, or does not say key or type.
    """
    try:
        data = msgspec.json.decode(text)
    except UNREADABLE as error:
        raise MessageError(f"no JSON: {error}") from None
    if not isinstance(data, dict):
        raise MessageError("expected an object: a message, or what `robo topic echo --json` prints")
    if {"key", "type", "time", "message"} <= data.keys():
        return _line_of_record(data, key, type_name)
    if key is None or type_name is None:
        raise MessageError("the line says neither key nor type: write robo topic pub KEY TYPE -")
    return Line(key, type_name, payload_of(type_name, data), f"{codec.MSGPACK};{type_name}", None)


def _is_key(text: str) -> bool:
    """Whether a text is a key that a message can have."""
    try:
        return "*" not in text and bool(zenoh.KeyExpr(text))
    except zenoh.ZError:
        return False


def _line_of_record(data: dict[str, object], key: str | None, type_name: str | None) -> Line:
    try:
        record = msgspec.convert(data, readable(Record))
    except msgspec.ValidationError as error:
        raise MessageError(f"no record of `robo topic echo --json`: {error}") from None
    if type_name is not None and record.type not in ("", type_name):
        raise MessageError(f"{record.key} is a {record.type}, not a {type_name}")
    if type_name is not None and not record.type:
        record = msgspec.structs.replace(record, type=type_name)
    if key is None and not _is_key(record.key):
        raise MessageError(f"{record.key!r} is no key of a topic")
    payload, encoding = sample_of(record)
    origin = (record.time, record.sequence_number)
    return Line(key if key is not None else record.key, record.type, payload, encoding, origin)
