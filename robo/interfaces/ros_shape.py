"""The fields of a message type as ROS has them: what its text, its bytes and its hash are made of. Pure.

Python's types are wider than ROS's. A field that ROS has a type for is that type. One of any type is ROS's
`ParameterValue`; one that may be None is a sequence of at most one; of an enumeration its value. What ROS has no word
for, such as a map, is a string that holds it as JSON: every type of a user can be written down and read again.
"""

import re
from typing import Literal, NamedTuple

import msgspec
from msgspec import inspect

import robo_messages
from robo.errors import ContractError
from robo.interfaces import ros_values
from robo.interfaces.ros_names import full_name
from robo.interfaces.ros_values import Bridge
from robo_messages import Message

INTEGERS = {
    "int8": (-(2**7), 2**7 - 1),
    "uint8": (0, 2**8 - 1),
    "byte": (0, 2**8 - 1),
    "char": (0, 2**8 - 1),
    "int16": (-(2**15), 2**15 - 1),
    "uint16": (0, 2**16 - 1),
    "int32": (-(2**31), 2**31 - 1),
    "uint32": (0, 2**32 - 1),
    "int64": (-(2**63), 2**63 - 1),
    "uint64": (0, 2**64 - 1),
}
"""The least and the largest number of each."""
FLOATS = ("float32", "float64")
TEXTS = ("string", "wstring")
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_BYTES = ("uint8", "int8", "byte", "char")

Holds = Literal["list", "tuple", "bytes", "bytearray", "memoryview", "packed"]


class Single(NamedTuple):
    """One value."""

    ros: str
    """`float32`, `string`, …"""
    limits: tuple[int, int] | None = None
    """The least and the largest whole number, where that is less than its width takes."""
    most: int | None = None
    """How long a text may be, letters."""


class Part(NamedTuple):
    """A message."""

    shape: "Shape"


class Array(NamedTuple):
    """Values of one type."""

    item: Single | Part
    holds: Holds
    """What Python has; `packed` is a MessagePack array of floats that nobody has looked into."""
    length: int | None = None
    """How many, always."""
    most: int | None = None
    """How many at most."""


Kind = Single | Part | Array


class Field(NamedTuple):
    """A field of a message."""

    attribute: str
    name: str
    """As it travels."""
    kind: Kind
    bridge: Bridge | None


class Shape(NamedTuple):
    """A message type."""

    name: str
    """In robo."""
    ros_name: str
    """In ROS, whole: `geometry_msgs/msg/Twist`."""
    type: type[Message]
    fields: tuple[Field, ...]


_known: dict[type[Message], Shape] = {}
"""What was found out: a message may be within others in more ways than can be gone."""


def shape_of(type_: type[Message]) -> Shape:
    """The fields of a message type, and those of all types in it.

    Raises:
        ContractError: ROS cannot have this type; names the field.
        UnknownType: it, or one within it, was never registered.
    """
    return _shape(type_, ())


def _shape(type_: type[Message], within: tuple[type[Message], ...]) -> Shape:
    if type_ not in _known:
        _known[type_] = _found(type_, within)
    return _known[type_]


def _found(type_: type[Message], within: tuple[type[Message], ...]) -> Shape:
    name = robo_messages.type_name(type_)
    registered = robo_messages.find_type(name)
    if type_ is not registered:
        return _other_form(type_, _shape(registered, within))
    info = inspect.type_info(type_)
    assert isinstance(info, inspect.StructType)
    hints = {field.name: field.type for field in msgspec.structs.fields(type_)}
    fields = tuple(_field(field, hints[field.name], name, (*within, type_)) for field in info.fields)
    if any(field.bridge is not None for field in fields):
        # What msgspec must know of the type to check values: made here, for two threads may not make it at once.
        robo_messages.decoder_of(type_)
    return Shape(name, full_name(name), type_, fields)


def _other_form(type_: type[Message], shape: Shape) -> Shape:
    """Another class for the same fields, some of which it leaves as they travel: a `LaserScanArray`."""
    info = inspect.type_info(type_)
    assert isinstance(info, inspect.StructType)
    fields = []
    for own, field in zip(info.fields, shape.fields, strict=True):
        kind = field.kind
        if isinstance(own.type, inspect.RawType) and isinstance(kind, Array):
            kind = kind._replace(holds="packed")
        fields.append(field._replace(attribute=own.name, kind=kind))
    return shape._replace(type=type_, fields=tuple(fields))


def _field(field: inspect.Field, hint: object, owner: str, within: tuple[type[Message], ...]) -> Field:
    name = field.encode_name
    where = f"{owner}.{name}"
    if not _NAME.fullmatch(name):
        raise ContractError(f"{where}: ROS's names of fields are letters, digits and _ of ASCII")
    found = _Reading(where, within)
    kind = found.kind(field.type)
    if kind is None:
        return Field(field.name, name, Single("string"), ros_values.as_json(hint))
    return Field(field.name, name, kind, _bridge(field.type, hint, kind, found))


def _bridge(info: inspect.Type, hint: object, kind: "Kind", found: "_Reading") -> Bridge | None:
    """What stands between a field and ROS; nothing where its values are ROS's."""
    if found.of_any:
        return ros_values.ANY_LIST if isinstance(kind, Array) else ros_values.ANY
    has_parts = isinstance(kind, Part) or (isinstance(kind, Array) and isinstance(kind.item, Part))
    inner = None if found.exact else ros_values.checked(hint, as_plain=not has_parts)
    return ros_values.optional(inner) if _optional(info) else inner


def ros_kind(info: inspect.Type, where: str = "") -> Kind:
    """What ROS has for a Python type."""
    return _Reading(where, ()).kind(info) or Single("string")


