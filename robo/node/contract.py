"""What a node class promises, readable without running it.

`Publisher`, `@subscribe` and `@timer` only declare; `contract_of` collects the declarations. The
runtime, the check of a manifest and the tools all work from the collected `Contract`.
"""

from __future__ import annotations

import re
import typing
from collections.abc import Callable, Sequence
from functools import partial
from types import FunctionType, MethodType
from typing import Any

import msgspec

import robo_messages
from robo.errors import ContractError
from robo.node.declare import MARK, Client, Declares, Publisher, ServiceMark, SubscribeMark, TimerMark
from robo.node.message_info import MessageInfo
from robo.parameters import hints
from robo.parameters import model as parameters
from robo_messages import Message


class SubscriptionDeclaration(msgspec.Struct, frozen=True):
    """One `@subscribe`."""

    topic: str
    message_type: type[Message]
    depth: int
    method: str
    informed: bool = False
    """Whether the method takes a `MessageInfo` beside the message."""
    sole_source: str | None = None
    """The parameter that names whose messages alone count."""


class PublisherDeclaration(msgspec.Struct, frozen=True):
    """One `Publisher`."""

    topic: str
    message_type: type[Message]
    depth: int
    attribute: str


class ServiceDeclaration(msgspec.Struct, frozen=True):
    """One `@service`."""

    service: str
    request_type: type[Message]
    response_type: type[Message]
    method: str


class ClientDeclaration(msgspec.Struct, frozen=True):
    """One `Client`."""

    service: str
    request_type: type[Message]
    response_type: type[Message]
    timeout: float
    """s."""
    attribute: str


class TimerDeclaration(msgspec.Struct, frozen=True):
    """One `@timer`."""

    rate: float | str
    """The rate, Hz, or the name of the parameter that says it."""
    method: str


class Contract(msgspec.Struct, frozen=True):
    """All that a node class declares."""

    name: str
    """The node's default name: the class's in snake_case."""
    description: str
    publishers: tuple[PublisherDeclaration, ...]
    subscriptions: tuple[SubscriptionDeclaration, ...]
    timers: tuple[TimerDeclaration, ...]
    services: tuple[ServiceDeclaration, ...]
    clients: tuple[ClientDeclaration, ...]
    parameters: tuple[hints.ParameterInfo, ...]


def takes_info(callback: Callable[..., object]) -> bool:
    """Whether a callback of a subscription takes a `MessageInfo` beside the message."""
    function: Any = callback
    code = getattr(function, "__code__", None)
    while code is not None and code.co_flags & _TAKES_ALL and hasattr(function, "__wrapped__"):
        function = function.__wrapped__  # what a decorator hands all on to
        code = getattr(function, "__code__", None)
    if code is None:
        return False
    given = len(getattr(function, "__defaults__", None) or ()) + (getattr(callback, "__self__", None) is not None)
    return bool(code.co_argcount - given >= 2)


_GENERATOR, _ASYNC = 0x20, 0x80 | 0x200  # as in `inspect`, whose import would cost each node 0.5 MB


def check_plain(callback: Callable[..., object], name: str = "") -> None:
    """Refuse a callback whose call would do nothing: an `async def`, or one that yields.

    Args:
        callback: a function, a method, a partial or an object to call.
        name: what to call it; by default its own name.

    Raises:
        ContractError: it is such a one.
    """
    function: Any = callback
    while (inner := _inner(function)) is not None:
        function = inner
    code = getattr(function, "__code__", None)
    if code is None or not code.co_flags & (_GENERATOR | _ASYNC):
        return
    what = "is async" if code.co_flags & _ASYNC else "yields, so that calling it does nothing"
    raise ContractError(
        f"{place_of(function)}: {name or function.__name__} {what}; a callback is a plain function (def) that returns"
        " soon: what waits belongs into main() or a thread"
    )


