"""What one client publishes. Whoever has driven and goes away leaves the robot standing."""

import time
from collections.abc import Callable
from contextlib import suppress
from typing import NamedTuple

import msgspec
import zenoh

import robo_messages
from robo.bag import types
from robo.bridges.foxglove.calls import message_from
from robo.bridges.foxglove.drivers import Drivers
from robo.bridges.foxglove.protocol import Offered
from robo.errors import MessageError
from robo.interfaces import catalogue
from robo.samples.publishing import Sender
from robo.text.brief import shown
from robo.wire import names
from robo.wire.qos import QoS
from robo_messages import Message, Time, Twist, TwistStamped, UnknownType

NODE = "foxglove_bridge"
MOST_AGE = 0.5
"""A command may be so old, s: as old as the mux takes it for one. How old it is at most is known by pings alone, and
their way and the pause between them count as well.
"""
_BETWEEN_ZEROS = 0.05
"""s."""
_URGENT = ("geometry/Twist", "geometry/TwistStamped", "std/Bool")
"""Of these types a message drives or stops something: it goes before all data."""
MOST_TOPICS = 200
"""On which one client may publish."""
_LONGEST_NAME = 200
"""Of a topic, characters: Zenoh ends the process where an announcement becomes too long."""


class _Publication(NamedTuple):
    sender: Sender
    type: type[Message]
    encoding: str
    key: str


class Publications:
    """The topics on which one client publishes. Used by one thread at a time; it blocks."""

    def __init__(self, session: zenoh.Session, who: str, drivers: Drivers, covers: Callable[[str], bool]) -> None:
        """
        Args:
            session: the network.
            who: the client's name.
            drivers: who drives what.
            covers: on which topics it may publish, by their keys.
        """
        self._session, self._who, self._drivers, self._covers = session, who, drivers, covers
        self._of: dict[int, _Publication] = {}
        self._driven: dict[str, tuple[Sender, Twist | TwistStamped]] = {}
        """The last command of topics by which it drives, until they are told to stand."""
        self._refused: dict[str, str] = {}
        """Why the last command of a topic was refused."""

    @property
    def drives(self) -> bool:
        """Whether something is to be told to stand that has not been yet."""
        return bool(self._driven)

    def add(self, offered: Offered) -> None:
        """A client is going to publish.

        Raises:
            MessageError: its type is not known here, its encoding is not spoken, or its topic is none to publish on.
            InvalidName: the topic's name breaks the rules.
        """
        if len(offered.topic) > _LONGEST_NAME:
            raise MessageError(f"{shown(offered.topic)} is too long for a topic: {_LONGEST_NAME} characters at most")
        key = names.key_of(offered.topic)
        if "*" in key or not offered.topic.strip("/"):
            raise MessageError(f"{shown(offered.topic)} names many topics: publish on one")
        if key.startswith("@") or "/@" in key:
            raise MessageError(f"{shown(offered.topic)} is no topic")
        if not self._covers(key):
            raise MessageError(f"{shown(offered.topic)} is not of the robot that this bridge is for")
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

    def publish(self, channel: int, data: bytes, came: float, age: float) -> None:
        """Publish a message.

        Args:
            channel: by the client's number.
            data: its bytes.
            came: when, s by the monotonic clock.
            age: how old it can have been then, s.

        Raises:
            MessageError: it is none of its topic, the topic has not been offered, or it is a command that is too old
                or of one who does not drive, or whose grip was ended. Of commands the first one that is refused is
                told, and not each.
        """
        found = self._of.get(channel)
        if found is None:
            raise MessageError(f"there is no topic with the number {channel} on which this client publishes")
        message = message_from(found.type, found.encoding, data)
        if isinstance(message, Twist | TwistStamped) and not _is_zero(message):
            now = time.monotonic()
            self._drivers.hold(found.key, self._who, came - age, came)
            if why := self._why_not(found.key, now, now - came + age):
                if self._refused.get(found.key) == why:
                    return
                self._refused[found.key] = why
                raise MessageError(why)
            self._refused.pop(found.key, None)
            self._driven[found.key] = found.sender, message
        found.sender.send(robo_messages.encode(message))

    def stand_where_nothing_is_said(self) -> None:
        """Send a zero where the last command is a while ago: a pad that is let go says nothing any more."""
        for key in list(self._driven):
            self._stand(key)

    def remove(self, channel: int) -> None:
        """A client publishes there no more."""
        found = self._of.pop(channel, None)
        if found is None:
            return
        if self._driven.get(found.key, (None,))[0] is found.sender:
            self._leave(found.key)
        found.sender.close()

    def close(self) -> None:
        """The client is gone."""
        for channel in list(self._of):
            with suppress(BaseException):  # the network has been left, or Zenoh panics; each is tried
                self.remove(channel)

    def _why_not(self, key: str, now: float, age: float) -> str:
        """Why a robot may not be told to move now; empty where it may."""
        if age > MOST_AGE:
            return f"/{key}: commands come too late: the link of this viewer or the network is held up"
        why = self._drivers.command(key, self._who, now)
        return f"/{key}: {why}" if why else ""

    def _leave(self, key: str) -> None:
        self._drivers.leave(key, self._who)
        while key in self._driven:
            self._stand(key)
            if key in self._driven:
                time.sleep(_BETWEEN_ZEROS)
        self._drivers.forget(key)

    def _stand(self, key: str) -> None:
        sender, last = self._driven[key]
        if self._drivers.is_to_stand(key, self._who, time.monotonic()):
            sender.send(robo_messages.encode(_zero(last)))
        if self._drivers.is_over(key, self._who):
            del self._driven[key]


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


def _zero(last: Twist | TwistStamped) -> Twist | TwistStamped:
    """What tells whoever obeys a command to stand: of now, since who refuses what is old is to obey it."""
    if isinstance(last, Twist):
        return Twist()
    return TwistStamped(msgspec.structs.replace(last.header, stamp=Time.now()))
