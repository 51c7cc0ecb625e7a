"""Texts of ROS's type `wstring` in CDR: a count, then each unit of UTF-16 as four bytes, without a NUL. Pure.

So do ROS's own type supports write them (`rosidl_typesupport_fastrtps_cpp/serialization_helpers.hpp`).
"""

import struct

UNIT = 4
"""Bytes of one."""


def units_of(text: str) -> bytes:
    """The units of a text, the lower byte of each first.

    Raises:
        UnicodeEncodeError: it has half a character.
    """
    narrow = text.encode("utf-16-le")
    count = len(narrow) // 2
    return struct.pack(f"<{count}I", *struct.unpack(f"<{count}H", narrow))


def text_of(units: bytes | memoryview, order: str) -> str:
    """The text of units.

    Args:
        units: all of them.
        order: of the bytes of each, `<` or `>`.

    Raises:
        ValueError: they are no UTF-16.
    """
    count = len(units) // UNIT
    numbers = struct.unpack(f"{order}{count}I", units)
    if numbers and max(numbers) > 0xFFFF:
        raise ValueError(f"no UTF-16: a unit of {max(numbers)}")
    return struct.pack(f"<{count}H", *numbers).decode("utf-16-le")
