"""What the values of a message type hold, as far as that decides how its messages travel."""

from typing import Any, get_args, get_origin, get_type_hints

from robo_messages import Message

BYTES = (memoryview, bytes, bytearray)
"""What may be large, and travels as it is."""


def holds(hint: Any, kinds: tuple[type, ...]) -> bool:
    """Whether a value of this type, or any within it, is of one of these kinds."""
    if hint in kinds or get_origin(hint) in kinds:
        return True
    if isinstance(hint, type) and issubclass(hint, Message):
        return any(holds(inner, kinds) for inner in get_type_hints(hint).values())
    return any(holds(inner, kinds) for inner in get_args(hint))
