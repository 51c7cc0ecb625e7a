"""What a recording wants of message types: robo's name for one of ROS's, its text, and how its bytes are read.

Nothing else of `robo.bag` knows types, so whoever has others hands in another `Find`.
"""

import functools
from collections.abc import Callable
from typing import NamedTuple

import robo_messages
from robo.bag.options import TopicInFile
from robo.errors import ContractError
from robo.interfaces import catalogue, cdr
from robo.interfaces.ros_names import full_name
from robo.interfaces.ros_text import whole_text
from robo.interfaces.type_hash import type_hash
from robo.wire.qos import QoS
from robo_messages import Message, UnknownType

Decode = Callable[[bytes], Message]
"""From CDR, header and all.

Raises ValueError, or an error of robo's, where the bytes are no such message.
"""


class Known(NamedTuple):
    """A type that robo has."""

    name: str
    """Robo's: `geometry/Twist`."""
    text: str
    """ROS's definition, whole with its parts."""
    decode: Decode


Find = Callable[[str], Known | None]
"""A type by its name in ROS, `geometry_msgs/msg/Twist`; None where robo has none."""


def nothing(_: str) -> Known | None:
    """No type is known: messages stay bytes."""
    return None


def transforms(name: str) -> Known | None:
    """What names its publishers by what it says, and nothing else: enough to know what is latched."""
    return of_robo(name) if name == "tf2_msgs/msg/TFMessage" else None


def of_robo(name: str) -> Known | None:
    """A type that ships or that a user's package has, by its name in ROS."""
    here = (one for one in robo_messages.type_names() if full_name(one) == name)
    found = next(here, None) or _all().get(name)
    type_ = catalogue.find_here(found) if found is not None else None
    return _known(found, type_) if found is not None and type_ is not None else None


@functools.lru_cache(1024)
def _known(name: str, type_: type[Message]) -> Known | None:
    try:
        return Known(name, whole_text(name), cdr.decoder(type_))
    except (ContractError, UnknownType):
        return None  # ROS cannot have it, so that it is another one of the same name


def topic_of(name: str, type_: type[Message], qos: QoS = QoS.DEFAULT) -> TopicInFile:
    """A topic of robo's messages as a recording has it; `robo.interfaces.cdr.encoder` makes its messages' bytes.

    Raises:
        ContractError: ROS cannot have this type; names the field.
        UnknownType: it was never registered.
    """
    return TopicInFile(name, *_said(robo_messages.type_name(type_), type_), qos)


@functools.lru_cache(1024)
def _said(name: str, type_: type[Message]) -> tuple[str, str, str]:
    """What ROS calls a type, its definition and its hash."""
    del type_  # another class of this name is another type
    return full_name(name), whole_text(name), type_hash(name)


@functools.cache
def _all() -> dict[str, str]:
    """With those of users, who are looked for where a type is not known."""
    return {full_name(name): name for name in catalogue.known()}
