"""A node's parameters: one frozen msgspec Struct, typed, documented and constrained.

    class Parameters(robo.Parameters):
        log_rate: Annotated[float, Meta(gt=0, description="Hz")] = 1.0

Pure: from values to a Struct or to one error that names every mistake.
"""

import math
import typing
from collections.abc import Mapping
from typing import Any, TypeVar

import msgspec

from robo.errors import ContractError, ParameterError


class Parameters(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """Base of every node's parameters. Each field needs a default.

    Values cannot be assigned one by one: that would pass by their checks.
    """

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"parameter {name} cannot be assigned; parameters are checked and set as a whole")


P = TypeVar("P", bound=Parameters)


class ParameterInfo(msgspec.Struct, frozen=True):
    """What is known of one parameter without running its node."""

    name: str
    type: str
    default: object
    description: str
    constraints: dict[str, float | int | str]


def build(cls: type[P], values: Mapping[str, object], owner: str) -> P:
    """The parameters of a node, from values over the declared defaults.

    An int is accepted where a float is declared; NaN and infinities are refused.

    Args:
        cls: the node's Parameters.
        values: by name.
        owner: the node, for the message.

    Raises:
        ParameterError: a name is unknown or a value does not fit; names all of them.
    """
    types = _types(cls)
    mistakes = []
    converted: dict[str, object] = {}
    for name, value in values.items():
        if name not in types:
            import difflib  # only mistakes need it

            close = difflib.get_close_matches(name, types, n=1)
            hint = f"did you mean {close[0]}?" if close else f"it has {', '.join(types) or 'none'}"
            mistakes.append(f"{owner} has no parameter {name!r}; {hint}")
            continue
        try:
            converted[name] = msgspec.convert(value, types[name])
        except msgspec.ValidationError as error:
            mistakes.append(f"{owner}: {name} = {value!r}: {_readable(str(error))}{_about(types[name])}")
            continue
        if not _finite(converted[name]):
            mistakes.append(f"{owner}: {name} = {value!r}: expected a finite number{_about(types[name])}")
    if mistakes:
        raise ParameterError("\n".join(mistakes))
    return cls(**converted)


def describe(cls: type[Parameters]) -> list[ParameterInfo]:
    """Every parameter of a class, in the order of its declaration.

    Raises:
        ContractError: a parameter has no default.
    """
    types = _types(cls)
    infos = []
    for field in msgspec.structs.fields(cls):
        if field.required:
            raise ContractError(f"{cls.__qualname__}.{field.name} has no default; give it one")
        default = field.default if field.default is not msgspec.NODEFAULT else _made(field.default_factory)
        constraints = {
            key: value
            for meta in _metas(types[field.name])
            for key in ("gt", "ge", "lt", "le", "multiple_of", "pattern", "min_length", "max_length")
            if (value := getattr(meta, key)) is not None
        }
        infos.append(
            ParameterInfo(
                field.name, _type_name(types[field.name]), default, _description(types[field.name]), constraints
            )
        )
    return infos


def parse_assignment(text: str, cls: type[Parameters] | None = None) -> tuple[str, object]:
    """`name:=value` from a command line. Where `cls` declares the name as text, it stays text.

    Raises:
        ParameterError: there is no `:=`, or the value is cut short.
    """
    name, assign, value = text.partition(":=")
    if not assign or not name:
        raise ParameterError(f"parameter {text!r}: write name:=value, for example log_rate:=2.0")
    if cls is not None and _plain(_types(cls).get(name)) is str:
        return name, value
    return name, parse_value(value)


def parse_value(text: str) -> object:
    """A value as a command line writes it: true, 3, 2.5, [1, 2], {a: 1}, "quoted" or plain text.

    Raises:
        ParameterError: a list, map or quote is not closed.
    """
    stripped = text.strip()
    if stripped in ("true", "false"):
        return stripped == "true"
    for number in (int, float):
        try:
            return number(stripped)
        except ValueError:
            continue
    if stripped[:1] in ("[", "{", '"', "'"):
        import yaml

        try:
            value: object = yaml.safe_load(stripped)
        except yaml.YAMLError as error:
            raise ParameterError(f"value {text!r}: {error}") from None
        return value
    return text


def _types(cls: type[Parameters]) -> dict[str, Any]:
    return {
        name: hint
        for name, hint in typing.get_type_hints(cls, include_extras=True).items()
        if name in cls.__struct_fields__
    }


def _metas(hint: Any) -> list[msgspec.Meta]:
    return [extra for extra in getattr(hint, "__metadata__", ()) if isinstance(extra, msgspec.Meta)]


def _plain(hint: Any) -> Any:
    return typing.get_args(hint)[0] if hasattr(hint, "__metadata__") else hint


def _type_name(hint: Any) -> str:
    plain = _plain(hint)
    return getattr(plain, "__name__", None) or str(plain) if not typing.get_args(plain) else str(plain)


def _description(hint: Any) -> str:
    return next((meta.description for meta in _metas(hint) if meta.description), "")


def _about(hint: Any) -> str:
    description = _description(hint)
    return f" ({description})" if description else ""


def _readable(error: str) -> str:
    return error[:1].lower() + error[1:].replace("`", "")


def _finite(value: object) -> bool:
    if isinstance(value, float):
        return math.isfinite(value)
    if isinstance(value, (list, tuple, set, frozenset)):
        return all(map(_finite, value))
    if isinstance(value, dict):
        return all(map(_finite, value.values()))
    if isinstance(value, msgspec.Struct):
        return all(_finite(getattr(value, name)) for name in value.__struct_fields__)
    return True


def _made(factory: Any) -> object:
    return factory()
