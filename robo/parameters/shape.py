"""What single parameters a Struct has, by name: those of a Struct within have names with dots, `gains.p`.

A field may be a map of Structs whose names its user chooses, as `zones: dict[str, Zone]`. Its parameters are declared
as `zones.*.radius`, and a node whose user speaks of a zone `front` has a parameter `zones.front.radius`.
"""

import typing
from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Any, NamedTuple, TypeVar

import msgspec

from robo.errors import ContractError
from robo.parameters.hints import READ_ONLY, extras_of, plain_type
from robo.wire.names import is_word

S = TypeVar("S", bound=msgspec.Struct)

ANY_NAME = "*"
"""Stands in the declared name of a parameter for the name that a user gives to an entry of a map."""


class Leaf(NamedTuple):
    """A single parameter."""

    name: str
    hint: Any
    """Its type, with what it is annotated."""
    value: Any


class _Field(NamedTuple):
    name: str
    hint: Any
    inner: type[msgspec.Struct] | None
    """What it is, or what its entries are, where that is a Struct."""
    is_map: bool


_declared_of: dict[type[Any], dict[str, Leaf]] = {}


def declared(cls: type[Any]) -> dict[str, Leaf]:
    """Every single parameter that a class declares, by name, with its default; those of maps also as `zones.*.radius`.

    What has to be said of each entry of a map has None for a default.

    Raises:
        ContractError: a field of a Struct within has no default, or a map is marked as read-only as a whole.
    """
    found = _declared_of.get(cls)
    if found is None:
        found = {leaf.name: leaf for leaf in _walk(cls, _defaults(cls), "", as_declared=True)}
        _declared_of[cls] = found
    return found


def leaves(values: msgspec.Struct) -> Iterator[Leaf]:
    """Every single parameter of a Struct with its value, in the order of declaration and of each map."""
    return _walk(type(values), _values(values), "", as_declared=False)


def _walk(cls: type[Any], values: Mapping[str, Any], outer: str, *, as_declared: bool) -> Iterator[Leaf]:
    for name, hint, inner, is_map in _fields(cls):
        full = f"{outer}{name}"
        if inner is None:
            yield Leaf(full, hint, values.get(name))
        elif not is_map:
            yield from _walk(inner, _values(values[name]), f"{full}.", as_declared=as_declared)
        else:
            for key, entry in values[name].items():
                yield from _walk(inner, _values(entry), f"{full}.{key}.", as_declared=as_declared)
            if as_declared:
                yield from _walk(inner, _defaults(inner), f"{full}.{ANY_NAME}.", as_declared=True)


def _values(struct: Any) -> dict[str, Any]:
    return {name: getattr(struct, name) for name in struct.__struct_fields__}


def assembled(current: S, values: Mapping[str, object]) -> S:
    """A Struct like another one, with single values changed and entries of maps added.

    Args:
        current: a Struct.
        values: by name; what new entries have no default for is there, see `lacking`.

    Raises:
        Contradiction: a Struct refuses its values as a whole.
    """
    whole: S = _assembled(type(current), current, values, "")
    return whole


def lacking(current: msgspec.Struct, names: Collection[str]) -> dict[str, list[str]]:
    """What has neither a value nor a default in the new entries that declared names speak of, by entry."""
    known = declared(type(current))
    given = {*names, *(leaf.name for leaf in leaves(current))}
    found: dict[str, list[str]] = {}
    for name in names:
        parts, pattern = name.split("."), (declared_as(name, known) or "").split(".")
        for end in [i for i, part in enumerate(pattern, start=1) if part == ANY_NAME]:
            entry, outer = ".".join(parts[:end]), ".".join(pattern[:end]) + "."
            fields = [one.name.removeprefix(outer) for one in known.values() if one.name.startswith(outer)]
            wanted = [field for field in fields if ANY_NAME not in field and known[outer + field].value is None]
            found[entry] = [field for field in wanted if f"{entry}.{field}" not in given]
    return {entry: fields for entry, fields in found.items() if fields}


