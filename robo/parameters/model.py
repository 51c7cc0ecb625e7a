"""A node's parameters: one frozen msgspec Struct, typed, documented and constrained.

    class Parameters(robo.Parameters):
        speed: Annotated[float, Meta(ge=0, le=2, description="how fast"), Unit("m/s")] = 0.5
        frame: Annotated[str, READ_ONLY] = "base_link"

Fields may be bool, int, float, str, lists, enums, Literals, Structs of these, and maps of such Structs whose names the
user chooses. A value within a Struct has a name with dots, `gains.p` or `zones.front.radius`. Pure: from values to a
Struct or to one error that names every mistake.
"""

import math
from collections.abc import Collection, Iterable, Mapping
from typing import Annotated, Any, TypeVar

import msgspec

from robo.errors import ParameterError
from robo.parameters import shape
from robo.parameters.hints import (
    NON_FINITE,
    READ_ONLY,
    ParameterInfo,
    Subscribes,
    about_hint,
    choices_of,
    extras_of,
    info_of,
    is_on_step,
    step_of,
    type_name,
)
from robo.parameters.shape import Contradiction, Leaf, declared_as
from robo.text.brief import brief, shown
from robo.text.paths import unnested
from robo.text.readable import readable
from robo.text.suggestions import suggest
from robo.wire import names


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


def mistakes(cls: type[Parameters], values: Mapping[str, object], owner: str) -> dict[str, str]:
    """Why values would be refused, each by the name of one of those that it is about; see `build`."""
    current = cls()
    converted, found = _converted(current, values, owner, read_only=False)
    if not found:
        try:
            shape.assembled(current, converted)
        except Contradiction as error:
            found[_last(converted, error.outer)] = f"{owner}: {error}"
    return found


def flat(parameters: Parameters) -> dict[str, object]:
    """Every value by its name, as plain data."""
    return {leaf.name: msgspec.to_builtins(leaf.value) for leaf in shape.leaves(parameters)}


def describe(cls: type[Parameters]) -> list[ParameterInfo]:
    """Every parameter of a class, in the order of its declaration; those of a map as its entries may have them.

    Raises:
        ContractError: a parameter has no default.
    """
    shape.refuse_missing_defaults(cls)
    return [_info(leaf, leaf.name) for leaf in shape.declared(cls).values()]


def describe_running(parameters: Parameters) -> list[ParameterInfo]:
    """Every parameter that a node has, those of its maps' entries by their names."""
    declared = shape.declared(type(parameters))
    return [_info(declared[_declared_as(leaf.name, declared)], leaf.name) for leaf in shape.leaves(parameters)]


def default_of(cls: type[Parameters], name: str) -> object:
    """The declared default of a parameter, as plain data; None for what has to be said."""
    declared = shape.declared(cls)
    return msgspec.to_builtins(declared[_declared_as(name, declared)].value)


def _declared_as(name: str, declared: Mapping[str, Leaf]) -> str:
    found = declared_as(name, declared)
    assert found is not None, f"{name} is a parameter of a Struct that does not declare it"
    return found


def _info(leaf: Leaf, name: str) -> ParameterInfo:
    return info_of(name, leaf.hint, msgspec.to_builtins(leaf.value))


def _changed(current: P, changes: Mapping[str, object], owner: str, *, read_only: bool) -> P:
    converted, found = _converted(current, changes, owner, read_only=read_only)
    if found:
        raise ParameterError("\n".join(found.values()))
    try:
        return shape.assembled(current, converted)
    except Contradiction as error:
        raise ParameterError(f"{owner}: {error}") from None


def _converted(
    current: Parameters, changes: Mapping[str, object], owner: str, *, read_only: bool
) -> tuple[dict[str, object], dict[str, str]]:
    """Values of single parameters in their types, and what is wrong with others; both by name."""
    declared = shape.declared(type(current))
    now = {leaf.name: leaf.value for leaf in shape.leaves(current)} if read_only else {}
    mistakes: dict[str, str] = {}
    converted: dict[str, object] = {}
    said: list[str] = []
    for name, value in unnested(changes, ".", lambda name, _values: shape.is_group(name, declared)):
        if len(mistakes) == MOST_MISTAKES:
            mistakes[name] = f"{owner}: these are {MOST_MISTAKES} mistakes; the rest is not looked at"
            return converted, mistakes
        known = declared_as(name, declared)
        if known is None or (read_only and name not in now):
            mistakes[name] = _unknown(name, now or declared, owner, known)
            continue
        said.append(name)
        hint = declared[known].hint
        new, mistake = _taken(value, hint)
        if mistake:
            mistakes[name] = f"{owner}: {name} = {shown(value)}: {mistake}{about_hint(hint)}"
        elif read_only and READ_ONLY in extras_of(hint) and new != now[name]:
            mistakes[name] = f"{owner}: {name} is read-only; start the node with another value"
        else:
            converted[name] = new
    for entry, fields in shape.lacking(current, said).items():
        name = _last(said, f"{entry}.")
        before = f"{mistakes[name]}; " if name in mistakes else f"{owner}: "
        mistakes[name] = f"{before}{entry} has no {' and no '.join(fields)}"
    return converted, mistakes


def _unknown(name: str, known: Collection[str], owner: str, declared: str | None) -> str:
    late = "" if declared is None else " now, and one can only be added when it starts"
    return f"{owner} has no parameter {shown(name)}{late}; {suggest(name, known, 'it has')}"


def _taken(value: object, hint: Any) -> tuple[object, str]:
    """A value in its type, and what is wrong with it: an empty text where nothing is."""
    if NON_FINITE in extras_of(hint):
        value = _from_json(value)
    try:
        new: object = msgspec.convert(value, readable(hint))
    except (msgspec.ValidationError, OverflowError, RecursionError, TypeError, ValueError) as error:
        choice = f"; use {type_name(hint)}" if choices_of(hint) else ""
        return None, f"{brief(_readable(str(error)), 200)}{choice}"
    if (step := step_of(hint)) is not None and isinstance(new, (int, float)) and not is_on_step(new, step, hint):
        return None, f"expected a multiple of {step:g}"
    if not _finite(new) and NON_FINITE not in extras_of(hint):
        return None, "expected a finite number"
    if any(isinstance(extra, Subscribes) for extra in extras_of(hint)) and not names.is_name(str(new)):
        return None, f"expected a topic's name: {names.RULE}, parts joined by /"
    return new, ""


def _last(names: Iterable[str], within: str) -> str:
    """The last of the names that begin so."""
    return [name for name in names if name.startswith(within)][-1]


def _from_json(value: object) -> object:
    """A number, or a list of them, with NaN and infinities as JSON has to write them: as text."""
    if isinstance(value, list):
        return [_from_json(item) for item in value]
    return float(value) if isinstance(value, str) and value in ("inf", "-inf", "nan") else value


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
