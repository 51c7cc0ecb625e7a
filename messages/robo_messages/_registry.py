"""The two-way table of message types and their names, and what can be done knowing only a name."""

import importlib
import math
import threading
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import msgspec


class Message(msgspec.Struct, gc=False, forbid_unknown_fields=True):
    """Base of every message: a msgspec Struct that travels as a map of its field names.

    Unknown fields are refused: a message of another shape, or a misspelt field, must not decode to
    a message of defaults (a zero Twist where somebody meant to drive). Missing fields take their
    defaults. Messages cannot form reference cycles, so the garbage collector need not track them.
    """


M = TypeVar("M", bound=Message)

_by_name: dict[str, type[Message]] = {}
_by_type: dict[type[Message], str] = {}
_later: dict[str, str] = {}
"""Names whose module is imported when one of them is asked for."""


class UnknownType(LookupError):
    """No message type has this name, or this class was never registered."""


def message(name: str) -> Callable[[type[M]], type[M]]:
    """Register a message type under `name`, written `group/Type`; a package of your own may do so too.

    >>> @message("my_robot/Gripper")
    ... class Gripper(Message):
    ...     width: float = 0.0

    Raises:
        ValueError: the name is not of the form `group/Type`, or another class has it already.
    """
    group, slash, type_name = name.partition("/")
    if not (slash and group.isidentifier() and type_name.isidentifier()):
        raise ValueError(f"message name {name!r}: expected group/Type, for example geometry/Twist")

    def register(cls: type[M]) -> type[M]:
        other = _by_name.get(name)
        later = _later.get(name), type_name.replace("_", ".")  # a part of a service is a class in a class
        owner = (other.__module__, other.__qualname__) if other is not None else later
        if owner[0] is not None and owner != (cls.__module__, cls.__qualname__):
            raise ValueError(f"message name {name!r} belongs to {owner[0]}.{owner[1]}")
        _by_name[name] = cls
        _by_type[cls] = name
        return cls

    return register


def form_of(registered: type[Message]) -> Callable[[type[M]], type[M]]:
    """Let another class stand for a registered type: its messages travel under the same name, with the same fields.

    A name still means the registered class.

    >>> @form_of(Twist)
    ... class PlanarTwist(Message): ...
    """

    def register(cls: type[M]) -> type[M]:
        _by_type[cls] = type_name(registered)
        return cls

    return register


def import_later(modules: Mapping[str, str]) -> None:
    """Register names of types with the modules that say them, which are imported when one is looked up."""
    _later.update(modules)


def type_name(cls: type[Message]) -> str:
    """The registered name of a message class, for example `geometry/Twist`.

    Raises:
        UnknownType: the class was never registered.
    """
    try:
        return _by_type[cls]
    except KeyError:
        raise UnknownType(
            f"{cls.__module__}.{cls.__qualname__} has no message name; "
            f'put @robo_messages.message("my_package/{cls.__name__}") above the class'
        ) from None


def find_type(name: str) -> type[Message]:
    """The message class of a name.

    Raises:
        UnknownType: no class is registered under it; names what comes close.
    """
    if name not in _by_name and name in _later:
        importlib.import_module(_later[name])
    try:
        return _by_name[name]
    except KeyError:
        import difflib

        close = difflib.get_close_matches(name, type_names(), n=1)
        hint = f"; did you mean {close[0]}?" if close else ""
        raise UnknownType(f"no message type is named {name!r}{hint}") from None


def type_names() -> list[str]:
    """Every registered name, sorted. Looking at them imports nothing."""
    return sorted({*_by_name, *_later})


_encoder = msgspec.msgpack.Encoder()
_json_encoder = msgspec.json.Encoder()
_decoders: dict[type[Message], msgspec.msgpack.Decoder[Any]] = {}
_making = threading.RLock()  # a collection in the midst of it may run anything


def encode(msg: Message) -> bytes:
    """A message as MessagePack: one map, keyed by field names."""
    return _encoder.encode(msg)


def decode(payload: bytes | bytearray | memoryview, type_: type[M]) -> M:
    """A message from MessagePack. Bulk fields (`memoryview`) point into `payload`: no copy is made.

    Raises:
        msgspec.DecodeError: the payload is cut short or no MessagePack.
        msgspec.ValidationError: it has another shape; says which field and what it should be.
    """
    result: M = _decoder(type_).decode(payload)
    return result


def _decoder(type_: type[M]) -> msgspec.msgpack.Decoder[M]:
    """That of a type, made when it is first needed; from then on msgspec knows the type."""
    decoder = _decoders.get(type_)
    if decoder is None:
        decoder = _decoders[type_] = decoder_of(type_)
    return decoder


def decoder_of(type_: type[M]) -> msgspec.msgpack.Decoder[M]:
    """What decodes messages of one type, for whoever has many of them; any thread may ask for one.

    With msgspec 0.22 two threads may not make decoders at once: of a type, or a part of it, that is new to both, the
    second one gets what the first has half made, and crashes with it.
    """
    with _making:
        return msgspec.msgpack.Decoder(type_)


def encode_json(msg: Message) -> bytes:
    """A message as JSON. Bulk fields are base64 text; NaN and infinities are "nan", "inf", "-inf"."""
    text = _json_encoder.encode(msg)
    # msgspec writes null for them, and for nothing else: only then is it done again, which takes longer.
    return _json_encoder.encode(_as_json(msgspec.to_builtins(msg))) if b"null" in text else text


def _as_json(value: object) -> object:
    """Plain data with NaN and infinities as text."""
    if isinstance(value, float):
        return value if math.isfinite(value) else str(value)
    if isinstance(value, dict):
        return {key: _as_json(item) for key, item in value.items()}
    return [_as_json(item) for item in value] if isinstance(value, (list, tuple)) else value


def decode_json(payload: bytes | str, type_: type[M]) -> M:
    """A message from JSON. JSON has no NaN and no infinities: write them "nan", "inf", "-inf".

    Raises:
        msgspec.DecodeError, msgspec.ValidationError: as `decode`.
    """
    _decoder(type_)  # msgspec knows the type from now on, whichever form it reads
    return msgspec.json.decode(payload, type=type_, strict=False)


def json_schema(type_: type[Message] | str) -> dict[str, Any]:
    """The JSON Schema of a message type, given as a class or by name. A default of NaN is "nan", as in JSON.

    Raises:
        UnknownType: no class is registered under that name.
    """
    schema = _as_json(msgspec.json.schema(find_type(type_) if isinstance(type_, str) else type_))
    assert isinstance(schema, dict)
    return schema
