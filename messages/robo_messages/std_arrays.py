"""Arrays of numbers with any number of dimensions (ROS: std_msgs).

They say nothing of what the numbers are; ROS advises against them, and so does robo: a type of your own has a field for
each thing, with its unit. Arrays of single bytes are binary fields, as in `Image`. Imported when one of its types is
asked for.
"""

from msgspec import field

from robo_messages import _types as width
from robo_messages._registry import Message, message


@message("std/MultiArrayDimension")
class MultiArrayDimension(Message):
    """One dimension of an array."""

    label: str = ""
    """What it is called, for example `height`."""
    size: width.UInt32 = 0
    """Steps along it."""
    stride: width.UInt32 = 0
    """Elements of it and of all dimensions within it: of the outermost, of the whole array."""


@message("std/MultiArrayLayout")
class MultiArrayLayout(Message):
    """How the numbers of an array are arranged; empty for a plain list."""

    dim: list[MultiArrayDimension] = []
    """The dimensions, outermost first. Element (i, j, k) is
    data[data_offset + dim[1].stride * i + dim[2].stride * j + k]."""
    data_offset: width.UInt32 = 0
    """Elements before the first."""


@message("std/ByteMultiArray")
class ByteMultiArray(Message):
    """An array of bytes."""

    layout: MultiArrayLayout = field(default_factory=MultiArrayLayout)
    """Its dimensions; empty for a plain list."""
    data: width.Bytes = memoryview(b"")
    """The bytes. A decoded one points into the payload: no copy is made."""


@message("std/Float32MultiArray")
class Float32MultiArray(Message):
    """An array of numbers, which ROS sends with about 7 digits."""

    layout: MultiArrayLayout = field(default_factory=MultiArrayLayout)
    """Its dimensions; empty for a plain list."""
    data: list[width.Float32] = []
    """The numbers, the last dimension's next to each other."""


@message("std/Float64MultiArray")
class Float64MultiArray(Message):
    """An array of numbers."""

    layout: MultiArrayLayout = field(default_factory=MultiArrayLayout)
    """Its dimensions; empty for a plain list."""
    data: list[float] = []
    """The numbers, the last dimension's next to each other."""


@message("std/Int8MultiArray")
class Int8MultiArray(Message):
    """An array of whole numbers, -128 to 127."""

    layout: MultiArrayLayout = field(default_factory=MultiArrayLayout)
    """Its dimensions; empty for a plain list."""
    data: width.SignedBytes = memoryview(b"")
    """Signed bytes: `data.cast("b")` reads them. A decoded one points into the payload: no copy is made."""


@message("std/Int16MultiArray")
class Int16MultiArray(Message):
    """An array of whole numbers, -32,768 to 32,767."""

    layout: MultiArrayLayout = field(default_factory=MultiArrayLayout)
    """Its dimensions; empty for a plain list."""
    data: list[width.Int16] = []
    """The numbers, the last dimension's next to each other."""


@message("std/Int32MultiArray")
class Int32MultiArray(Message):
    """An array of whole numbers, -2,147,483,648 to 2,147,483,647."""

    layout: MultiArrayLayout = field(default_factory=MultiArrayLayout)
    """Its dimensions; empty for a plain list."""
    data: list[width.Int32] = []
    """The numbers, the last dimension's next to each other."""


@message("std/Int64MultiArray")
class Int64MultiArray(Message):
    """An array of whole numbers, -2⁶³ to 2⁶³ - 1."""

    layout: MultiArrayLayout = field(default_factory=MultiArrayLayout)
    """Its dimensions; empty for a plain list."""
    data: list[width.Int64] = []
    """The numbers, the last dimension's next to each other."""


@message("std/UInt8MultiArray")
class UInt8MultiArray(Message):
    """An array of whole numbers, 0 to 255."""

    layout: MultiArrayLayout = field(default_factory=MultiArrayLayout)
    """Its dimensions; empty for a plain list."""
    data: memoryview = memoryview(b"")
    """The bytes. A decoded one points into the payload: no copy is made."""


@message("std/UInt16MultiArray")
class UInt16MultiArray(Message):
    """An array of whole numbers, 0 to 65,535."""

    layout: MultiArrayLayout = field(default_factory=MultiArrayLayout)
    """Its dimensions; empty for a plain list."""
    data: list[width.UInt16] = []
    """The numbers, the last dimension's next to each other."""


@message("std/UInt32MultiArray")
class UInt32MultiArray(Message):
    """An array of whole numbers, 0 to 4,294,967,295."""

    layout: MultiArrayLayout = field(default_factory=MultiArrayLayout)
    """Its dimensions; empty for a plain list."""
    data: list[width.UInt32] = []
    """The numbers, the last dimension's next to each other."""


@message("std/UInt64MultiArray")
class UInt64MultiArray(Message):
    """An array of whole numbers, 0 to 2⁶⁴ - 1."""

    layout: MultiArrayLayout = field(default_factory=MultiArrayLayout)
    """Its dimensions; empty for a plain list."""
    data: list[width.UInt64] = []
    """The numbers, the last dimension's next to each other."""
