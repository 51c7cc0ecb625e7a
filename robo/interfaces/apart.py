"""What there is to say of message types; those that users wrote are imported in a process of their own.

A module that cannot be imported, ends its process or does not come to its end is named, and hides no other.
"""

import os
import sys
from collections.abc import Sequence
from types import ModuleType
from typing import NamedTuple

import msgspec

import robo_messages
from robo.errors import ContractError
from robo.interfaces import catalogue
from robo.interfaces.catalogue import Interface, Listed
from robo.interfaces.ros_names import full_name, made_by_name, made_of
from robo.interfaces.ros_text import whole_text
from robo.packages.imports import PATIENCE, import_apart, report
from robo_messages import Message


class Types(NamedTuple):
    """All types."""

    listed: dict[str, Listed]
    """By name, parts of services and actions by theirs."""
    broken: list[str]
    """A sentence for each module that cannot be imported."""


class Sheet(msgspec.Struct, frozen=True):
    """A message type, and those of its fields."""

    interface: Interface
    schema: dict[str, object]
    """Its JSON Schema."""
    inner: dict[str, "Sheet"]
    """By field, of those that are messages or lists of messages."""


class Described(msgspec.Struct, frozen=True):
    """All that is shown of a message type or a service."""

    sheets: list[Sheet]
    """One, or those of a service's request and response."""
    ros: "InRos | None"
    """As ROS has it."""
    not_in_ros: str
    """Why it cannot, where there is nothing."""
    made_of: str = ""
    """The service or action of which ROS makes the type: the sheets are that one's, and of its own is only the hash."""


class InRos(msgspec.Struct, frozen=True):
    """What ROS makes of a type."""

    text: str
    """Its definition, and those of all messages in it."""
    type_hash: str
    parts: list[tuple[str, str]]
    """The name in ROS and the hash of each sheet's type."""


class _Seen(msgspec.Struct):
    """What the other process says when it has imported a module."""

    types: dict[str, Listed]
    """Those of users that are known by then."""
    described: Described | None
    """What was asked for, once it is known."""


def types(patience: float = PATIENCE) -> Types:
    """All types: those that ship, those of packages, and those that files below the current folder say.

    Args:
        patience: how long the import of one module may take, s.
    """
    found = {name: catalogue.listing(name) for name in robo_messages.type_names()}
    places = catalogue.places()
    broken = list(places.failed.values())
    for one in import_apart([__name__, ""], list(places.others), _Seen, patience):
        if one.found is None:
            broken.append(f"{places.others[one.module]} cannot be imported: {one.error}")
        else:
            found = {**one.found.types, **found}
    for name in catalogue.said_in(os.getcwd()):
        if name not in found:
            found[name] = catalogue.listing(name)
    return Types(found, broken)


def described(name: str, patience: float = PATIENCE) -> Described:
    """A message type, a service or an action.

    Args:
        name: as `group/Type`.
        patience: how long the import of one module may take, s.

    Raises:
        UnknownType: there is none; names what comes close.
        ContractError: the file or the module that should say it cannot be imported.
    """
    here = _described(name)
    if here is not None:
        return here
    made = made_by_name(name)
    wanted = [*catalogue.first_parts(name), *(catalogue.first_parts(made[0]) if made is not None else ())]
    places = catalogue.places(*wanted)
    phrases = {**places.own, **places.others}
    there = set(robo_messages.type_names())
    faults: dict[str, str] = {}
    for one in import_apart([__name__, name], list(phrases), _Seen, patience):
        if one.found is None:
            faults[one.module] = f"{phrases[one.module]} cannot be imported: {one.error}"
        elif one.found.described is not None:
            return one.found.described
        else:
            there.update(one.found.types)
    there.update(catalogue.said_in(os.getcwd()))
    own = [fault for module, fault in faults.items() if module in places.own]
    wholes = (catalogue.whole_of(one)[0] for one in sorted(there))
    raise catalogue.missing(name, wholes, own, [*places.failed.values(), *faults.values()])


def _described(name: str) -> Described | None:
    """A type that is known in this process."""
    made = made_of(name)
    whole = name if made is None else made[0]
    if not any(map(catalogue.is_there, catalogue.first_parts(whole))):
        return None
    parts = catalogue.parts(whole)
    sheets = [_sheet(robo_messages.find_type(part)) for part in parts]
    try:
        return Described(sheets, _in_ros(name, whole, parts), "", whole if made is not None else "")
    except ContractError as error:
        return Described(sheets, None, str(error))


def _in_ros(name: str, whole: str, parts: Sequence[str]) -> InRos:
    from robo.interfaces.type_hash import type_hash  # it takes 4 MB, and completion does without

    return InRos(whole_text(whole), type_hash(name), [(full_name(part), type_hash(part)) for part in parts])


def _sheet(type_: type[Message], *within: type[Message]) -> Sheet:
    """A type, and those in it; of one that holds itself, no more than the first."""
    around = (*within, type_)
    inner = catalogue.inner_types(type_).items()
    below = {field: _sheet(kind, *around) for field, kind in inner if kind not in around}
    return Sheet(catalogue.describe(type_), robo_messages.json_schema(type_), below)


def _seen(module: ModuleType, name: str, shipped: Sequence[str]) -> _Seen:
    del module  # it has registered its types
    new = {one: catalogue.listing(one) for one in robo_messages.type_names() if one not in shipped}
    return _Seen({one: entry for one, entry in new.items() if entry.source in sys.modules}, _described(name))


if __name__ == "__main__":
    _SHIPPED = robo_messages.type_names()
    report(sys.argv[2:], lambda module: _seen(module, sys.argv[1], _SHIPPED))
