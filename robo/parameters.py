"""A node's parameters: one frozen msgspec Struct, typed, documented and constrained.

    class Parameters(robo.Parameters):
        speed: Annotated[float, Meta(ge=0, le=2, description="how fast"), Unit("m/s")] = 0.5
        frame: Annotated[str, READ_ONLY] = "base_link"

Fields may be bool, int, float, str, lists, enums, Literals and Structs of these. A value within a Struct
has a name with dots, `gains.p`. Pure: from values to a Struct or to one error that names every mistake.
"""

import enum
import math
import typing
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, TypeVar

import msgspec

from robo.errors import ContractError, ParameterError
from robo.text.brief import brief, shown
from robo.text.suggestions import suggest


class Unit(str):
    """A parameter's unit, shown wherever it is described: `Annotated[float, Unit("m/s")]`."""

    __slots__ = ()


class Step(float):
    """The step between a parameter's values, from 0 or from its lower limit: `Annotated[float, Step(0.1)]`."""

    __slots__ = ()


class _Mark:
    """Says something of a parameter: `Annotated[str, READ_ONLY]`."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __repr__(self) -> str:
        return self._name


READ_ONLY = _Mark("READ_ONLY")
"""Marks a parameter that is set when the node starts and never again: `Annotated[str, READ_ONLY]`."""

NON_FINITE = _Mark("NON_FINITE")
"""Marks a parameter that may be NaN or infinite."""


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

_CONSTRAINTS = ("gt", "ge", "lt", "le", "multiple_of", "pattern", "min_length", "max_length")


class ParameterInfo(msgspec.Struct, frozen=True):
    """What is known of one parameter without running its node."""

    name: str
    type: str
    default: object
    description: str
    unit: str
    constraints: dict[str, float | int | str]
    read_only: bool

    @property
    def about(self) -> str:
        """Description, unit and range in a line: `forward velocity, m/s; -5 to 5`."""
        what = ", ".join(part for part in (self.description, self.unit) if part)
        return "; ".join(part for part in (what, range_text(self.constraints)) if part)


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
    return [_info(name, hint, msgspec.to_builtins(_get(defaults, name))) for name, hint in _leaves(cls).items()]


def _info(name: str, hint: Any, default: object) -> ParameterInfo:
    return ParameterInfo(
        name,
        _type_name(hint),
        default,
        next((meta.description for meta in _metas(hint) if meta.description), ""),
        next((str(extra) for extra in _extras(hint) if isinstance(extra, Unit)), ""),
        {key: value for meta in _metas(hint) for key in _CONSTRAINTS if (value := getattr(meta, key)) is not None}
        | ({} if (step := _step(hint)) is None else {"step": step}),
        READ_ONLY in _extras(hint),
    )


def _changed(current: P, changes: Mapping[str, object], owner: str, *, read_only: bool) -> P:
    leaves = _leaves(type(current))
    mistakes: list[str] = []
    converted: dict[str, object] = {}
    for name, value in _flattened(changes, leaves):
        if len(mistakes) == MOST_MISTAKES:
            mistakes.append(f"{owner}: these are {MOST_MISTAKES} mistakes; the rest is not looked at")
            break
        hint = leaves.get(name)
        if name not in leaves:
            mistakes.append(f"{owner} has no parameter {shown(name)}; {suggest(name, leaves, 'it has')}")
            continue
        if NON_FINITE in _extras(hint):
            value = _from_json(value)
        try:
            new: object = msgspec.convert(value, hint)
        except (msgspec.ValidationError, OverflowError, RecursionError, TypeError, ValueError) as error:
            choice = f"; use {_type_name(hint)}" if _choices(hint) else ""
            mistakes.append(
                f"{owner}: {name} = {shown(value)}: {brief(_readable(str(error)), 200)}{choice}{_about(hint)}"
            )
            continue
        if (step := _step(hint)) is not None and isinstance(new, (int, float)) and not _on_step(new, step, hint):
            mistakes.append(f"{owner}: {name} = {shown(value)}: expected a multiple of {step:g}{_about(hint)}")
        elif not _finite(new) and NON_FINITE not in _extras(hint):
            mistakes.append(f"{owner}: {name} = {shown(value)}: expected a finite number{_about(hint)}")
        elif read_only and READ_ONLY in _extras(hint) and new != _get(current, name):
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


def _flattened(
    changes: Mapping[str, object], leaves: Mapping[str, Any], prefix: str = ""
) -> Iterator[tuple[str, object]]:
    """Values by the names of single parameters: a map for a nested Struct is taken apart."""
    for key, value in changes.items():
        name = f"{prefix}{key}"
        if name not in leaves and isinstance(value, Mapping) and any(leaf.startswith(f"{name}.") for leaf in leaves):
            yield from _flattened(value, leaves, f"{name}.")
        else:
            yield name, value


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


def _types(cls: type[Any]) -> dict[str, Any]:
    return {
        name: hint
        for name, hint in typing.get_type_hints(cls, include_extras=True).items()
        if name in cls.__struct_fields__
    }


_leaves_of: dict[type[Any], dict[str, Any]] = {}


def _leaves(cls: type[Any]) -> dict[str, Any]:
    """The type of every single parameter; those of a nested Struct have names with dots."""
    found = _leaves_of.get(cls)
    if found is None:
        found = _leaves_of[cls] = {}
        for name, hint in _types(cls).items():
            plain = _plain(hint)
            if isinstance(plain, type) and issubclass(plain, msgspec.Struct):
                _refuse_missing_defaults(plain)
                found |= {f"{name}.{inner}": inner_hint for inner, inner_hint in _leaves(plain).items()}
            else:
                found[name] = hint
        if "use_sim_time" in found:  # every node's; its own come first
            found["use_sim_time"] = found.pop("use_sim_time")
    return found


def _extras(hint: Any) -> tuple[Any, ...]:
    return getattr(hint, "__metadata__", ())


def _metas(hint: Any) -> list[msgspec.Meta]:
    return [extra for extra in _extras(hint) if isinstance(extra, msgspec.Meta)]


def _plain(hint: Any) -> Any:
    return typing.get_args(hint)[0] if hasattr(hint, "__metadata__") else hint


def _type_name(hint: Any) -> str:
    plain = _plain(hint)
    if choices := _choices(hint):
        return " or ".join(map(str, choices))
    return getattr(plain, "__name__", None) or str(plain) if not typing.get_args(plain) else str(plain)


def _choices(hint: Any) -> list[object]:
    """The values of an enum or a Literal."""
    plain = _plain(hint)
    if typing.get_origin(plain) is typing.Literal:
        return list(typing.get_args(plain))
    if isinstance(plain, type) and issubclass(plain, enum.Enum):
        return [member.value for member in plain]
    return []


def _about(hint: Any) -> str:
    """What a refused value should have been, in brackets: `(forward velocity, m/s; -5 to 5)`."""
    text = _info("", hint, None).about
    return f" ({text})" if text else ""


def range_text(limits: Mapping[str, object]) -> str:
    """The range that constraints leave: `-5 to 5`, `> 0 and <= 1000`."""
    if "ge" in limits and "le" in limits:
        return f"{limits['ge']} to {limits['le']}"
    signs = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}
    return " and ".join(f"{sign} {limits[key]}" for key, sign in signs.items() if key in limits)


def _step(hint: Any) -> float | None:
    return next((float(extra) for extra in _extras(hint) if isinstance(extra, Step)), None)


def _on_step(value: float, step: float, hint: Any) -> bool:
    """Whether a value is whole steps away from where they begin, as near as floats can tell."""
    begin = next((meta.ge for meta in _metas(hint) if meta.ge is not None), 0.0)
    steps = (value - begin) / step
    return math.isfinite(steps) and abs(steps - round(steps)) <= 1e-6 * max(1.0, abs(steps))


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
