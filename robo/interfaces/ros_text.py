"""Message types as ROS writes them: the text of a `.msg`, `.srv` or `.action` file."""

import base64
import math
from collections.abc import Iterator
from typing import Any, get_args, get_type_hints

from msgspec import inspect

from robo.interfaces import catalogue
from robo.interfaces.ros_names import ros_name
from robo.interfaces.ros_shape import Array, Field, Kind, Part, Shape, Single, ros_kind, shape_of
from robo_messages import Message

SEPARATOR = "=" * 80
"""Between a type and those of its fields."""
_WIDTHS = (("uint8", 0, 2**8), ("int8", -(2**7), 2**7), ("int32", -(2**31), 2**31), ("int64", -(2**63), 2**63))


def ros_text(name: str) -> str:
    """The definition of a message, a service or an action, without those of the messages in it.

    Raises:
        robo_messages.UnknownType: there is no such type.
        ContractError: ROS cannot have this type; names the field.
    """
    parts = [_message(catalogue.find(part)) for part in catalogue.parts(name)]
    return "\n---\n".join(["\n".join([f"# {ros_name(name)}", *parts[0]]), *("\n".join(part) for part in parts[1:])])


def whole_text(name: str) -> str:
    """The definition of a type and below it those of all messages in it, each behind a line of 80 `=` and its name.

    Of a message it is what recordings hold as its schema, in the encoding `ros2msg`.

    Raises:
        UnknownType, ContractError: as `ros_text`.
    """
    within: dict[str, Shape] = {}
    for part in catalogue.parts(name):
        for shape in within_of(shape_of(catalogue.find(part))):
            within.setdefault(shape.name, shape)
    texts = [ros_text(name)]
    for shape in within.values():
        texts.append("\n".join([SEPARATOR, f"MSG: {ros_name(shape.name)}", *_message(shape.type)]))
    return "\n".join(texts)


def within_of(shape: Shape) -> Iterator[Shape]:
    """The messages in a message, those within them as well, each once."""
    return _within(shape, set())


def _within(shape: Shape, seen: set[str]) -> Iterator[Shape]:
    for field in shape.fields:
        kind = field.kind.item if isinstance(field.kind, Array) else field.kind
        if isinstance(kind, Part) and kind.shape.name not in seen:
            seen.add(kind.shape.name)
            yield kind.shape
            yield from _within(kind.shape, seen)


def _message(type_: type[Message]) -> list[str]:
    interface = catalogue.describe(type_)
    head = [f"# {line}".rstrip() for line in interface.description.splitlines()]
    lines = [
        f"{kind} {key}={_literal(interface.constants[key])}" for key, kind in _constant_types(type_, interface).items()
    ]
    for field, said in zip(shape_of(type_).fields, interface.fields, strict=True):
        comment = " ".join(part for part in (said.description, _note(field, said.default)) if part)
        if comment:
            lines.append(f"# {comment}")
        lines.append(f"{ros_word(field.kind)} {field.name}{_default(said.default, field)}")
    # What the message says of itself ends with a blank line where what its first field says would follow.
    return [*head, *([""] if lines and lines[0].startswith("#") else []), *lines]


def _note(field: Field, default: object) -> str:
    """What ROS has no word for."""
    if field.bridge is not None and field.bridge.is_json:
        return "As JSON."
    return f"By default {catalogue.default_text(default)}." if _is_unsaid(default) else ""


def _is_unsaid(default: object) -> bool:
    """Whether readers would not find a default as it is.

    Foxglove's refuses a text with one that is NaN or infinite; of texts ROS knows no escape but that of a quote.
    """
    if isinstance(default, str):
        return "\\" in default or not default.isprintable()
    return isinstance(default, float) and not math.isfinite(default)


def _constant_types(type_: type[Message], interface: catalogue.Interface) -> dict[str, str]:
    """The constants with their types: the one that is said, else for whole numbers the first that takes them all."""
    values = [value for value in interface.constants.values() if type(value) is int]
    plain = next(name for name, least, end in _WIDTHS if all(least <= value < end for value in values))
    words = {bool: "bool", int: plain, float: "float64", str: "string"}
    hints = get_type_hints(type_, include_extras=True)
    return {key: _said(get_args(hints[key])) or words[type(value)] for key, value in interface.constants.items()}


def _said(said: tuple[Any, ...]) -> str | None:
    """What the type within a ClassVar is called in ROS; None for a plain one."""
    info = inspect.type_info(said[0])
    return str(info.extra["ros"]) if isinstance(info, inspect.Metadata) and info.extra else None


def ros_type(info: inspect.Type) -> str:
    """A field's type as ROS writes it: `float32[]`, `geometry_msgs/Point`."""
    return ros_word(ros_kind(info))


def ros_word(kind: Kind) -> str:
    """What ROS has for a field, as it writes it."""
    match kind:
        case Single(word):
            return word if kind.most is None else f"{word}<={kind.most}"
        case Part(shape):
            return ros_name(shape.name)
        case Array(item):
            bound = kind.length if kind.length is not None else "" if kind.most is None else f"<={kind.most}"
            return f"{ros_word(item)}[{bound}]"


def _default(value: object, field: Field) -> str:
    """A default other than ROS's own zero."""
    if field.bridge is not None and field.bridge.is_json:
        return ""
    match field.kind:
        case Single():
            return f" {_literal(value)}" if value and not _is_unsaid(value) else ""
        case Array(Single(), length=length) as kind:
            values = _values(value, kind)
            if any(map(_is_unsaid, values)) or not (values if length is None else any(values)):
                return ""
            return f" [{', '.join(map(_literal, values))}]"
    return ""


def _values(value: object, kind: Array) -> list[object]:
    """The elements of an array's default; one that may be None is no array here."""
    if isinstance(value, str) and kind.holds in ("bytes", "bytearray", "memoryview"):
        data = base64.b64decode(value)
        return list(memoryview(data).cast("b") if kind.item == Single("int8") else data)
    return list(value) if isinstance(value, (list, tuple)) else []


def _literal(value: object) -> str:
    return str(value) if isinstance(value, float) and not math.isfinite(value) else catalogue.default_text(value)
