"""Between values that ROS has no type for and those by which it is told of them. Pure.

All of it raises ValueError for a value that does not fit.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, cast

import msgspec

import robo_messages
from robo_messages import Message, ParameterValue

_BINARY = (bytes, bytearray, memoryview)


class Bridge(NamedTuple):
    """Between a field's value and what ROS is told."""

    to_ros: Callable[[Any], Any]
    from_ros: Callable[[Any], Any]
    is_json: bool = False
    """Whether ROS is told a string of JSON."""


def as_json(hint: Any) -> Bridge:
    """Of a type that ROS has no word for: a string with its JSON; NaN and infinities are text within it."""

    def from_ros(text: str) -> Any:
        try:
            return msgspec.json.decode(text, type=hint, strict=False)
        except RecursionError:
            raise ValueError("its JSON is nested too deeply") from None

    return Bridge(_json_text, from_ros, is_json=True)


def checked(hint: Any, *, as_plain: bool) -> Bridge:
    """Of a type that takes less than ROS's: a text of some pattern, one of an enumeration.

    Args:
        hint: the type.
        as_plain: whether ROS is told plain data rather than the value, which holds messages.
    """

    def to_ros(value: Any) -> Any:
        value = msgspec.convert(value, hint)
        return msgspec.to_builtins(value, builtin_types=_BINARY) if as_plain else value

    return Bridge(to_ros, lambda value: msgspec.convert(value, hint))


def optional(inner: Bridge | None) -> Bridge:
    """Of a value that may be None: a sequence of at most one."""
    to_ros, from_ros, _ = inner or _AS_IS
    return Bridge(
        lambda value: [] if value is None else [to_ros(value)],
        lambda values: from_ros(values[0]) if values else None,
    )


_AS_IS = Bridge(lambda value: value, lambda value: value)


def _parameter_value(value: Any) -> ParameterValue:
    """A value of any type as ROS says it; what that has no place for, such as a map, is JSON in its string."""
    match value:
        case None:
            return ParameterValue()
        case bool():
            return ParameterValue(type=1, bool_value=value)
        case int():
            return ParameterValue(type=2, integer_value=value)
        case float():
            return ParameterValue(type=3, double_value=value)
        case str():
            return ParameterValue(type=4, string_value=value)
        case bytes() | bytearray() | memoryview():
            return ParameterValue(type=5, byte_array_value=memoryview(value))
        case list() | tuple():
            return _array_value(value)
    return ParameterValue(type=4, string_value=_json_text(value))


def _array_value(value: Sequence[Any]) -> ParameterValue:
    kinds = set(map(type, value))
    if kinds == {bool}:
        return ParameterValue(type=6, bool_array_value=list(value))
    if kinds == {int}:
        return ParameterValue(type=7, integer_array_value=list(value))
    if kinds <= {int, float}:
        return ParameterValue(type=8, double_array_value=list(map(float, value)))
    if kinds == {str}:
        return ParameterValue(type=9, string_array_value=list(value))
    return ParameterValue(type=4, string_value=_json_text(value))


def _plain_value(said: ParameterValue) -> Any:
    match said.type:
        case 0:
            return None
        case 5:
            return bytes(said.byte_array_value)
        case 1 | 2 | 3 | 4 | 6 | 7 | 8 | 9:
            return getattr(said, ParameterValue.__struct_fields__[said.type])
    raise ValueError(f"a ParameterValue of type {said.type}; 0 to 9 are known")


def _json_text(value: Any) -> str:
    try:
        return robo_messages.encode_json(cast(Message, value)).decode()  # it takes whatever msgspec does
    except (TypeError, RecursionError) as error:
        raise ValueError(str(error)) from None


ANY = Bridge(_parameter_value, _plain_value)
"""Of a value of any type: ROS's `ParameterValue`."""
ANY_LIST = Bridge(lambda values: list(map(_parameter_value, values)), lambda values: list(map(_plain_value, values)))
