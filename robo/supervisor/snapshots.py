"""The files that the run's flight recorders have written, known here also when a recorder has died."""

from collections import deque
from collections.abc import Iterable

import zenoh

import robo_messages
from robo.text.unreadable import UNREADABLE
from robo.wire import names
from robo.wire.keys import SNAPSHOTS_TOPIC
from robo.wire.reports import SnapshotFile

_MOST = 50
"""That are kept, the newest."""
_MOST_OF_NODE = 3
"""That are told of a node, the newest."""
_LARGEST = 1_000_000
"""A longer message is none of a flight recorder's, bytes."""


class Snapshots:
    """What flight recorders have told."""

    def __init__(self, namespaces: Iterable[str]) -> None:
        """`namespaces` are those of the run's nodes."""
        self._topics = sorted({names.join(namespace, SNAPSHOTS_TOPIC) for namespace in namespaces})
        self._files: deque[tuple[SnapshotFile, frozenset[str]]] = deque(maxlen=_MOST)
        self._subscribers: list[object] = []

    def begin(self, session: zenoh.Session) -> None:
        """Begin to listen."""
        self._subscribers = [session.declare_subscriber(topic, self._hear) for topic in self._topics]

    def of(self, node: str) -> list[SnapshotFile]:
        """The files that were written on a node's account, by its full name, the newest last."""
        return [file for file, nodes in list(self._files) if node in nodes][-_MOST_OF_NODE:]

    def take(self, payload: bytes) -> None:
        """A message of a recorder: MessagePack of a `flight/Snapshot`; what is none is left out."""
        try:
            told = robo_messages.decode(payload, robo_messages.Snapshot)
        except UNREADABLE:
            return
        file = SnapshotFile(
            time=told.stamp.to_nanoseconds(), file=told.file, host=told.host, reason="; ".join(told.reasons)
        )
        if all(file != known for known, _ in list(self._files)):  # a late listener gets it twice
            self._files.append((file, frozenset(told.nodes)))

    def _hear(self, sample: zenoh.Sample) -> None:
        if len(sample.payload) <= _LARGEST:
            self.take(sample.payload.to_bytes())
