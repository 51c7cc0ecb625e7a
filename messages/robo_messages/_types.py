"""Field types that several messages share.

ROS numbers have a width; those of MessagePack and JSON have none. These aliases keep it: an integer out of
range is refused when a message is decoded, and `ros` in a type's extra data is what ROS calls it.
"""

from typing import Annotated

from msgspec import Meta

Int8 = Annotated[int, Meta(ge=-(2**7), lt=2**7, extra={"ros": "int8"})]
UInt8 = Annotated[int, Meta(ge=0, lt=2**8, extra={"ros": "uint8"})]
Int16 = Annotated[int, Meta(ge=-(2**15), lt=2**15, extra={"ros": "int16"})]
UInt16 = Annotated[int, Meta(ge=0, lt=2**16, extra={"ros": "uint16"})]
Int32 = Annotated[int, Meta(ge=-(2**31), lt=2**31, extra={"ros": "int32"})]
UInt32 = Annotated[int, Meta(ge=0, lt=2**32, extra={"ros": "uint32"})]
Int64 = Annotated[int, Meta(ge=-(2**63), le=2**63 - 1, extra={"ros": "int64"})]
UInt64 = Annotated[int, Meta(ge=0, extra={"ros": "uint64"})]
"""MessagePack itself has no larger number."""
Float32 = Annotated[float, Meta(extra={"ros": "float32"})]
"""A number that ROS sends as float32; here it keeps all its digits."""
Byte = Annotated[int, Meta(ge=0, lt=2**8, extra={"ros": "byte"})]
Char = Annotated[int, Meta(ge=0, lt=2**8, extra={"ros": "char"})]
"""A number, as ROS 2 has it; a text is a String."""
Bytes = Annotated[memoryview, Meta(extra={"ros": "byte[]"})]
SignedBytes = Annotated[memoryview, Meta(extra={"ros": "int8[]"})]

Covariance3 = Annotated[tuple[float, ...], Meta(min_length=9, max_length=9)]
"""A 3x3 matrix in row-major order."""
Covariance6 = Annotated[tuple[float, ...], Meta(min_length=36, max_length=36)]
"""A 6x6 matrix in row-major order over (x, y, z, rotation about x, about y, about z)."""

ZEROS_3X3: tuple[float, ...] = (0.0,) * 9
ZEROS_6X6: tuple[float, ...] = (0.0,) * 36


def check_length(owner: str, field: str, value: tuple[float, ...], length: int) -> None:
    """Refuse a fixed-size array of the wrong length where it is made, not only where it is read.

    Raises:
        ValueError: `value` does not have exactly `length` elements.
    """
    if len(value) != length:
        raise ValueError(f"{owner}.{field} takes {length} numbers, got {len(value)}")
