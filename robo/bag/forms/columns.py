"""Messages as rows of a table, and back: a column for each single value, named as fields are. Pure.

A list is one cell, as JSON, so that a table has the same columns whatever the messages hold. NaN and infinities are
written `NaN` and `Infinity` there, which Python's `json` and so pandas read as numbers.
"""

import base64
import functools
import json
from collections.abc import Mapping, Sequence
from typing import Any, Final, Literal, NamedTuple

import msgspec
from msgspec import inspect

from robo.errors import MessageError
from robo.interfaces.message_input import message_of
from robo.text.brief import shown
from robo_messages import Message

HEAD: Final = ("time", "arrived", "key", "type", "sequence_number")
"""The columns before those of fields: when a message was published and when it arrived, ns since the epoch; its topic
and type; its number, empty where there is none."""

Kind = Literal["text", "whole", "number", "truth", "bytes", "json"]


class Column(NamedTuple):
    """A single value of a message."""

    name: str
    """`pose.pose.position.x`."""
    kind: Kind
    attributes: tuple[str, ...]
    """The way to it in Python."""
    fields: tuple[str, ...]
    """The same as it travels."""


@functools.cache
def columns_of(type_: type[Message]) -> tuple[Column, ...]:
    """The columns of a type, in the order of its fields."""
    info = inspect.type_info(type_)
    assert isinstance(info, inspect.StructType)
    return tuple(_columns(info, (), ()))


def _columns(info: inspect.StructType, attributes: tuple[str, ...], fields: tuple[str, ...]) -> list[Column]:
    found: list[Column] = []
    for field in info.fields:
        type_ = field.type
        while isinstance(type_, inspect.Metadata):
            type_ = type_.type
        way, names = (*attributes, field.name), (*fields, field.encode_name)
        if isinstance(type_, inspect.StructType) and issubclass(type_.cls, Message):
            found += _columns(type_, way, names)
        else:
            found.append(Column(".".join(names), _kind(type_), way, names))
    return found


def _kind(info: inspect.Type) -> Kind:
    match info:
        case inspect.StrType():
            return "text"
        case inspect.BoolType():
            return "truth"
        case inspect.IntType():
            return "whole"
        case inspect.FloatType():
            return "number"
        case inspect.BytesType() | inspect.ByteArrayType() | inspect.MemoryViewType():
            return "bytes"
        case inspect.LiteralType() if all(isinstance(value, str) for value in info.values):
            return "text"
    return "json"


def cells_of(message: Message, columns: Sequence[Column]) -> list[str]:
    """The cells of a message's row."""
    found = []
    for column in columns:
        value: Any = message
        for attribute in column.attributes:
            value = getattr(value, attribute)
        found.append(_cell(value, column.kind))
    return found


def _cell(value: Any, kind: Kind) -> str:
    match kind:
        case "text":
            return str(value)
        case "truth":
            return "true" if value else "false"
        case "whole" | "number":
            return repr(value)
        case "bytes":
            return base64.b64encode(value).decode("ascii")
    return json.dumps(msgspec.to_builtins(value), ensure_ascii=False, separators=(",", ":"))


def message_from(type_: type[Message], columns: Sequence[Column], cells: Sequence[str]) -> Message:
    """The message of a row.

    Args:
        type_: of it.
        columns: of the type.
        cells: one for each column.

    Raises:
        MessageError: a cell is no value of its field; names the column.
    """
    data: dict[str, Any] = {}
    for column, cell in zip(columns, cells, strict=True):
        try:
            value = _value(cell, column.kind)
        except (ValueError, KeyError, RecursionError):
            raise MessageError(f"{column.name}: {shown(cell, 40)} is no {_WORDS[column.kind]}") from None
        *path, last = column.fields
        part = data
        for name in path:
            part = part.setdefault(name, {})
        part[last] = value
    return message_of(type_, data)


_WORDS: Mapping[Kind, str] = {
    "text": "text", "whole": "whole number", "number": "number", "truth": "true or false", "bytes": "base64",
    "json": "JSON",
}  # fmt: skip


def _value(cell: str, kind: Kind) -> Any:
    match kind:
        case "text":
            return cell
        case "truth":
            return _TRUTH[cell.lower()]
        case "whole" | "number" if "_" in cell or not cell.isascii():
            raise ValueError("Python would read it")
        case "whole":
            return int(cell)
        case "number":
            return float(cell)
        case "bytes":
            return base64.b64decode(cell, validate=True)
    return json.loads(cell)


_TRUTH = {"true": True, "false": False}
