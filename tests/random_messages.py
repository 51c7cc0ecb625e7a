"""Messages of any type with any values that the type takes, for hypothesis; and what float32 leaves of them."""

import struct
from typing import Any, TypeVar

from hypothesis import strategies as st

import robo_messages
from robo.interfaces.ros_shape import INTEGERS, Array, Field, Kind, Part, Single, shape_of
from robo_messages import Message

M = TypeVar("M", bound=Message)
SHIPPED = [
    name for name in robo_messages.type_names() if robo_messages.find_type(name).__module__.startswith("robo_messages.")
]
"""The names of all types but those of tests."""
MOST = 4
"""Elements of a list without a bound of its own."""

TEXTS = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=12)
DOUBLES = st.floats(allow_nan=True, allow_infinity=True)
LONGS = st.integers(*INTEGERS["int64"])


def anything() -> st.SearchStrategy[Any]:
    """Values that a parameter may have."""
    lists = (st.lists(one, min_size=1, max_size=MOST) for one in (st.booleans(), LONGS, DOUBLES, TEXTS))
    return st.one_of(st.none(), st.booleans(), LONGS, DOUBLES, TEXTS, *lists)


def messages(type_: type[M]) -> st.SearchStrategy[M]:
    """Messages of a type; its fields may be of any type but those that ROS has no word for."""
    return st.builds(type_, **{field.attribute: _field(field) for field in shape_of(type_).fields})


def _field(field: Field) -> st.SearchStrategy[Any]:
    """Of a field that takes less than ROS's type, one is known: a text that is bounded."""
    return anything() if field.bridge is not None and not is_bounded(field.kind) else _kind(field.kind)


def is_bounded(kind: Kind) -> bool:
    """Whether it is a text, or an array of texts, that may have so many letters and no more."""
    return is_bounded(kind.item) if isinstance(kind, Array) else isinstance(kind, Single) and kind.most is not None


def _kind(kind: Kind) -> st.SearchStrategy[Any]:
    match kind:
        case Part(shape):
            return messages(shape.type)
        case Array():
            return _array(kind)
        case Single("string" | "wstring"):
            return TEXTS if kind.most is None else TEXTS.map(lambda text: text[: kind.most])
        case Single("bool"):
            return st.booleans()
        case Single("float64"):
            return DOUBLES
        case Single("float32"):
            return st.one_of(st.floats(width=32), st.floats(-1e30, 1e30))
    return st.integers(*(kind.limits or INTEGERS[kind.ros]))


def _array(kind: Array) -> st.SearchStrategy[Any]:
    least = kind.length or 0
    most = kind.length if kind.length is not None else min(MOST, kind.most or MOST)
    if kind.holds in ("list", "tuple"):
        found: st.SearchStrategy[Any] = st.lists(_kind(kind.item), min_size=least, max_size=most)
        return found.map(tuple) if kind.holds == "tuple" else found
    data: st.SearchStrategy[Any] = st.binary(
        min_size=least, max_size=most if kind.length is not None else kind.most or 20
    )
    return data.map(memoryview) if kind.holds == "memoryview" else data


def rounded(message: M) -> M:
    """A message with what float32 leaves of its numbers of that width."""
    shape = shape_of(type(message))
    return type(message)(**{field.attribute: _rounded(field, message) for field in shape.fields})


def _rounded(field: Field, message: Message) -> Any:
    value = getattr(message, field.attribute)
    return value if field.bridge is not None else _rounded_kind(field.kind, value)


def _rounded_kind(kind: Kind, value: Any) -> Any:
    match kind:
        case Part():
            return rounded(value)
        case Array() if isinstance(value, (list, tuple)):
            return type(value)(_rounded_kind(kind.item, one) for one in value)
        case Single("float32"):
            return struct.unpack("<f", struct.pack("<f", value))[0]
    return value
