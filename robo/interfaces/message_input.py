"""From data that people or programs write (YAML, JSON) to messages, or to every mistake in them. Pure."""

import base64
import binascii
import functools
import re
from array import array
from collections.abc import Mapping
from typing import Any, Literal

import msgspec
from msgspec import inspect

import robo_messages
from robo.errors import MessageError
from robo.text.brief import shown
from robo.text.readable import readable
from robo.text.suggestions import suggest
from robo_messages import Header, Message, Time

_NON_FINITE = ("nan", "inf", "-inf")
"""How JSON writes numbers that it has not."""
_EXPONENT = re.compile(r"[-+]?\d+[eE][-+]?\d+\Z")
"""Numbers that YAML takes for text, because they have no dot."""


def message_of(type_: type[Message], data: object) -> Message:
    """A message from plain data, every field checked. Missing fields take their defaults.

    A Time may be written `now`, a Header `auto` (stamped with the time of now); bytes as base64 or as a list of
    numbers; NaN and infinities as "nan", "inf", "-inf".

    Raises:
        MessageError: the data do not fit; tells which fields, and what they should be.
    """
    plain = restored(type_, data)
    try:
        return msgspec.convert(plain, readable(type_))
    except (msgspec.ValidationError, ValueError, TypeError, OverflowError) as error:
        raise MessageError(_from_msgspec(robo_messages.type_name(type_), str(error))) from None


def restored(type_: type[Message], data: object) -> object:
    """Plain data with what JSON cannot hold put back: bytes, NaN, infinities. Nothing is added or reordered.

    Raises:
        MessageError: as `message_of`.
    """
    mistakes: list[str] = []
    plain = _read(data, _info(type_), robo_messages.type_name(type_), mistakes)
    if mistakes:
        raise MessageError("\n".join(mistakes))
    return plain


@functools.cache
def _info(type_: Any) -> inspect.Type:
    return inspect.type_info(type_)


def _read(value: object, info: inspect.Type, where: str, mistakes: list[str]) -> object:
    if isinstance(info, inspect.Metadata):
        if (info.extra or {}).get("ros") == "int8[]":
            return _read_bytes(value, where, mistakes, "b")
        return _read(value, info.type, where, mistakes)
    if isinstance(info, inspect.StructType):
        return _read_struct(value, info, where, mistakes)
    if isinstance(info, (inspect.ListType, inspect.VarTupleType)):
        if not isinstance(value, (list, tuple)):
            mistakes.append(f"{where}: expected a list of {_name(info.item_type)}, got {_value_text(value)}")
            return value
        if info.min_length is not None and info.min_length == info.max_length and len(value) != info.min_length:
            mistakes.append(f"{where}: expected {info.min_length} numbers, got {len(value)}")
        return [_read(item, info.item_type, f"{where}[{i}]", mistakes) for i, item in enumerate(value)]
    if isinstance(info, (inspect.BytesType, inspect.MemoryViewType, inspect.ByteArrayType)):
        return _read_bytes(value, where, mistakes)
    if (
        isinstance(info, inspect.FloatType)
        and isinstance(value, str)
        and (value in _NON_FINITE or _EXPONENT.match(value))
    ):
        return float(value)
    if not _fits(value, info):
        expected = "int of 64 bits" if isinstance(info, inspect.IntType) and _too_long(value) else _name(info)
        mistakes.append(f"{where}: expected {expected}, got {_value_text(value)}")
    return value


def _read_struct(value: object, info: inspect.StructType, where: str, mistakes: list[str]) -> object:
    fields = {field.encode_name: field for field in info.fields}
    if value == "now" and info.cls is Time:
        return msgspec.to_builtins(Time.now())
    if value == "auto" and info.cls is Header:
        return msgspec.to_builtins(Header.now())
    if not isinstance(value, Mapping):
        shape = ", ".join(f"{name}: {_name(field.type)}" for name, field in fields.items())
        mistakes.append(f"{where}: expected {_name(info)} {{{shape}}}, got {_value_text(value)}")
        return value
    plain: dict[object, object] = {}
    for name, item in value.items():
        field = fields.get(name) if isinstance(name, str) else None
        if field is None:
            instead = suggest(str(name), fields, "it has")
            mistakes.append(f"{where} has no field {shown(str(name))}; {instead}")
        else:
            plain[name] = _read(item, field.type, f"{where}.{name}", mistakes)
    return plain


_BYTES: dict[Literal["b", "B"], str] = {"b": "-128 to 127", "B": "0 to 255"}
"""From which number to which a byte is, by the code of `array`."""


def _read_bytes(value: object, where: str, mistakes: list[str], code: Literal["b", "B"] = "B") -> object:
    if isinstance(value, (bytes, bytearray, memoryview)):
        return value
    try:
        if isinstance(value, str):
            return base64.b64decode(value, validate=True)
        if isinstance(value, list):
            return array(code, value).tobytes()
    except (binascii.Error, ValueError, TypeError, OverflowError):
        pass
    expected = f"bytes, as base64 or a list of numbers from {_BYTES[code]}"
    mistakes.append(f"{where}: expected {expected}, got {_value_text(value)}")
    return value


def _fits(value: object, info: inspect.Type) -> bool:
    """Whether a single value fits; of kinds that messages seldom have, msgspec decides later."""
    if isinstance(info, inspect.BoolType):
        return isinstance(value, bool)
    if isinstance(info, inspect.StrType):
        return isinstance(value, str)
    if isinstance(info, (inspect.IntType, inspect.FloatType)):
        kinds = (int,) if isinstance(info, inspect.IntType) else (int, float)
        if not isinstance(value, kinds) or isinstance(value, bool):
            return False
        return (
            not _too_long(value)
            and (info.ge is None or value >= info.ge)
            and (info.gt is None or value > info.gt)
            and (info.le is None or value <= info.le)
            and (info.lt is None or value < info.lt)
        )
    return True


def _too_long(value: object) -> bool:
    """Whether MessagePack has no such integer."""
    return isinstance(value, int) and not -(2**63) <= value < 2**64


def _name(info: inspect.Type) -> str:
    """A type as a message calls it: `float`, `int from 0 to 255`, `geometry/Vector3`."""
    if isinstance(info, inspect.Metadata):
        return _name(info.type)
    if isinstance(info, inspect.StructType):
        return robo_messages.type_name(info.cls) if issubclass(info.cls, Message) else info.cls.__name__
    if isinstance(info, (inspect.ListType, inspect.VarTupleType)):
        return f"list of {_name(info.item_type)}"
    if isinstance(info, (inspect.BytesType, inspect.MemoryViewType, inspect.ByteArrayType)):
        return "bytes"
    plain = type(info).__name__.removesuffix("Type").lower()
    if isinstance(info, inspect.IntType) and (info.ge is not None or info.gt is not None):
        least = info.ge if info.ge is not None else (info.gt or 0) + 1
        most = info.le if info.le is not None else None if info.lt is None else info.lt - 1
        return f"{plain} from {least} to {most}" if most is not None else f"{plain} of at least {least}"
    return plain


def field_types(type_: type[Message]) -> dict[str, str]:
    """The fields of a message type with the names of their types."""
    info = _info(type_)
    assert isinstance(info, inspect.StructType)
    return {field.encode_name: _name(field.type) for field in info.fields}


def _value_text(value: object) -> str:
    return f"{type(value).__name__} {shown(value, 40)}"


def _from_msgspec(type_name: str, error: str) -> str:
    text, at, path = error.partition(" - at `$")
    what = (text[:1].lower() + text[1:]).replace("`", "")
    return f"{type_name}{path.rstrip('`') if at else ''}: {what}"
