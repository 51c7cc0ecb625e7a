"""Field types with the widths of ROS, for message types of your own.

>>> from robo_messages import Message, message
>>> from robo_messages.fields import Float32, UInt8
>>> @message("my_robot/Battery")
... class Battery(Message):
...     level: UInt8 = 0
...     voltage: Float32 = 0.0
"""

from typing import Annotated

from msgspec import Meta

from robo_messages._types import (
    Byte,
    Bytes,
    Char,
    Float32,
    Int8,
    Int16,
    Int32,
    Int64,
    SignedBytes,
    UInt8,
    UInt16,
    UInt32,
    UInt64,
)

Chars = Annotated[memoryview, Meta(extra={"ros": "char[]"})]
WString = Annotated[str, Meta(extra={"ros": "wstring"})]
"""A text that ROS tells in UTF-16."""

__all__ = [
    "Byte",
    "Bytes",
    "Char",
    "Chars",
    "Float32",
    "Int8",
    "Int16",
    "Int32",
    "Int64",
    "SignedBytes",
    "UInt8",
    "UInt16",
    "UInt32",
    "UInt64",
    "WString",
]
