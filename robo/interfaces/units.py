"""In which unit a number of a message is, as the type's documentation says: `pose.pose.position.x` is in m. Pure."""

import re
import types
import typing
from functools import cache
from typing import Annotated, Any, Union, get_args, get_origin

import msgspec

from robo.text.docstrings import attribute_docs
from robo_messages import Duration, Message, Quaternion, Time

_UNITS = (
    "m/s²", "m²/s⁴", "m²/s²", "m/s", "rad²/s²", "rad/s²", "rad/s", "rad²", "rad", "m²", "m³", "m", "ms", "ns", "s", "V",
    "A", "Ah", "W", "°C", "K", "N·m", "N", "Hz", "Pa", "lx", "T", "kg", "°", "B", "%",
)  # fmt: skip
_ONE = "|".join(map(re.escape, sorted(_UNITS, key=len, reverse=True)))
_SAID = re.compile(rf"(?:^|[,;] )({_ONE})(?=[.,;]|$| per | above | \()")
_SEVERAL = re.compile(rf"(?:^|[,;] )(?:{_ONE})(?: and | or |, |; )(?:{_ONE})\b")
_STEP = re.compile(r"[^.\[\]]+")


def unit_of(type_: type[Message], path: str) -> str:
    """The unit of a field; empty where it has none, or none is said.

    Args:
        type_: the message's.
        path: `linear.x`, `ranges[0]`.
    """
    found = ""
    kind: Any = type_
    for step in _STEP.findall(path):
        if step.lstrip("-").isdigit():
            continue
        fields = _fields(kind) if isinstance(kind, type) and issubclass(kind, msgspec.Struct) else {}
        if step not in fields:
            return found
        kind, said = fields[step]
        found = found if said is None else said
        if kind is Quaternion or (step == "covariance" and not said):
            found = ""
        if kind in (Time, Duration):
            return "s"
    return found


@cache
def _fields(struct: type[msgspec.Struct]) -> dict[str, tuple[object, str | None]]:
    """The type of each field's values, and the unit that is said of it: empty where there are several."""
    docs = attribute_docs(struct)
    try:
        hints = typing.get_type_hints(struct)
    except (NameError, TypeError):
        return {}
    return {name: (_inner(hints[name]), _unit(docs.get(name, ""))) for name in struct.__struct_fields__}


def _unit(text: str) -> str | None:
    said = {*_SAID.findall(text)}
    if _SEVERAL.search(text) or len(said) > 1:
        return ""
    return said.pop() if said else None


def _inner(hint: Any) -> object:
    """The type of a value, or of what a list holds."""
    origin, inside = get_origin(hint), get_args(hint)
    if origin in (Annotated, list, tuple):
        return _inner(inside[0])
    if origin in (Union, types.UnionType):
        return _inner(next(one for one in inside if one is not type(None)))
    return hint
