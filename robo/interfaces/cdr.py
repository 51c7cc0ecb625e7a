"""Messages as CDR, the bytes that ROS 2 and its tools read and write.

The functions are made for each type when they are asked for first, and kept. Nodes do not use them: what travels
between nodes is MessagePack. They stand at the border: recordings, viewers, bridges.

>>> from robo_messages import Twist, Vector3
>>> data = encoder(Twist)(Twist(linear=Vector3(x=0.5)))
>>> len(data), decoder(Twist)(data).linear.x
(52, 0.5)
"""

import functools
from collections.abc import Callable
from typing import TypeVar, cast

from robo.interfaces.cdr_decode import make_decoder
from robo.interfaces.cdr_encode import make_encoder
from robo.interfaces.ros_shape import shape_of
from robo_messages import Message

M = TypeVar("M", bound=Message)


def encoder(type_: type[M]) -> Callable[[M], bytes]:
    """What writes messages of a type, the lower byte of each number first. A float32 loses digits that robo keeps.

    It raises MessageError for a message that does not fit, and names the field: a finite number beyond float32, a
    whole one beyond its width, a text with NUL or with half a character, a fixed array of another length.

    Raises:
        ContractError: ROS cannot have this type; names the field.
        UnknownType: it, or one within it, was never registered.
    """
    return cast(Callable[[M], bytes], _encoder(type_))


def decoder(type_: type[M]) -> Callable[[bytes | memoryview], M]:
    """What reads messages of a type, of either order of bytes.

    Bulk fields (`memoryview`) point into what is read: no copy is made. What follows behind a message is left alone, as
    ROS does. It raises MessageError for what is no such message, and names the field; the memory that it takes is
    bounded by the size of what it is given, whatever lengths stand in it.

    Raises:
        ContractError, UnknownType: as `encoder`.
    """
    return cast(Callable[[bytes | memoryview], M], _decoder(type_))


@functools.cache
def _encoder(type_: type[Message]) -> Callable[[Message], bytes]:
    return make_encoder(shape_of(type_))


@functools.cache
def _decoder(type_: type[Message]) -> Callable[[bytes | memoryview], Message]:
    return make_decoder(shape_of(type_))
