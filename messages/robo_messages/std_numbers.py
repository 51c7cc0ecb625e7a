"""One number, and a colour (ROS: std_msgs). For something that has a unit, a type of your own says more.

Imported when one of its types is asked for.
"""

from robo_messages import _types as width
from robo_messages._registry import Message, message


@message("std/Byte")
class Byte(Message):
    """One byte, 0 to 255."""

    data: width.Byte = 0
    """The number."""


@message("std/Char")
class Char(Message):
    """One byte, 0 to 255, which ROS calls a character."""

    data: width.Char = 0
    """The number."""


@message("std/Float32")
class Float32(Message):
    """One number, which ROS sends with about 7 digits."""

    data: width.Float32 = 0.0
    """The number."""


@message("std/Float64")
class Float64(Message):
    """One number."""

    data: float = 0.0
    """The number."""


@message("std/Int8")
class Int8(Message):
    """One whole number, -128 to 127."""

    data: width.Int8 = 0
    """The number."""


@message("std/Int16")
class Int16(Message):
    """One whole number, -32,768 to 32,767."""

    data: width.Int16 = 0
    """The number."""


@message("std/Int32")
class Int32(Message):
    """One whole number, -2,147,483,648 to 2,147,483,647."""

    data: width.Int32 = 0
    """The number."""


@message("std/Int64")
class Int64(Message):
    """One whole number, -2⁶³ to 2⁶³ - 1."""

    data: width.Int64 = 0
    """The number."""


@message("std/UInt8")
class UInt8(Message):
    """One whole number, 0 to 255."""

    data: width.UInt8 = 0
    """The number."""


@message("std/UInt16")
class UInt16(Message):
    """One whole number, 0 to 65,535."""

    data: width.UInt16 = 0
    """The number."""


@message("std/UInt32")
class UInt32(Message):
    """One whole number, 0 to 4,294,967,295."""

    data: width.UInt32 = 0
    """The number."""


@message("std/UInt64")
class UInt64(Message):
    """One whole number, 0 to 2⁶⁴ - 1."""

    data: width.UInt64 = 0
    """The number."""


@message("std/ColorRGBA")
class ColorRGBA(Message):
    """A colour. Its default, as all zeros, cannot be seen: set `a`."""

    r: width.Float32 = 0.0
    """Red, 0 to 1."""
    g: width.Float32 = 0.0
    """Green, 0 to 1."""
    b: width.Float32 = 0.0
    """Blue, 0 to 1."""
    a: width.Float32 = 0.0
    """How much it covers, 0 to 1; 0 is not seen."""
