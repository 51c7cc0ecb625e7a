"""How well something does, as a check of a node says it; and what a node class says of its checks."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import msgspec

from robo.errors import ContractError
from robo.node.callables import check_plain
from robo.node.declare import MARK, CheckMark
from robo.node.part import Part
from robo.wire.reports import EVERY_NODES
from robo_messages.diagnostic import DiagnosticStatus, KeyValue


class Health(msgspec.Struct, frozen=True):
    """How well something does: what a `@check` returns. Made with `ok`, `warn` or `error`.

    return Health.warn(f"{volts:.1f} V: charge it", volts=volts, cells=6)
    """

    level: int = DiagnosticStatus.OK
    """As in `diagnostic/DiagnosticStatus`."""
    message: str = ""
    """How it does, in a sentence; where all is well it may be empty."""
    values: Mapping[str, object] = {}
    """Figures beside it, by name."""

    @classmethod
    def ok(cls, message: str = "", /, **values: object) -> Health:
        """All is well."""
        return cls(DiagnosticStatus.OK, message, values)

    @classmethod
    def warn(cls, message: str, /, **values: object) -> Health:
        """It works, and somebody should have a look."""
        return cls(DiagnosticStatus.WARN, message, values)

    @classmethod
    def error(cls, message: str, /, **values: object) -> Health:
        """It does not work."""
        return cls(DiagnosticStatus.ERROR, message, values)

    def status(self) -> DiagnosticStatus:
        """The same as a message, without a name.

        Raises:
            TypeError, ValueError: a field is not of its type, or the level is none.
        """
        # 1.0 and True are in it, and no reader takes them for a level.
        if type(self.level) is not int or self.level not in _LEVELS:
            raise ValueError(f"{self.level!r} is no level: use Health.ok, Health.warn or Health.error")
        values = [KeyValue(str(name), _figure(value)) for name, value in self.values.items()]
        return DiagnosticStatus(self.level, message=str(self.message), values=values)


_LEVELS = (DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR)


def _figure(value: object) -> str:
    """A value as text: numbers as people write them, others as they are."""
    return f"{value:.6g}" if isinstance(value, float) and math.isfinite(value) else str(value)


class CheckDeclaration(msgspec.Struct, frozen=True):
    """One `@check`."""

    name: str
    method: str
    """Its name; of a part of the node `part.method`."""


def checks_of(
    class_name: str, members: Mapping[str, Any], of_part: Callable[[Part], Sequence[CheckDeclaration]]
) -> tuple[CheckDeclaration, ...]:
    """The checks of a node class, those of its parts included.

    Args:
        class_name: for messages.
        members: of the class, by name.
        of_part: what a part declares.

    Raises:
        ContractError: a method is async, yields or takes more than self; two checks have one name.
    """
    found: list[CheckDeclaration] = []
    for name, member in members.items():
        mark = getattr(member, MARK, None)
        if isinstance(mark, CheckMark):
            _check_method(f"{class_name}.{name}", member)
            found.append(CheckDeclaration(mark.name, name))
        elif isinstance(member, Part):
            found += [CheckDeclaration(one.name, f"{name}.{one.method}") for one in of_part(member)]
    _check_names(class_name, found)
    return tuple(found)


def _check_method(where: str, method: Callable[..., Any]) -> None:
    check_plain(method, where)
    code = getattr(method, "__code__", None)
    if code is not None and code.co_argcount != 1:
        raise ContractError(f"{where}: a check's method takes self, nothing else, and returns a robo.Health")


def _check_names(class_name: str, checks: Sequence[CheckDeclaration]) -> None:
    """Refuse checks that nobody could tell apart."""
    seen = dict.fromkeys(EVERY_NODES, "one that every node has")
    for one in checks:
        if one.name in seen:
            raise ContractError(
                f"{class_name}.{one.method}: there is a check {one.name!r} already, {seen[one.name]}; name it otherwise"
            )
        seen[one.name] = one.method