def _inner(function: Any) -> Any:
    """What a partial, a method or an object calls; None for a function. A decorator may make an async one plain."""
    if isinstance(function, partial):
        return function.func
    if isinstance(function, MethodType):
        return function.__func__
    if isinstance(function, (FunctionType, type)) or not callable(function):
        return None
    call = type(function).__call__
    return call if isinstance(call, FunctionType) else None


def place_of(function: Any) -> str:
    """`file:line` of a Python function."""
    return f"{function.__code__.co_filename}:{function.__code__.co_firstlineno}"


def check_constructor(cls: type[Declares]) -> None:
    """Refuse a class that a process could not make a node of: its `__init__` does not take what names a node.

    Raises:
        ContractError: it is such a one.
    """
    for base in cls.__mro__:
        init = vars(base).get("__init__")
        code = getattr(init, "__code__", None)
        if code is None:
            continue
        if base.__module__ == "robo.node.node" or code.co_flags & _TAKES_KEYWORDS:
            return
        takes = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
        if not set(takes) >= _GIVEN_TO_A_NODE:
            raise ContractError(
                f"{place_of(init)}: {base.__name__}.__init__ does not take what a node is made with; write"
                " def __init__(self, **options) and super().__init__(**options), or do it in on_start(self)"
            )
        return


_TAKES_ALL, _TAKES_KEYWORDS = 0x04, 0x08  # as in `inspect`
_GIVEN_TO_A_NODE = {"name", "namespace", "parameters", "remappings", "sources"}


