"""What a node class promises, readable without running it.

`Publisher`, `@subscribe` and `@timer` only declare; `contract_of` collects the declarations. The
runtime, the check of a manifest and the tools all work from the collected `Contract`.
"""

from __future__ import annotations

import re
import typing
from collections.abc import Callable, Mapping, Sequence
from types import FunctionType
from typing import TYPE_CHECKING, Any, TypeVar

import msgspec

import robo_messages
from robo.errors import ContractError
from robo.node.actions import ActionClient, ActionMark
from robo.node.callables import check_plain, check_steps, is_async, place_of
from robo.node.declare import (
    HOOKS,
    LIFECYCLE_HOOKS,
    MARK,
    CheckMark,
    Client,
    Declares,
    Publisher,
    ServiceMark,
    SubscribeMark,
    TimerMark,
)
from robo.node.message_info import MessageInfo
from robo.node.part import Part
from robo.parameters import hints
from robo.parameters import model as parameters
from robo.wire.qos import Priority, QoS
from robo_messages import Message

if TYPE_CHECKING:
    from robo.node.action_contract import ActionClientDeclaration, ActionDeclaration
    from robo.node.checks import CheckDeclaration


class SubscriptionDeclaration(msgspec.Struct, frozen=True):
    """One `@subscribe`."""

    topic: str
    message_type: type[Message]
    qos: QoS
    method: str
    """Its name; of a part of the node `part.method`. So for other methods and attributes below."""
    informed: bool = False
    """Whether the method takes a `MessageInfo` beside the message."""
    sole_source: str | None = None
    """The parameter that names whose messages alone count."""
    turn: str = ""
    """Which turn the method takes; empty for the node's own. So for services and timers."""


class PublisherDeclaration(msgspec.Struct, frozen=True):
    """One `Publisher`."""

    topic: str
    message_type: type[Message]
    qos: QoS
    attribute: str


class ServiceDeclaration(msgspec.Struct, frozen=True):
    """One `@service`."""

    service: str
    request_type: type[Message]
    response_type: type[Message]
    method: str
    turn: str = ""


class ClientDeclaration(msgspec.Struct, frozen=True):
    """One `Client`."""

    service: str
    request_type: type[Message]
    response_type: type[Message]
    timeout: float
    """s."""
    priority: Priority
    attribute: str


class TimerDeclaration(msgspec.Struct, frozen=True):
    """One `@timer`."""

    rate: float | str
    """The rate, Hz, or the name of the parameter that says it."""
    method: str
    turn: str = ""


D = TypeVar("D", bound=msgspec.Struct)


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
    actions: tuple[ActionDeclaration, ...]
    action_clients: tuple[ActionClientDeclaration, ...]
    parameters: tuple[hints.ParameterInfo, ...]
    managed: bool = False
    """Whether it is a `LifecycleNode`."""
    checks: tuple[CheckDeclaration, ...] = ()


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


_TAKES_KEYWORDS = 0x08  # as in `inspect`
_GIVEN_TO_A_NODE = {"name", "namespace", "parameters", "remappings", "sources"}


