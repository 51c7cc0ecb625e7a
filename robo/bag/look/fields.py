"""Fields of messages: as numbers, and in which of them two messages differ. Pure."""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

from robo_messages import Duration, Message, Time


class Unequal(NamedTuple):
    """A field in which two messages differ."""

    field: str
    """`pose.pose.position.x`, `ranges.17`; empty for the whole."""
    first: Any
    second: Any


def unequal(a: Any, b: Any, whole: tuple[type, ...] = (), path: str = "") -> Iterator[Unequal]:
    """The fields in which two messages differ: bit for bit, where NaN is NaN; lists of other lengths as they are.

    Args:
        a, b: messages, or values of them.
        whole: types of messages that are looked at as one value.
        path: to them.
    """
    if isinstance(a, Message) and type(a) is type(b) and not isinstance(a, whole):
        for name in a.__struct_fields__:
            yield from unequal(getattr(a, name), getattr(b, name), whole, f"{path}.{name}" if path else name)
    elif isinstance(a, (list, tuple)) and isinstance(b, (list, tuple)) and len(a) == len(b):
        for number, (mine, theirs) in enumerate(zip(a, b, strict=True)):
            yield from unequal(mine, theirs, whole, f"{path}.{number}")
    elif not same(a, b):
        yield Unequal(path, a, b)


def same(a: Any, b: Any) -> bool:
    """Whether two values are the same; 0.0 and -0.0 are not."""
    if isinstance(a, float) and isinstance(b, float):
        return (a == b and math.copysign(1.0, a) == math.copysign(1.0, b)) or (a != a and b != b)
    if isinstance(a, (list, tuple)) and isinstance(b, (list, tuple)):
        return len(a) == len(b) and all(map(same, a, b))
    return bool(a == b)


def number(value: Any) -> float | None:
    """What a value is as a number: times in s; None where it is none."""
    if isinstance(value, (Time, Duration)):
        return value.to_seconds()
    return value if isinstance(value, (int, float)) and not isinstance(value, bool) else None