def _assembled(cls: type[Any], current: Any, values: Mapping[str, object], outer: str) -> Any:
    """`current`: None for a new entry of a map, which begins with its declared defaults."""
    old = _defaults(cls) if current is None else _values(current)
    fields: dict[str, object] = {}
    for name, _, inner, is_map in _fields(cls):
        full = f"{outer}{name}"
        within = [key.removeprefix(f"{full}.") for key in values if key.startswith(f"{full}.")]
        if full in values:
            fields[name] = values[full]
        elif inner is None or not within:
            fields[name] = old[name]
        elif is_map:
            keys = dict.fromkeys([*old[name], *(key.partition(".")[0] for key in within)])
            fields[name] = {key: _assembled(inner, old[name].get(key), values, f"{full}.{key}.") for key in keys}
        else:
            fields[name] = _assembled(inner, old[name], values, f"{full}.")
    try:
        return cls(**fields)
    except (ValueError, TypeError) as error:  # raised by a __post_init__
        raise Contradiction(outer, str(error)) from None


def _defaults(cls: type[Any]) -> dict[str, Any]:
    return {
        field.name: field.default if field.default_factory is msgspec.NODEFAULT else field.default_factory()
        for field in msgspec.structs.fields(cls)
        if not field.required
    }


class Contradiction(ValueError):
    """Values that are right each by itself do not go together."""

    def __init__(self, outer: str, text: str) -> None:
        super().__init__(f"{outer.removesuffix('.')}: {text}" if outer else text)
        self.outer = outer
        """What the names of the values in question begin with."""


def declared_as(name: str, declared: Iterable[str]) -> str | None:
    """The declared name of a parameter: its own, or `zones.*.radius` for `zones.front.radius`; None where none is."""
    parts = name.split(".")
    if ANY_NAME in parts:
        return None
    return name if name in declared else next((one for one in declared if _fits(parts, one.split("."))), None)


def is_group(name: str, declared: Iterable[str]) -> bool:
    """Whether a name is that of a Struct, of a map of them or of an entry, by the names of all single parameters."""
    parts = name.split(".")
    return any(len(outer := one.split(".")) > len(parts) and _fits(parts, outer[: len(parts)]) for one in declared)


def _fits(parts: list[str], pattern: list[str]) -> bool:
    return len(parts) == len(pattern) and all(
        wanted == part or (wanted == ANY_NAME and is_word(part)) for part, wanted in zip(parts, pattern, strict=True)
    )


_fields_of: dict[type[Any], list[_Field]] = {}


def _fields(cls: type[Any]) -> list[_Field]:
    """The fields of a Struct; those that every node has come last."""
    found = _fields_of.get(cls)
    if found is None:
        found = [_field(cls, name, hint) for name, hint in _types_of(cls).items()]
        found = _fields_of[cls] = sorted(found, key=lambda field: field.name == "use_sim_time")
    return found


def _types_of(cls: type[Any]) -> dict[str, Any]:
    """The types of all fields, with what they are annotated."""
    return {
        name: hint
        for name, hint in typing.get_type_hints(cls, include_extras=True).items()
        if name in cls.__struct_fields__
    }


def _field(cls: type[Any], name: str, hint: Any) -> _Field:
    plain = plain_type(hint)
    if isinstance(plain, type) and issubclass(plain, msgspec.Struct):
        refuse_missing_defaults(plain)
        return _Field(name, hint, plain, False)
    arguments = typing.get_args(plain)
    if typing.get_origin(plain) is dict and isinstance(arguments[1], type) and issubclass(arguments[1], msgspec.Struct):
        if READ_ONLY in extras_of(hint):
            where = f"{cls.__qualname__}.{name}"
            raise ContractError(f"{where}: READ_ONLY stands with the fields of {arguments[1].__qualname__} instead")
        return _Field(name, hint, arguments[1], True)
    return _Field(name, hint, None, False)


def refuse_missing_defaults(cls: type[Any]) -> None:
    """Raises ContractError where a field has no default."""
    for field in msgspec.structs.fields(cls):
        if field.required:
            raise ContractError(f"{cls.__qualname__}.{field.name} has no default; give it one")