def snake_case(class_name: str) -> str:
    """`PositionTracker` to `position_tracker`."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", class_name).lower()


def contract_of(cls: type[Declares]) -> Contract:
    """Collect what a node class declares, its base classes included.

    Raises:
        ContractError: a callback does not say its message type, a timer names a parameter that is not there, a message
            type or a check has no name, a parameter no default, a callback yields, a hook is async, or Parameters none.
    """
    publishers: list[PublisherDeclaration] = []
    subscriptions: list[SubscriptionDeclaration] = []
    timers: list[TimerDeclaration] = []
    services: list[ServiceDeclaration] = []
    clients: list[ClientDeclaration] = []
    actions: list[ActionDeclaration] = []
    action_clients: list[ActionClientDeclaration] = []
    infos, members = _parameters(cls), _members(cls)
    _check_hooks(cls, members)
    for name, member in members.items():
        mark = getattr(member, MARK, None)
        if mark is not None:
            if isinstance(mark, ActionMark):
                check_steps(member, f"{cls.__name__}.{name}")
            else:
                is_async(member, f"{cls.__name__}.{name}")
        elif name in HOOKS:
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
        elif isinstance(mark, ActionMark):
            actions.append(_action(cls, name, member, mark, infos))
        elif isinstance(member, ActionClient):
            action_clients.append(_action_client(cls, name, member))
        elif isinstance(member, Part):
            part = _part(cls, name, member)
            publishers += [_within(name, one, "attribute") for one in part.publishers]
            clients += [_within(name, one, "attribute") for one in part.clients]
            subscriptions += [_within(name, one, "method") for one in part.subscriptions]
            services += [_within(name, one, "method") for one in part.services]
            timers += [_within(name, one, "method") for one in part.timers]
    return Contract(
        snake_case(cls.__name__),
        _clean(cls.__dict__.get("__doc__") or ""),
        tuple(publishers),
        tuple(subscriptions),
        tuple(timers),
        tuple(services),
        tuple(clients),
        tuple(actions),
        tuple(action_clients),
        infos,
        cls.IS_MANAGED,
        _checks(cls, members),
    )


def _parameters(cls: type[Declares]) -> tuple[hints.ParameterInfo, ...]:
    if not (isinstance(cls.Parameters, type) and issubclass(cls.Parameters, parameters.Parameters)):
        raise ContractError(
            f"{cls.__name__}.Parameters is a plain class; write class Parameters(robo.Parameters), so that its values"
            " are checked"
        )
    return tuple(parameters.describe(cls.Parameters))


def _check_hooks(cls: type[Declares], members: Mapping[str, Any]) -> None:
    """Refuse hooks of a managed node that would not be called, or whose call would do nothing."""
    for name in LIFECYCLE_HOOKS:
        hook = members.get(name)
        if cls.IS_MANAGED and hook is not None:
            check_plain(hook, f"{cls.__name__}.{name}")
        elif name in _HOOKS_ALONE and isinstance(hook, FunctionType) and not hasattr(hook, MARK):
            raise ContractError(
                f"{place_of(hook)}: {cls.__name__}.{name} is a hook of managed nodes and would never be called; derive"
                " from robo.LifecycleNode, or call it otherwise"
            )


_HOOKS_ALONE = LIFECYCLE_HOOKS[:4]
"""Names that say nothing else; a plain node may well have an `on_error` of its own."""


def _publisher(cls: type[Declares], name: str, declared: Publisher[Any]) -> PublisherDeclaration:
    _check_type(cls, name, declared.message_type)
    return PublisherDeclaration(declared.topic, declared.message_type, declared.qos, name)


def _client(cls: type[Declares], name: str, declared: Client[Any, Any]) -> ClientDeclaration:
    _check_type(cls, name, declared.request_type)
    _check_type(cls, name, declared.response_type)
    types = declared.request_type, declared.response_type
    return ClientDeclaration(declared.service, *types, declared.timeout, declared.priority, name)


def _subscription(
    cls: type[Declares],
    name: str,
    method: Callable[..., Any],
    mark: SubscribeMark,
    infos: Sequence[hints.ParameterInfo],
) -> SubscriptionDeclaration:
    takes = "subscription's callback takes self, the message and, if it wants, a MessageInfo"
    message_type = _annotation(cls, name, method, takes, lambda hint: hint is MessageInfo)
    informed = _function(method).__code__.co_argcount == 3
    if mark.sole_source is not None and mark.sole_source not in {i.name for i in infos if i.type == "str"}:
        raise ContractError(
            f"{cls.__name__}.{name}: @subscribe(sole_source={mark.sole_source!r}) names no text parameter of this node"
        )
    if mark.sole_source is not None and not informed:
        raise ContractError(f"{cls.__name__}.{name}: a sole source needs a method that takes a MessageInfo too")
    return SubscriptionDeclaration(mark.topic, message_type, mark.qos, name, informed, mark.sole_source, mark.turn)


def _service(cls: type[Declares], name: str, method: Callable[..., Any], mark: ServiceMark) -> ServiceDeclaration:
    request_type = _annotation(cls, name, method, "service's method takes self and the request")
    response_type = _check_type(cls, name, _hints(f"{cls.__name__}.{name}", method).get("return"))
    return ServiceDeclaration(mark.service, request_type, response_type, name, mark.turn)


def _timer(cls: type[Declares], name: str, mark: TimerMark, infos: Sequence[hints.ParameterInfo]) -> TimerDeclaration:
    if isinstance(mark.rate, str) and mark.rate not in {info.name for info in infos}:
        raise ContractError(f"{cls.__name__}.{name}: @timer(rate={mark.rate!r}) names no parameter of this node")
    return TimerDeclaration(mark.rate, name, mark.turn)


def _action(
    cls: type[Declares], name: str, method: Callable[..., Any], mark: ActionMark, infos: Sequence[hints.ParameterInfo]
) -> ActionDeclaration:
    from robo.node.action_contract import action_declaration  # nodes without actions save the time and the memory

    if isinstance(mark.rate, str) and mark.rate not in {info.name for info in infos}:
        raise ContractError(f"{cls.__name__}.{name}: @action(rate={mark.rate!r}) names no parameter of this node")
    takes = "action's method takes self and the goal"
    goal_type = _annotation(cls, name, method, takes, lambda hint: hint is not None)
    hints = _hints(f"{cls.__name__}.{name}", method)
    told = hints[_taken(method)[2]] if len(_taken(method)) == 3 else None
    return action_declaration(cls, name, mark, goal_type, told, hints.get("return"))


def _action_client(cls: type[Declares], name: str, declared: ActionClient[Any, Any, Any]) -> ActionClientDeclaration:
    from robo.node.action_contract import action_client_declaration

    return action_client_declaration(cls, name, declared)


def _checks(cls: type[Declares], members: Mapping[str, Any]) -> tuple[CheckDeclaration, ...]:
    if not any(isinstance(m, Part) or isinstance(getattr(m, MARK, None), CheckMark) for m in members.values()):
        return ()
    from robo.node.checks import checks_of  # as for actions

    return checks_of(cls.__name__, members, lambda part: contract_of(type(part)).checks)


def _part(cls: type[Declares], name: str, part: Part) -> Contract:
    kind = type(part)
    contract = contract_of(kind)
    alien = [hook for hook in (*HOOKS, *LIFECYCLE_HOOKS, "main") if hasattr(kind, hook)]
    alien += ["Parameters"] if kind.Parameters is not Declares.Parameters else []
    alien += ["actions"] if contract.actions or contract.action_clients else []
    if alien:
        raise ContractError(
            f"{cls.__name__}.{name}: {kind.__name__} is a part of a node and may not have {', '.join(alien)}, which"
            " belong to the node; a part declares topics, services and timers"
        )
    return contract


def _within(part: str, declaration: D, field: str) -> D:
    """What a part declares, as its node has it: found at `part.method`."""
    return msgspec.structs.replace(declaration, **{field: f"{part}.{getattr(declaration, field)}"})


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


def _taken(method: Callable[..., Any]) -> tuple[str, ...]:
    """The names of what a method takes."""
    code = _function(method).__code__
    return tuple(code.co_varnames[: code.co_argcount])


def _annotation(
    cls: type[Declares],
    name: str,
    method: Callable[..., Any],
    takes: str,
    may_be: Callable[[object], bool] = lambda _: False,
) -> type[Message]:
    """The message type that a callback takes; `may_be` says what a second parameter may be."""
    where = f"{cls.__name__}.{name}"
    names = _taken(method)
    hints = _hints(where, method)
    if len(names) != 2 and not (len(names) == 3 and may_be(hints.get(names[2]))):
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
