"""Rows of floats between MessagePack as it travels and CDR, without a Python number for each. Needs numpy."""

from typing import Any

import msgspec

_CODES: dict[str, str] = {"f": "<f4", "d": "<f8"}


def little_endian(packed: msgspec.Raw, code: str) -> bytes:
    """The numbers of a MessagePack array as bytes.

    Args:
        packed: an array of floats, all of one width.
        code: what the bytes are: `f` float32, `d` float64.

    Raises:
        ValueError: a finite number is beyond float32, or it is no such array.
    """
    import numpy as np

    from robo_messages import arrays

    found = arrays.floats_of(packed)
    if not len(found):
        return b""
    with np.errstate(over="ignore"):
        numbers: Any = found.astype(_CODES[code])
    if np.count_nonzero(np.isinf(numbers)) != np.count_nonzero(np.isinf(found)):
        raise ValueError("a number is beyond float32")
    data: bytes = numbers.tobytes()
    return data


def from_bytes(data: bytes | memoryview, code: str, order: str) -> msgspec.Raw:
    """A MessagePack array of the numbers that bytes hold.

    Args:
        data: all of them.
        code: `f` float32, `d` float64.
        order: of the bytes of a number, `<` or `>`.
    """
    import numpy as np

    from robo_messages import arrays

    numbers = np.frombuffer(data, f"{order}{_CODES[code][1:]}")
    return arrays.packed_floats(numbers.astype(_CODES[code][1:]))
