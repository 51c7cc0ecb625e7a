"""Message types as code of a package refers to them: where they are imported from, and how one is made."""

import sys
from collections.abc import Collection
from typing import Literal

import msgspec

import robo_messages
from robo.errors import ContractError, UsageError
from robo.interfaces import catalogue
from robo.text.brief import shown
from robo.text.suggestions import closest
from robo_messages import Message, UnknownType

Kind = Literal["str", "int", "float", "bool"]

_KINDS: dict[type, Kind] = {str: "str", int: "int", float: "float", bool: "bool"}


class TypeUse(msgspec.Struct, frozen=True):
    """A message type."""

    name: str
    """`std/String`."""
    module: str
    """What it is imported from."""
    path: str
    """Within the module: `String`, `Trigger.Request`."""
    data: Kind | None = None
    """What its field `data` holds, where it has one of these."""

    @property
    def imported(self) -> str:
        """What is imported of its module: the class that it stands in, or itself."""
        return self.path.partition(".")[0]


class ServiceUse(msgspec.Struct, frozen=True):
    """A service type."""

    name: str
    request: TypeUse
    response: TypeUse


def own_type(package: str, name: str) -> TypeUse:
    """A message type of the package that is just being made."""
    return TypeUse(f"{package}/{name}", f"{package}.messages", name, "float")


def message_type(name: str, package: str, new: Collection[str]) -> TypeUse:
    """The type of a topic.

    Args:
        name: as `group/Type`.
        package: whose types may not be there yet.
        new: the names of those that are just being made.

    Raises:
        UsageError: there is none, or code cannot use it; says what to do.
    """
    group, _, last = name.partition("/")
    if group == package and last in new:
        return own_type(package, last)
    try:
        return _use(catalogue.find(name))
    except UnknownType as error:
        if name in new:
            raise UsageError(f"there is no type {shown(name)}; did you mean {package}/{name}?") from None
        if group == package:
            raise UsageError(f"there is no type {shown(name)}; --message {last} makes one") from None
        if f"{name}_Request" in catalogue.known():
            raise UsageError(f"{name} is the type of a service; topics have types such as std/String") from None
        raise UsageError(str(error).partition("\n")[0]) from None
    except ContractError as error:
        raise UsageError(str(error)) from None


def service_type(name: str) -> ServiceUse:
    """The type of a service.

    Raises:
        UsageError: there is none, or code cannot use it; says what to do.
    """
    asked, answered = robo_messages.halves_of(name)
    try:
        return ServiceUse(name, _use(catalogue.find(asked)), _use(catalogue.find(answered)))
    except UnknownType:
        services = [one.removesuffix("_Request") for one in catalogue.known() if one.endswith("_Request")]
        if name in catalogue.known():
            raise UsageError(f"{name} is a message; services have types such as std/Trigger") from None
        close = closest(name, [*services, "std/Empty"])
        instead = f"did you mean {close}?" if close is not None else "robo interface list shows what there is"
        raise UsageError(f"there is no service type {shown(name)}; {instead}") from None
    except ContractError as error:
        raise UsageError(str(error)) from None


def _use(type_: type[Message]) -> TypeUse:
    name = robo_messages.type_name(type_)
    fields = msgspec.structs.fields(type_)
    required = [field.name for field in fields if field.required]
    if required:
        raise UsageError(f"{name} has fields without a default, {', '.join(required)}: give each one")
    path = type_.__qualname__
    first = path.partition(".")[0]
    shipped = getattr(robo_messages, first, None) is getattr(sys.modules[type_.__module__], first, None)
    data = next((_KINDS.get(_plain(field.type)) for field in fields if field.name == "data"), None)
    return TypeUse(name, robo_messages.__name__ if shipped else type_.__module__, path, data)


def _plain(annotation: object) -> type:
    """The class of an annotation, without what else it says."""
    inner = getattr(annotation, "__origin__", annotation)
    return inner if isinstance(inner, type) else object
