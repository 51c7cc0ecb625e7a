"""A node's parameters: one frozen msgspec Struct, typed, documented and constrained.

    class Parameters(robo.Parameters):
        speed: Annotated[float, Meta(ge=0, le=2, description="how fast"), Unit("m/s")] = 0.5
        frame: Annotated[str, READ_ONLY] = "base_link"

Fields may be bool, int, float, str, lists, enums, Literals and Structs of these. A value within a Struct
has a name with dots, `gains.p`. Pure: from values to a Struct or to one error that names every mistake.
"""

import math
import typing
from collections.abc import Collection, Mapping
from functools import partial
from typing import Annotated, Any, TypeVar

import msgspec

from robo.errors import ContractError, ParameterError
from robo.parameters.hints import (
    NON_FINITE,
    READ_ONLY,
    ParameterInfo,
    about_hint,
    choices_of,
    extras_of,
    info_of,
    is_on_step,
    plain_type,
    step_of,
    type_name,
)
from robo.text.brief import brief, shown
from robo.text.paths import unnested
from robo.text.suggestions import suggest


class Parameters(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """Base of every node's parameters. Each field needs a default.

    Values cannot be assigned one by one: that would pass by their checks.
    """

    use_sim_time: Annotated[bool, msgspec.Meta(description="follow the topic /clock"), READ_ONLY] = False

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"parameter {name} cannot be assigned; use set_parameters({name}=…) of the node")


P = TypeVar("P", bound=Parameters)

MOST_MISTAKES = 20
"""So many are told at once."""


def build(cls: type[P], values: Mapping[str, object], owner: str) -> P:
    """The parameters of a node, from values over the declared defaults.

    An int is accepted where a float is declared; NaN and infinities are refused unless NON_FINITE.

    Args:
        cls: the node's Parameters.
        values: by name; those of a nested Struct as a map or by names with dots.
        owner: the node, for the message.

    Raises:
        ParameterError: a name is unknown or a value does not fit; names all of them.
    """
    return _changed(cls(), values, owner, read_only=False)


def change(current: P, changes: Mapping[str, object], owner: str) -> P:
    """The parameters of a running node with some changed; all are or none.

    Raises:
        ParameterError: a name is unknown, a value does not fit or is read-only; names all of them.
    """
    return _changed(current, changes, owner, read_only=True)


def flat(parameters: Parameters) -> dict[str, object]:
    """Every value by its name, as plain data."""
    return {name: msgspec.to_builtins(_get(parameters, name)) for name in _leaves(type(parameters))}


def describe(cls: type[Parameters]) -> list[ParameterInfo]:
    """Every parameter of a class, in the order of its declaration.

    Raises:
        ContractError: a parameter has no default.
    """
    _refuse_missing_defaults(cls)
    defaults = cls()
    return [info_of(name, hint, msgspec.to_builtins(_get(defaults, name))) for name, hint in _leaves(cls).items()]


def types_of(cls: type[Any]) -> dict[str, Any]:
    """The types of all fields, with what they are annotated."""
    return {
        name: hint
        for name, hint in typing.get_type_hints(cls, include_extras=True).items()
        if name in cls.__struct_fields__
    }


