"""What an annotation says of a parameter."""

import enum
import math
import typing
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import msgspec

if TYPE_CHECKING:
    from robo_messages import Message


class Unit(str):
    """A parameter's unit, shown wherever it is described: `Annotated[float, Unit("m/s")]`."""

    __slots__ = ()


class Step(float):
    """The step between a parameter's values, from 0 or from its lower limit: `Annotated[float, Step(0.1)]`."""

    __slots__ = ()


class Subscribes:
    """Marks a text that names a topic which the node subscribes, so that `robo check` knows who listens.

        topic: Annotated[str, Subscribes(Twist), READ_ONLY]

    The node itself subscribes it, by `create_subscription` in `on_start`.
    """

    __slots__ = ("_message_type",)

    def __init__(self, message_type: "type[Message] | None" = None) -> None:
        """`message_type`: what the topic carries; None where another parameter says that."""
        self._message_type = message_type

    @property
    def type(self) -> str:
        """The name of the type, empty where it is not known."""
        if self._message_type is None:
            return ""
        from robo_messages import type_name  # parameters are read where no message type is

        return type_name(self._message_type)


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
    subscribes: str | None = None
    """Where it names a topic that the node subscribes: the type of its messages, empty where that is not known."""

    @property
    def about(self) -> str:
        """Description, unit and range in a line: `forward velocity, m/s; -5 to 5`."""
        what = ", ".join(part for part in (self.description, self.unit) if part)
        return "; ".join(part for part in (what, range_text(self.constraints)) if part)


def info_of(name: str, hint: Any, default: object) -> ParameterInfo:
    """What the annotation of a parameter says of it."""
    return ParameterInfo(
        name,
        type_name(hint),
        default,
        next((meta.description for meta in _metas(hint) if meta.description), ""),
        next((str(extra) for extra in extras_of(hint) if isinstance(extra, Unit)), ""),
        {key: value for meta in _metas(hint) for key in _CONSTRAINTS if (value := getattr(meta, key)) is not None}
        | ({} if (step := step_of(hint)) is None else {"step": step}),
        READ_ONLY in extras_of(hint),
        next((extra.type for extra in extras_of(hint) if isinstance(extra, Subscribes)), None),
    )


def extras_of(hint: Any) -> tuple[Any, ...]:
    """What stands behind the type in `Annotated`."""
    return getattr(hint, "__metadata__", ())


def plain_type(hint: Any) -> Any:
    """The type without what is annotated."""
    return typing.get_args(hint)[0] if hasattr(hint, "__metadata__") else hint


def type_name(hint: Any) -> str:
    """As people write it; of an enum and a Literal the values."""
    plain = plain_type(hint)
    if choices := choices_of(hint):
        return " or ".join(map(str, choices))
    return getattr(plain, "__name__", None) or str(plain) if not typing.get_args(plain) else str(plain)


def choices_of(hint: Any) -> list[object]:
    """The values of an enum or a Literal."""
    plain = plain_type(hint)
    if typing.get_origin(plain) is typing.Literal:
        return list(typing.get_args(plain))
    if isinstance(plain, type) and issubclass(plain, enum.Enum):
        return [member.value for member in plain]
    return []


def about_hint(hint: Any) -> str:
    """What a refused value should have been, in brackets: `(forward velocity, m/s; -5 to 5)`."""
    text = info_of("", hint, None).about
    return f" ({text})" if text else ""


def range_text(limits: Mapping[str, object]) -> str:
    """The range that constraints leave: `-5 to 5`, `> 0 and <= 1000`."""
    if "ge" in limits and "le" in limits:
        return f"{limits['ge']} to {limits['le']}"
    signs = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}
    return " and ".join(f"{sign} {limits[key]}" for key, sign in signs.items() if key in limits)


def step_of(hint: Any) -> float | None:
    """The step between values, if one is said."""
    return next((float(extra) for extra in extras_of(hint) if isinstance(extra, Step)), None)


def is_on_step(value: float, step: float, hint: Any) -> bool:
    """Whether a value is whole steps away from where they begin, as near as floats can tell."""
    begin = next((meta.ge for meta in _metas(hint) if meta.ge is not None), 0.0)
    steps = (value - begin) / step
    return math.isfinite(steps) and abs(steps - round(steps)) <= 1e-6 * max(1.0, abs(steps))


def _metas(hint: Any) -> list[msgspec.Meta]:
    return [extra for extra in extras_of(hint) if isinstance(extra, msgspec.Meta)]
