"""Recorded messages as nodes under test get them: with their recorded stamps and numbers, by whom they are wanted."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import msgspec
import zenoh

from robo.bag.read.topics import BagMessage, Topic
from robo.node.message_info import PLAIN
from robo.node.node import Node
from robo.parameters.model import flat
from robo.wire import codec, names, sources
from robo.wire.keys import EndpointToken, source_id
from robo.wire.qos import QoS
from robo_messages import Message

SENDER = "/replay"
"""In whose name messages come where nobody else is wanted."""


class _Way:
    """The way of one topic into the network."""

    def __init__(self, session: zenoh.Session, topic: Topic, sender: str) -> None:
        self.encoding = f"{codec.MSGPACK};{topic.type}"
        self.encode = msgspec.msgpack.Encoder().encode
        self.publisher = session.declare_publisher(topic.name, encoding=self.encoding)
        self.source: Callable[[], zenoh.SourceInfo] | None = None
        self.token: zenoh.LivelinessToken | None = None
        if sender != PLAIN:
            namespace, _, name = sender[1:].rpartition("/")
            own = source_id(self.publisher.id)
            token = EndpointToken(namespace, name, "pub", topic.type, QoS.DEFAULT, topic.name, own)
            self.token = session.liveliness().declare_token(token.key())
            self.source = sources.counted(self.publisher.id)
        self.count = 0

    def put(self, message: BagMessage) -> None:
        value: Any = message.value
        self.count += 1
        stamp = codec.pack_attachment(message.sequence or self.count, min(message.published, 2**63 - 1))
        source = self.source() if self.source is not None else None
        self.publisher.put(self.encode(value), attachment=stamp, source_info=source)

    def close(self) -> None:
        if self.token is not None:
            self.token.undeclare()
        self.publisher.undeclare()


class Feed:
    """Hands recorded messages to the nodes on a network."""

    def __init__(self, session: zenoh.Session, topics: Mapping[str, Topic], senders: Mapping[str, str]) -> None:
        """
        Args:
            session: the network.
            topics: those that are fed, by name.
            senders: by topic, in whose name its messages come; `/replay` where nothing is said.
        """
        self._ways = {name: _Way(session, topic, senders.get(name, SENDER)) for name, topic in topics.items()}

    def give(self, message: BagMessage) -> None:
        """Publish one.

        Raises:
            BagError: it is no message of its type.
        """
        self._ways[message.topic.name].put(message)

    @property
    def counts(self) -> dict[str, int]:
        """Messages that were fed, by topic."""
        return {name: way.count for name, way in self._ways.items()}

    def close(self) -> None:
        """Leave the network."""
        for way in self._ways.values():
            way.close()


def wanted_senders(node: Node) -> dict[str, str]:
    """By topic, in whose name messages have to come: those of others do not count."""
    found = {}
    values = flat(node.parameters)
    for declared in node.contract.subscriptions:
        if declared.sole_source is not None:
            name = str(values.get(declared.sole_source, ""))
            if name:
                found[node.resolve(declared.topic)] = name if name == PLAIN else names.absolute(name, node.namespace)
    return found


def type_mistake(node: Node, topic: Topic) -> str | None:
    """Why a node cannot take a recorded topic."""
    for declared in node.contract.subscriptions:
        if node.resolve(declared.topic) == topic.name and not issubclass(_type_of(topic), declared.message_type):
            return f"it is a {topic.type} in the recording, and {node.full_name} takes {declared.message_type.__name__}"
    return None


def _type_of(topic: Topic) -> type[Message]:
    from robo_messages import find_type

    return find_type(topic.type)
