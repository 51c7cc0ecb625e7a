"""The pages of message types: one for each group."""

import functools
import json
import textwrap
from collections.abc import Callable
from typing import Any

import msgspec
from msgspec import inspect as shapes

import robo_messages
from docs_tools.reference.markdown import Gap, block, code, described, link, paragraphs, prose, table
from robo.interfaces import catalogue
from robo.interfaces.ros_names import ros_name
from robo.interfaces.ros_text import ros_type
from robo.wire.codec import jsonable
from robo_messages import Message

_INTRO = """\
Types as ROS writes them: `float32` and `float64` are a `float` in Python, integers an `int` that is refused beyond its
width, `uint8[]`, `byte[]` and `int8[]` a `memoryview`, other arrays a `list`, of fixed length a `tuple`. On the wire a
message is a [MessagePack map](../messages.md); an example shows that map as JSON, with one element in each list. JSON
has bytes as base64 and NaN as `"nan"`."""

WIDTH = 110
"""A line of an example is broken beyond so many letters."""

UNITS = (
    "m", "m²", "m/s", "m/s²", "m²/s²", "m²/s⁴", "rad", "rad²", "rad/s", "rad/s²", "rad²/s²", "m·rad", "m·rad/s", "s",
    "V", "A", "Ah", "°", "°C", "N", "N·m", "m per cell", "pixels",
)  # fmt: skip
WITHOUT_UNIT = (
    "0 to 1", "-1 to 1", "without unit", "the same", "cos(a / 2)", "in the unit", "own unit", "the number",
)  # fmt: skip
"""What the description of a number with a point says that has no unit."""


def groups() -> dict[str, str]:
    """The groups of types that ship, each with the names of its types and services."""
    found: dict[str, dict[str, None]] = {}
    for name in shipped():
        group, _, last = name.removesuffix("_Request").removesuffix("_Response").partition("/")
        found.setdefault(group, {})[last] = None
    return {group: f"{', '.join(names)}." for group, names in sorted(found.items())}


@functools.cache
def shipped() -> tuple[str, ...]:
    """The names of all types that ship; of a service its two halves."""
    names = robo_messages.type_names()
    return tuple(name for name in names if robo_messages.find_type(name).__module__.startswith("robo_messages."))


def page_of(group: str) -> str:
    """The page of a group."""
    return f"messages_{group}.md"


def link_to(name: str) -> str:
    """A link to a type or a service, from any page of the reference."""
    return link(name, name, page_of(name.partition("/")[0]))


def lines_of(group: str) -> Callable[[], list[str]]:
    """What makes the lines of a group's page."""
    return functools.partial(_lines, group)


def _lines(group: str) -> list[str]:
    found = [*_INTRO.splitlines(), ""]
    seen: set[str] = set()
    for name in shipped():
        service = name.removesuffix("_Request").removesuffix("_Response")
        if name.partition("/")[0] != group or service in seen:
            continue
        seen.add(service)
        found += _message(name) if service == name else _service(service)
    return found


def _service(name: str) -> list[str]:
    found = [f"## {name}", "", f"A service; in ROS {code(ros_name(name))}.", ""]
    for half, title in zip(robo_messages.halves_of(name), ("Request", "Response"), strict=True):
        found += [f"**{title}**", "", *_shape(half)]
    return found


def _message(name: str) -> list[str]:
    return [f"## {name}", "", f"In ROS {code(ros_name(name))}.", "", *_shape(name)]


def _shape(name: str) -> list[str]:
    type_ = robo_messages.find_type(name)
    interface = catalogue.describe(type_)
    constants = ", ".join(code(f"{key} = {value}") for key, value in interface.constants.items())
    info = shapes.type_info(type_)
    assert isinstance(info, shapes.StructType)
    rows = [
        (
            code(said.name),
            _type(field.type),
            _default(said.default, field.type),
            prose(described_field(name, said, field.type)),
        )
        for field, said in zip(info.fields, interface.fields, strict=True)
    ]
    return [
        *paragraphs(described(interface.description, name)),
        *([f"Constants: {constants}.", ""] if constants else []),
        *(table(("field", "type", "default", "what"), rows) or ["No fields.", ""]),
        *([block(example_text(type_), "json"), ""] if rows else []),
    ]


