"""Field types that several messages share.

ROS integers have a width; MessagePack and JSON integers have none. These aliases bring the range
check back: a value out of range is refused when a message is decoded.
"""

from typing import Annotated

from msgspec import Meta

Int8 = Annotated[int, Meta(ge=-(2**7), lt=2**7)]
UInt8 = Annotated[int, Meta(ge=0, lt=2**8)]
UInt16 = Annotated[int, Meta(ge=0, lt=2**16)]
Int32 = Annotated[int, Meta(ge=-(2**31), lt=2**31)]
UInt32 = Annotated[int, Meta(ge=0, lt=2**32)]

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
