"""What one client publishes. Whoever has driven and goes away leaves the robot standing."""

import time
from typing import NamedTuple

import msgspec
import zenoh

import robo_messages
from robo.bag import types
from robo.bridges.foxglove.calls import message_from
from robo.bridges.foxglove.protocol import Offered
from robo.errors import MessageError
from robo.interfaces import catalogue
from robo.samples.publishing import Sender
from robo.text.brief import shown
from robo.wire import names
from robo.wire.qos import QoS
from robo_messages import Message, Twist, TwistStamped, UnknownType

NODE = "foxglove_bridge"
ZEROS = 3
"""How often a robot is told to stand whose driver is gone."""
_BETWEEN_ZEROS = 0.05
"""s."""
_URGENT = ("geometry/Twist", "geometry/TwistStamped", "std/Bool")
"""Of these types a message drives or stops something: it goes before all data."""
MOST_TOPICS = 200
"""On which one client may publish."""


class _Publication(NamedTuple):
    sender: Sender
    type: type[Message]
    encoding: str
    key: str


class Publications:
    """The topics on which one client publishes. Used by one thread at a time; it blocks."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._of: dict[int, _Publication] = {}
        self._moving: dict[str, Message] = {}
        """The last command of those that are no zero, by topic."""

    def add(self, offered: Offered) -> None:
        """A client is going to publish.

        Raises:
            MessageError: its type is not known here, or its encoding is not spoken.
            InvalidName: the topic's name breaks the rules.
        """
        key = names.key_of(offered.topic)
        if "*" in key or not offered.topic.strip("/"):
            raise MessageError(f"{shown(offered.topic)} names many topics: publish on one")
        if key.startswith("@") or "/@" in key:
            raise MessageError(f"{shown(offered.topic)} is no topic")
        if offered.encoding not in ("cdr", "json"):
            raise MessageError(f"{offered.topic}: encoding {shown(offered.encoding)} is not spoken: use cdr or json")
        if len(self._of) >= MOST_TOPICS:
            raise MessageError(f"{offered.topic}: one client publishes on {MOST_TOPICS} topics at most")
        type_ = type_of(offered.schema_name)
        name = robo_messages.type_name(type_)
        self.remove(offered.id)
        node = "/" + names.join(key.rpartition("/")[0], NODE)
        sender = Sender(self._session, key, name, QoS.COMMAND if name in _URGENT else QoS.DEFAULT, node)
        self._of[offered.id] = _Publication(sender, type_, offered.encoding, key)

    def publish(self, channel: int, data: bytes) -> None:
        """Publish a message.

        Raises:
            MessageError: it is none of its topic, or the topic has not been offered.
        """
        found = self._of.get(channel)
        if found is None:
            raise MessageError(f"there is no topic with the number {channel} on which this client publishes")
        message = message_from(found.type, found.encoding, data)
        found.sender.send(robo_messages.encode(message))
        if isinstance(message, Twist | TwistStamped):
            if _is_zero(message):
                self._moving.pop(found.key, None)
            else:
                self._moving[found.key] = message

    def remove(self, channel: int) -> None:
        """A client publishes there no more."""
        found = self._of.pop(channel, None)
        if found is not None:
            self._stand(found)
            found.sender.close()

    def close(self) -> None:
        """The client is gone."""
        for channel in list(self._of):
            self.remove(channel)

    def _stand(self, publication: _Publication) -> None:
        last = self._moving.pop(publication.key, None)
        if last is None:
            return
        zero = Twist() if isinstance(last, Twist) else msgspec.structs.replace(last, twist=Twist())
        for number in range(ZEROS):
            time.sleep(_BETWEEN_ZEROS if number else 0.0)
            publication.sender.send(robo_messages.encode(zero))


def type_of(name: str) -> type[Message]:
    """The type that a client names: as ROS 2 does, as ROS 1 did, or as robo does.

    Raises:
        MessageError: it is not known here.
    """
    package, _, rest = name.partition("/")
    ros2 = name if rest.startswith("msg/") else f"{package}/msg/{rest}"
    known = types.of_robo(ros2)
    try:
        found = catalogue.find_here(known.name if known is not None else name)
    except UnknownType:
        found = None
    if found is None:
        raise MessageError(f"type {shown(name)} is not known here: `robo interface list` shows those that are")
    return found


def _is_zero(message: Twist | TwistStamped) -> bool:
    twist = message if isinstance(message, Twist) else message.twist
    return not any((*msgspec.structs.astuple(twist.linear), *msgspec.structs.astuple(twist.angular)))