def _optional(info: inspect.Type) -> bool:
    if isinstance(info, inspect.Metadata):
        return _optional(info.type)
    return isinstance(info, inspect.UnionType)


class _Reading:
    """Finds what ROS has for one field."""

    def __init__(self, where: str, within: tuple[type[Message], ...]) -> None:
        self._where = where
        self._within = within
        self.exact = True
        """Whether what ROS tells is the field's value, and every one that its type takes."""
        self.of_any = False
        """Whether a value may be of any type."""

    def kind(self, info: inspect.Type, word: str | None = None) -> Kind | None:
        """ROS's type; None where it has no such thing."""
        match info:
            case inspect.Metadata():
                return self.kind(info.type, (info.extra or {}).get("ros", word))
            case inspect.ListType() | inspect.VarTupleType():
                return self._array(info, "tuple" if isinstance(info, inspect.VarTupleType) else "list", word)
            case inspect.TupleType():
                return self._tuple(info)
            case inspect.BytesType() | inspect.ByteArrayType() | inspect.MemoryViewType():
                return self._bytes(info, word)
            case inspect.UnionType():
                return self._union(info)
            case inspect.RawType() | inspect.ExtType():
                raise ContractError(f"{self._where}: ROS has no type for what is left as it travels ({_said(info)})")
        return self._single(info, word)

    def _single(self, info: inspect.Type, word: str | None) -> Single | Part | None:
        match info:
            case inspect.StructType() if issubclass(info.cls, Message):
                if info.cls in self._within:
                    raise ContractError(f"{self._where}: ROS has no type that holds itself")
                return Part(_shape(info.cls, self._within))
            case inspect.AnyType():
                self.of_any = True
                return Part(shape_of(robo_messages.find_type("system/ParameterValue")))
            case inspect.BoolType():
                return Single(self._word(word or "bool", ("bool",), info))
            case inspect.IntType():
                return self._integer(info, self._word(word or "int64", INTEGERS, info))
            case inspect.FloatType():
                bounds = (info.ge, info.gt, info.le, info.lt, info.multiple_of)
                self.exact &= all(bound is None for bound in bounds)
                return Single(self._word(word or "float64", FLOATS, info))
            case inspect.StrType():
                self.exact &= info.min_length is None and info.max_length is None and info.pattern is None
                return Single(self._word(word or "string", TEXTS, info), most=info.max_length)
            case inspect.LiteralType():
                return self._one_of(info.values)
            case inspect.EnumType():
                return self._one_of(tuple(one.value for one in info.cls))
        return None

    def _integer(self, info: inspect.IntType, word: str) -> Single:
        least, most = INTEGERS[word]
        low = info.ge if info.ge is not None else info.gt + 1 if info.gt is not None else least
        high = info.le if info.le is not None else info.lt - 1 if info.lt is not None else most
        self.exact &= info.multiple_of is None
        limits = max(least, low), min(most, high)
        return Single(word, None if limits == (least, most) else limits)

    def _one_of(self, values: tuple[object, ...]) -> Single | None:
        """A value of several that are named."""
        self.exact = False
        if all(isinstance(value, str) for value in values):
            return Single("string")
        whole = all(isinstance(value, int) and not isinstance(value, bool) for value in values)
        return Single("int64") if whole else None

    def _array(self, info: inspect.ListType | inspect.VarTupleType, holds: Holds, word: str | None) -> Array | None:
        item = self.kind(info.item_type, word.partition("[")[0] if word else None)
        if item is None or isinstance(item, Array):
            return None
        self.exact &= not (isinstance(item, Single) and item.limits is not None)
        if info.min_length is not None and info.min_length == info.max_length:
            return Array(item, holds, info.min_length)
        self.exact &= not info.min_length
        return Array(item, holds, most=info.max_length)

    def _tuple(self, info: inspect.TupleType) -> Array | None:
        kinds = [self.kind(item) for item in info.item_types]
        if not kinds or isinstance(kinds[0], Array | None) or any(kind != kinds[0] for kind in kinds):
            return None
        self.exact &= not (isinstance(kinds[0], Single) and kinds[0].limits is not None)
        return Array(kinds[0], "tuple", len(kinds))

    def _bytes(
        self, info: inspect.BytesType | inspect.ByteArrayType | inspect.MemoryViewType, word: str | None
    ) -> Array:
        item = Single(self._word((word or "uint8").partition("[")[0], _BYTES, info))
        holds: Holds = (
            "bytes" if isinstance(info, inspect.BytesType)
            else "bytearray" if isinstance(info, inspect.ByteArrayType) else "memoryview"
        )  # fmt: skip
        if info.min_length is not None and info.min_length == info.max_length:
            return Array(item, holds, info.min_length)
        self.exact &= not info.min_length
        return Array(item, holds, most=info.max_length)

    def _union(self, info: inspect.UnionType) -> Array | None:
        """Something or None, as a sequence of at most one."""
        there = [one for one in info.types if not isinstance(one, inspect.NoneType)]
        item = self.kind(there[0]) if len(there) == 1 and len(info.types) == 2 else None
        if item is None or isinstance(item, Array):
            return None
        self.exact &= not (isinstance(item, Single) and item.limits is not None)
        return Array(item, "list", most=1)

    def _word(self, word: str, words: "tuple[str, ...] | dict[str, tuple[int, int]]", info: inspect.Type) -> str:
        if word not in words:
            raise ContractError(f"{self._where}: {_said(info)} cannot be ROS's {word!r}; choose of {', '.join(words)}")
        return word


def _said(info: inspect.Type) -> str:
    return type(info).__name__.removesuffix("Type").lower()