def described_field(name: str, field: catalogue.FieldInfo, info: shapes.Type) -> str:
    """What a field of a message is, and in which unit.

    Raises:
        Gap: it has no description, or is a number with a point and says no unit.
    """
    where = f"{name}.{field.name}"
    text = described(field.description, where)
    words = text.replace(",", " ").replace(";", " ").replace(".", " ").replace("(", " ").replace(")", " ").split()
    unitless = any(said in text.lower() for said in WITHOUT_UNIT) or "m per cell" in text
    if _is_decimal(info) and not unitless and not set(words) & set(UNITS):
        raise Gap(f"{where}: {text!r} says no unit; known ones are {', '.join(UNITS)}")
    return text


def _is_decimal(info: shapes.Type) -> bool:
    if isinstance(info, shapes.Metadata):
        return _is_decimal(info.type)
    if isinstance(info, (shapes.ListType, shapes.VarTupleType)):
        return _is_decimal(info.item_type)
    return isinstance(info, shapes.FloatType)


def _type(info: shapes.Type) -> str:
    if isinstance(info, shapes.StructType):
        assert issubclass(info.cls, Message)
        return link_to(robo_messages.type_name(info.cls))
    if isinstance(info, (shapes.ListType, shapes.VarTupleType)) and isinstance(info.item_type, shapes.StructType):
        return f"list of {_type(info.item_type)}"
    return "any value" if isinstance(info, shapes.AnyType) else ros_type(info)


def _default(value: object, info: shapes.Type) -> str:
    """A default that is not the zero of its type."""
    if isinstance(value, (list, tuple, dict, memoryview, bytes)) or isinstance(info, shapes.StructType):
        return ""
    return code(catalogue.default_text(value)) if value else ""


def example_text(type_: type[Message]) -> str:
    """A message as JSON, as its MessagePack holds it: the defaults, with one element in each list."""
    return _pretty(jsonable(example(shapes.type_info(type_))), "")


def example(info: shapes.Type, default: object = None) -> Any:
    """Plain data of a type."""
    if isinstance(info, shapes.Metadata):
        return example(info.type, default)
    if isinstance(info, shapes.StructType):
        plain = msgspec.to_builtins(info.cls(), builtin_types=(memoryview,))
        return {field.encode_name: example(field.type, plain[field.encode_name]) for field in info.fields}
    if isinstance(info, shapes.ListType):
        return [example(info.item_type, _ZEROS.get(_plain_kind(info.item_type)))]
    return default


_ZEROS: dict[type[shapes.Type], object] = {
    shapes.BoolType: False,
    shapes.FloatType: 0.0,
    shapes.IntType: 0,
    shapes.StrType: "",
}


def _plain_kind(info: shapes.Type) -> type[shapes.Type]:
    return _plain_kind(info.type) if isinstance(info, shapes.Metadata) else type(info)


def _pretty(value: Any, indent: str, before: str = "") -> str:
    """JSON that keeps in one line what fits there, behind what stands before it."""
    line = json.dumps(value, ensure_ascii=False)
    if len(indent) + len(before) + len(line) < WIDTH or not value or not isinstance(value, (dict, list)):
        return f"{indent}{before}{line}"
    deeper = f"{indent}  "
    if isinstance(value, dict):
        parts = [_pretty(item, deeper, f"{json.dumps(key)}: ") for key, item in value.items()]
        return f"{indent}{before}{{\n" + ",\n".join(parts) + f"\n{indent}}}"
    if isinstance(value[0], float):
        numbers = textwrap.fill(line[1:-1], WIDTH, initial_indent=deeper, subsequent_indent=deeper)
        return f"{indent}{before}[\n{numbers}\n{indent}]"
    return f"{indent}{before}[\n" + ",\n".join(_pretty(item, deeper) for item in value) + f"\n{indent}]"
