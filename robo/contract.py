"""What a node class promises, readable without running it.

`Publisher`, `@subscribe` and `@timer` only declare; `contract_of` collects the declarations. The
runtime, the check of a manifest and the tools all work from the collected `Contract`.
"""

from __future__ import annotations

import re
import textwrap
import typing
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Generic, TypeVar, overload

import msgspec

import robo_messages
from robo import parameters
from robo.errors import ContractError
from robo.qos import DEFAULT_DEPTH, check_depth
from robo_messages import Message

if TYPE_CHECKING:
    from robo.endpoints import TopicPublisher
    from robo.node import Node

M = TypeVar("M", bound=Message)
N = TypeVar("N", bound="Node")

_MARK = "__robo_contract__"


class Publisher(Generic[M]):
    """Declares a topic that a node publishes: `position = Publisher(Point, "current_position")`.

    On a node, `self.position` is the publisher itself.
    """

    def __init__(self, message_type: type[M], topic: str, *, depth: int = DEFAULT_DEPTH) -> None:
        """
        Args:
            message_type: what is published.
            topic: its name: relative, absolute or private (`~/state`).
            depth: KEEP_ALL makes `publish` wait for receivers that asked for every message;
                with any other depth it never waits.
        """
        self.message_type = message_type
        self.topic = topic
        self.depth = check_depth(depth)

    def __set_name__(self, owner: type[object], name: str) -> None:
        self._attribute = name

    @overload
    def __get__(self, instance: None, owner: type[object]) -> Publisher[M]: ...
    @overload
    def __get__(self, instance: Node, owner: type[object]) -> TopicPublisher[M]: ...
    def __get__(self, instance: Node | None, owner: type[object]) -> Publisher[M] | TopicPublisher[M]:
        if instance is None:
            return self
        # Node.start() puts the real publisher into the instance, where it hides this descriptor.
        raise ContractError(
            f"{owner.__name__}.{self._attribute} is used before the node has started; use it in on_start() or later"
        )


class SubscriptionDeclaration(msgspec.Struct, frozen=True):
    """One `@subscribe`."""

    topic: str
    message_type: type[Message]
    depth: int
    method: str


class PublisherDeclaration(msgspec.Struct, frozen=True):
    """One `Publisher`."""

    topic: str
    message_type: type[Message]
    depth: int
    attribute: str


class TimerDeclaration(msgspec.Struct, frozen=True):
    """One `@timer`."""

    rate: float | str
    """Hz, or the name of the parameter that says it."""
    method: str


class Contract(msgspec.Struct, frozen=True):
    """All that a node class declares."""

    name: str
    """The node's default name: the class's in snake_case."""
    description: str
    publishers: tuple[PublisherDeclaration, ...]
    subscriptions: tuple[SubscriptionDeclaration, ...]
    timers: tuple[TimerDeclaration, ...]
    parameters: tuple[parameters.ParameterInfo, ...]


class _SubscribeMark(msgspec.Struct):
    topic: str
    depth: int


class _TimerMark(msgspec.Struct):
    rate: float | str


def subscribe(topic: str, *, depth: int = DEFAULT_DEPTH) -> Callable[[Callable[[N, M], None]], Callable[[N, M], None]]:
    """Call this method with each message of a topic; the message type is the parameter's annotation.

    Args:
        topic: its name: relative, absolute or private.
        depth: keep the newest n messages while the node is busy; KEEP_ALL to lose none.
    """
    check_depth(depth)

    def mark(method: Callable[[N, M], None]) -> Callable[[N, M], None]:
        setattr(method, _MARK, _SubscribeMark(topic, depth))
        return method

    return mark


def timer(*, rate: float | str) -> Callable[[Callable[[N], None]], Callable[[N], None]]:
    """Call this method at a steady rate: in Hz, or the name of the parameter that says it."""
    if not isinstance(rate, str) and not rate > 0:
        raise ContractError(f"timer rate {rate}: use a positive number of Hz")

    def mark(method: Callable[[N], None]) -> Callable[[N], None]:
        setattr(method, _MARK, _TimerMark(rate))
        return method

    return mark


def snake_case(class_name: str) -> str:
    """`PositionTracker` to `position_tracker`."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", class_name).lower()


def contract_of(cls: type[Node]) -> Contract:
    """Collect what a node class declares, its base classes included.

    Raises:
        ContractError: a callback does not say its message type, a timer names a parameter that is
            not there, a message type has no name, or a parameter has no default.
    """
    publishers: list[PublisherDeclaration] = []
    subscriptions: list[SubscriptionDeclaration] = []
    timers: list[TimerDeclaration] = []
    infos = tuple(parameters.describe(cls.Parameters))
    for name, member in _members(cls).items():
        mark = getattr(member, _MARK, None)
        if isinstance(member, Publisher):
            _check_type(cls, name, member.message_type)
            publishers.append(PublisherDeclaration(member.topic, member.message_type, member.depth, name))
        elif isinstance(mark, _SubscribeMark):
            message_type = _annotation(cls, name, member)
            subscriptions.append(SubscriptionDeclaration(mark.topic, message_type, mark.depth, name))
        elif isinstance(mark, _TimerMark):
            if isinstance(mark.rate, str) and mark.rate not in {info.name for info in infos}:
                raise ContractError(
                    f"{cls.__name__}.{name}: @timer(rate={mark.rate!r}) names no parameter of this node"
                )
            timers.append(TimerDeclaration(mark.rate, name))
    return Contract(
        snake_case(cls.__name__),
        _clean(cls.__dict__.get("__doc__") or ""),
        tuple(publishers),
        tuple(subscriptions),
        tuple(timers),
        infos,
    )


def _members(cls: type[Node]) -> dict[str, Any]:
    members: dict[str, Any] = {}
    for base in reversed(cls.__mro__):
        members |= vars(base)
    return members


def _clean(doc: str) -> str:
    """A docstring without its indentation; `inspect`, which does it too, would cost each node 0.5 MB."""
    first, _, rest = doc.partition("\n")
    return f"{first}\n{textwrap.dedent(rest)}".strip()


def _annotation(cls: type[Node], name: str, method: Callable[..., None]) -> type[Message]:
    where = f"{cls.__name__}.{name}"
    function: Any = method
    while hasattr(function, "__wrapped__"):
        function = function.__wrapped__
    names = function.__code__.co_varnames[: function.__code__.co_argcount]
    if len(names) != 2:
        raise ContractError(f"{where}: a subscription's callback takes self and the message, nothing else")
    try:
        hint = typing.get_type_hints(method).get(names[1])
    except NameError as error:
        raise ContractError(
            f"{where}: {error}; import the message type at run time, not only under TYPE_CHECKING"
        ) from None
    if hint is None:
        raise ContractError(f"{where}: annotate {names[1]!r} with its message type")
    return _check_type(cls, name, hint)


def _check_type(cls: type[Node], name: str, message_type: Any) -> type[Message]:
    where = f"{cls.__name__}.{name}"
    if not (isinstance(message_type, type) and issubclass(message_type, Message)):
        raise ContractError(f"{where}: {message_type!r} is no message type; use a subclass of robo_messages.Message")
    try:
        robo_messages.type_name(message_type)
    except robo_messages.UnknownType as error:
        raise ContractError(f"{where}: {error.args[0]}") from None
    return message_type
