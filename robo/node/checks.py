"""What a node class says of its checks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import msgspec

from robo.errors import ContractError
from robo.node.callables import check_plain
from robo.node.declare import MARK, CheckMark
from robo.node.part import Part
from robo.wire.reports import EVERY_NODES


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