def _changed(current: P, changes: Mapping[str, object], owner: str, *, read_only: bool) -> P:
    leaves = _leaves(type(current))
    mistakes: list[str] = []
    converted: dict[str, object] = {}
    for name, value in unnested(changes, ".", partial(_is_struct, leaves)):
        if len(mistakes) == MOST_MISTAKES:
            mistakes.append(f"{owner}: these are {MOST_MISTAKES} mistakes; the rest is not looked at")
            break
        hint = leaves.get(name)
        if name not in leaves:
            mistakes.append(f"{owner} has no parameter {shown(name)}; {suggest(name, leaves, 'it has')}")
            continue
        if NON_FINITE in extras_of(hint):
            value = _from_json(value)
        try:
            new: object = msgspec.convert(value, hint)
        except (msgspec.ValidationError, OverflowError, RecursionError, TypeError, ValueError) as error:
            choice = f"; use {type_name(hint)}" if choices_of(hint) else ""
            mistakes.append(
                f"{owner}: {name} = {shown(value)}: {brief(_readable(str(error)), 200)}{choice}{about_hint(hint)}"
            )
            continue
        if (step := step_of(hint)) is not None and isinstance(new, (int, float)) and not is_on_step(new, step, hint):
            mistakes.append(f"{owner}: {name} = {shown(value)}: expected a multiple of {step:g}{about_hint(hint)}")
        elif not _finite(new) and NON_FINITE not in extras_of(hint):
            mistakes.append(f"{owner}: {name} = {shown(value)}: expected a finite number{about_hint(hint)}")
        elif read_only and READ_ONLY in extras_of(hint) and new != _get(current, name):
            mistakes.append(f"{owner}: {name} is read-only; start the node with another value")
        else:
            converted[name] = new
    if mistakes:
        raise ParameterError("\n".join(mistakes))
    try:
        whole: P = _assembled(current, converted, "")
    except (ValueError, TypeError) as error:  # raised by a __post_init__
        raise ParameterError(f"{owner}: {error}") from None
    return whole


def _from_json(value: object) -> object:
    """A number, or a list of them, with NaN and infinities as JSON has to write them: as text."""
    if isinstance(value, list):
        return [_from_json(item) for item in value]
    return float(value) if isinstance(value, str) and value in ("inf", "-inf", "nan") else value


def _is_struct(leaves: Collection[str], name: str, _values: Mapping[str, object]) -> bool:
    """Whether a map stands for a nested Struct, by the names of all single parameters."""
    return name not in leaves and any(leaf.startswith(f"{name}.") for leaf in leaves)


def _assembled(current: Any, values: Mapping[str, object], prefix: str) -> Any:
    """A Struct like another one, with some values changed."""
    fields: dict[str, object] = {}
    for name in current.__struct_fields__:
        old = getattr(current, name)
        full = f"{prefix}{name}"
        if full in values:
            fields[name] = values[full]
        elif any(key.startswith(f"{full}.") for key in values):
            fields[name] = _assembled(old, values, f"{full}.")
        else:
            fields[name] = old
    return type(current)(**fields)


def _get(parameters: Any, name: str) -> Any:
    for part in name.split("."):
        parameters = getattr(parameters, part)
    return parameters


def _refuse_missing_defaults(cls: type[Any]) -> None:
    for field in msgspec.structs.fields(cls):
        if field.required:
            raise ContractError(f"{cls.__qualname__}.{field.name} has no default; give it one")


_leaves_of: dict[type[Any], dict[str, Any]] = {}


def _leaves(cls: type[Any]) -> dict[str, Any]:
    """The type of every single parameter; those of a nested Struct have names with dots."""
    found = _leaves_of.get(cls)
    if found is None:
        found = _leaves_of[cls] = {}
        for name, hint in types_of(cls).items():
            plain = plain_type(hint)
            if isinstance(plain, type) and issubclass(plain, msgspec.Struct):
                _refuse_missing_defaults(plain)
                found |= {f"{name}.{inner}": inner_hint for inner, inner_hint in _leaves(plain).items()}
            else:
                found[name] = hint
        if "use_sim_time" in found:  # every node's; its own come first
            found["use_sim_time"] = found.pop("use_sim_time")
    return found


def _readable(error: str) -> str:
    return error[:1].lower() + error[1:].replace("`", "")


def _finite(value: object) -> bool:
    if isinstance(value, float):
        return math.isfinite(value)
    if isinstance(value, (list, tuple, set, frozenset)):
        return all(map(_finite, value))
    if isinstance(value, dict):
        return all(map(_finite, value.values()))
    return True