def snake_case(class_name: str) -> str:
    """`PositionTracker` to `position_tracker`."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", class_name).lower()


def contract_of(cls: type[Declares]) -> Contract:
    """Collect what a node class declares, its base classes included.

    Raises:
        ContractError: a callback does not say its message type, a timer names a parameter that is
            not there, a message type has no name, a parameter has no default, a callback is async, or
            Parameters is no robo.Parameters.
    """
    publishers: list[PublisherDeclaration] = []
    subscriptions: list[SubscriptionDeclaration] = []
    timers: list[TimerDeclaration] = []
    services: list[ServiceDeclaration] = []
    clients: list[ClientDeclaration] = []
    infos = _parameters(cls)
    for name, member in _members(cls).items():
        mark = getattr(member, MARK, None)
        if mark is not None:
            check_plain(member, f"{cls.__name__}.{name}")
        if isinstance(member, Publisher):
            publishers.append(_publisher(cls, name, member))
        elif isinstance(member, Client):
            clients.append(_client(cls, name, member))
        elif isinstance(mark, SubscribeMark):
            subscriptions.append(_subscription(cls, name, member, mark, infos))
        elif isinstance(mark, ServiceMark):
            services.append(_service(cls, name, member, mark))
        elif isinstance(mark, TimerMark):
            timers.append(_timer(cls, name, mark, infos))
    return Contract(
        snake_case(cls.__name__),
        _clean(cls.__dict__.get("__doc__") or ""),
        tuple(publishers),
        tuple(subscriptions),
        tuple(timers),
        tuple(services),
        tuple(clients),
        infos,
    )


def _parameters(cls: type[Declares]) -> tuple[hints.ParameterInfo, ...]:
    if not (isinstance(cls.Parameters, type) and issubclass(cls.Parameters, parameters.Parameters)):
        raise ContractError(
            f"{cls.__name__}.Parameters is a plain class; write class Parameters(robo.Parameters), so that its values"
            " are checked"
        )
    return tuple(parameters.describe(cls.Parameters))


def _publisher(cls: type[Declares], name: str, declared: Publisher[Any]) -> PublisherDeclaration:
    _check_type(cls, name, declared.message_type)
    return PublisherDeclaration(declared.topic, declared.message_type, declared.depth, name)


def _client(cls: type[Declares], name: str, declared: Client[Any, Any]) -> ClientDeclaration:
    _check_type(cls, name, declared.request_type)
    _check_type(cls, name, declared.response_type)
    return ClientDeclaration(declared.service, declared.request_type, declared.response_type, declared.timeout, name)


def _subscription(
    cls: type[Declares],
    name: str,
    method: Callable[..., Any],
    mark: SubscribeMark,
    infos: Sequence[hints.ParameterInfo],
) -> SubscriptionDeclaration:
    takes = "subscription's callback takes self, the message and, if it wants, a MessageInfo"
    message_type = _annotation(cls, name, method, takes, MessageInfo)
    informed = _function(method).__code__.co_argcount == 3
    if mark.sole_source is not None and mark.sole_source not in {i.name for i in infos if i.type == "str"}:
        raise ContractError(
            f"{cls.__name__}.{name}: @subscribe(sole_source={mark.sole_source!r}) names no text parameter of this node"
        )
    if mark.sole_source is not None and not informed:
        raise ContractError(f"{cls.__name__}.{name}: a sole source needs a method that takes a MessageInfo too")
    return SubscriptionDeclaration(mark.topic, message_type, mark.depth, name, informed, mark.sole_source)


def _service(cls: type[Declares], name: str, method: Callable[..., Any], mark: ServiceMark) -> ServiceDeclaration:
    request_type = _annotation(cls, name, method, "service's method takes self and the request")
    response_type = _check_type(cls, name, _hints(f"{cls.__name__}.{name}", method).get("return"))
    return ServiceDeclaration(mark.service, request_type, response_type, name)


def _timer(cls: type[Declares], name: str, mark: TimerMark, infos: Sequence[hints.ParameterInfo]) -> TimerDeclaration:
    if isinstance(mark.rate, str) and mark.rate not in {info.name for info in infos}:
        raise ContractError(f"{cls.__name__}.{name}: @timer(rate={mark.rate!r}) names no parameter of this node")
    return TimerDeclaration(mark.rate, name)


def _members(cls: type[Declares]) -> dict[str, Any]:
    members: dict[str, Any] = {}
    for base in reversed(cls.__mro__):
        members |= vars(base)
    return members


def _clean(doc: str) -> str:
    """A docstring without its indentation; `inspect`, which does it too, would cost each node 0.5 MB."""
    first, _, rest = doc.partition("\n")
    if not rest:
        return first.strip()
    import textwrap  # 0.1 MB for those who have more to say

    return f"{first}\n{textwrap.dedent(rest)}".strip()


def _function(method: Callable[..., Any]) -> Any:
    function: Any = method
    while hasattr(function, "__wrapped__"):
        function = function.__wrapped__
    return function


def _annotation(
    cls: type[Declares], name: str, method: Callable[..., Any], takes: str, more: type | None = None
) -> type[Message]:
    """The message type that a callback takes; `more` is the type of a second parameter, if it may have one."""
    where = f"{cls.__name__}.{name}"
    code = _function(method).__code__
    names = code.co_varnames[: code.co_argcount]
    hints = _hints(where, method)
    if len(names) != 2 and not (more is not None and len(names) == 3 and hints.get(names[2]) is more):
        raise ContractError(f"{where}: a {takes}, nothing else")
    hint = hints.get(names[1])
    if hint is None:
        raise ContractError(f"{where}: annotate {names[1]!r} with its message type")
    return _check_type(cls, name, hint)


def _hints(where: str, method: Callable[..., Any]) -> dict[str, Any]:
    try:
        return typing.get_type_hints(method)
    except NameError as error:
        raise ContractError(
            f"{where}: {error}; import the message type at run time, not only under TYPE_CHECKING"
        ) from None


def _check_type(cls: type[Declares], name: str, message_type: Any) -> type[Message]:
    where = f"{cls.__name__}.{name}"
    if not (isinstance(message_type, type) and issubclass(message_type, Message)):
        raise ContractError(f"{where}: {message_type!r} is no message type; use a subclass of robo_messages.Message")
    try:
        robo_messages.type_name(message_type)
    except robo_messages.UnknownType as error:
        raise ContractError(f"{where}: {error.args[0]}") from None
    return message_type
