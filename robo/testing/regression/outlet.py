"""What nodes publish while they are replayed: written into a recording, in the order in which it was said."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import zenoh

import robo_messages
from robo import bag
from robo.bag.types import topic_of
from robo.errors import RoboError
from robo.interfaces import cdr
from robo.testing.session import Sent
from robo.wire.keys import PREFIX
from robo.wire.qos import QoS


class _Noted(NamedTuple):
    node: str
    sent: Sent
    time: int
    thread: str


class _Topic:
    """One topic that is written."""

    def __init__(self, number: int, decode: Callable[[bytes], object], encode: Callable[..., bytes]) -> None:
        self.number = number
        self.decode = decode
        self.encode = encode
        self.count = 0


class Outlet:
    """Takes what nodes publish in their threads, and writes it down in the thread of the run."""

    def __init__(self, path: Path, now: Callable[[], int], complain: Callable[[str, str], None]) -> None:
        """
        Args:
            path: of the recording.
            now: the time of stamps, ns since the epoch.
            complain: is told of a node what it has published that no recording can have.
        """
        self.left_out: set[str] = set()
        """Topics that are not written down."""
        self.threads: dict[str, set[str]] = {}
        """By topic, the names of threads that have published."""
        self.unwritable: dict[str, str] = {}
        """By topic, why ROS cannot have its type."""
        self.qos: Mapping[str, QoS] = {}
        """By topic, as it is declared."""
        self._recording = bag.Recording(path, bag.Options(compression="none", sync=False))
        self._now = now
        self._complain = complain
        self._noted: deque[_Noted] = deque()
        self._topics: dict[tuple[str, str], _Topic] = {}
        self._is_open = True

    def of(self, node: str) -> Callable[[Sent], None]:
        """What notes the messages of a node."""

        def note(sent: Sent) -> None:
            if self._is_open and sent.key not in self.left_out and not sent.key.startswith(PREFIX):
                payload = sent.payload if isinstance(sent.payload, bytes) else zenoh.ZBytes(sent.payload).to_bytes()
                copied = sent._replace(payload=payload)
                self._noted.append(_Noted(node, copied, self._now(), threading.current_thread().name))

        return note

    def drain(self) -> None:
        """Write down what was said since."""
        while self._noted:
            self._write(self._noted.popleft())

    def close(self) -> None:
        """End the recording: what is said from now on is the end of the nodes."""
        self._is_open = False
        self.drain()
        self._recording.close()

    def _write(self, noted: _Noted) -> None:
        key, kind = noted.sent.key, noted.sent.type
        if key in self.unwritable:
            return
        topic = self._topics.get((key, kind))
        if topic is None:
            topic = self._new_topic(key, kind)
            if topic is None:
                return
        threads = self.threads.setdefault(key, set())
        if len(threads) < 2:
            threads.add(noted.thread)
        try:
            data = topic.encode(topic.decode(noted.sent.payload))
        except (RoboError, ValueError) as error:
            self._complain(noted.node, f"published on {key} what is no {kind} of a recording: {error}")
            return
        topic.count += 1
        self._recording.write(topic.number, data, noted.time, noted.time, topic.count, noted.node)

    def _new_topic(self, key: str, kind: str) -> _Topic | None:
        try:
            type_ = robo_messages.find_type(kind)
            number = self._recording.topic(topic_of(key, type_, self.qos.get(key, QoS.DEFAULT)))
            topic = _Topic(number, robo_messages.decoder_of(type_).decode, cdr.encoder(type_))
        except (RoboError, robo_messages.UnknownType) as error:
            self.unwritable[key] = str(error)
            return None
        self._topics[key, kind] = topic
        return topic
