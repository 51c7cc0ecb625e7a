"""What a node declares: `Publisher`, `Client`, `@subscribe`, `@service`, `@timer`. They only declare."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Protocol, TypeVar, cast, overload

import msgspec

from robo.errors import ContractError
from robo.node.loops import period_of
from robo.node.message_info import MessageInfo
from robo.parameters.model import Parameters
from robo.wire.qos import DEFAULT_DEPTH, DEFAULT_TIMEOUT, check_depth
from robo_messages import Message

if TYPE_CHECKING:
    from robo.node.services import ServiceClient
    from robo.node.topics import TopicPublisher

M = TypeVar("M", bound=Message)
Q = TypeVar("Q", bound=Message)
A = TypeVar("A", bound=Message)
N = TypeVar("N", bound="Declares")

MARK = "__robo_contract__"


class Declares:
    """What a class that declares has: parameters, beside the endpoints that are declared with the words below."""

    Parameters: ClassVar[type[Parameters]] = Parameters


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
    def __get__(self, instance: Declares, owner: type[object]) -> TopicPublisher[M]: ...
    def __get__(self, instance: Declares | None, owner: type[object]) -> Publisher[M] | TopicPublisher[M]:
        if instance is None:
            return self
        # Node.start() puts the real publisher into the instance, where it hides this descriptor.
        raise _too_early(owner, self._attribute)


def _too_early(owner: type[object], attribute: str) -> ContractError:
    text = f"{owner.__name__}.{attribute} is used before the node has started; use it in on_start() or later"
    return ContractError(text)


class Client(Generic[Q, A]):
    """Declares a service that a node calls: `reset = Client(Trigger.Request, Trigger.Response, "reset")`.

    On a node, `self.reset(Trigger.Request())` is the call.
    """

    def __init__(
        self, request_type: type[Q], response_type: type[A], service: str, *, timeout: float = DEFAULT_TIMEOUT
    ) -> None:
        """
        Args:
            request_type: what is asked.
            response_type: what is answered.
            service: its name: relative, absolute or private.
            timeout: how long a call waits for its answer, s.
        """
        self.request_type = request_type
        self.response_type = response_type
        self.service = service
        self.timeout = timeout

    def __set_name__(self, owner: type[object], name: str) -> None:
        self._attribute = name

    @overload
    def __get__(self, instance: None, owner: type[object]) -> Client[Q, A]: ...
    @overload
    def __get__(self, instance: Declares, owner: type[object]) -> ServiceClient[Q, A]: ...
    def __get__(self, instance: Declares | None, owner: type[object]) -> Client[Q, A] | ServiceClient[Q, A]:
        if instance is None:
            return self
        raise _too_early(owner, self._attribute)


class SubscribeMark(msgspec.Struct):
    """What `@subscribe` leaves on a method."""

    topic: str
    depth: int
    sole_source: str | None


class TimerMark(msgspec.Struct):
    """What `@timer` leaves on a method."""

    rate: float | str


class ServiceMark(msgspec.Struct):
    """What `@service` leaves on a method."""

    service: str


class _Subscribing(Protocol):
    """A method that takes a message, or a message and what is known of it."""

    @overload
    def __call__(self, method: Callable[[N, M], None]) -> Callable[[N, M], None]: ...
    @overload
    def __call__(self, method: Callable[[N, M, MessageInfo], None]) -> Callable[[N, M, MessageInfo], None]: ...


def subscribe(topic: str, *, depth: int = DEFAULT_DEPTH, sole_source: str | None = None) -> _Subscribing:
    """Call this method with each message of a topic; the message type is the parameter's annotation.

    A method with one parameter more gets a `MessageInfo` there: how old the message is, and whose.

    Args:
        topic: its name: relative, absolute or private.
        depth: keep the newest n messages while the node is busy; KEEP_ALL to lose none.
        sole_source: the parameter, a text, that says whose messages alone count: the name of a node;
            `plain` for plain Zenoh clients, which say no name; empty for the first node that comes.
            Those of others are counted, told and left out.
    """
    check_depth(depth)

    def mark(method: Any) -> Any:
        setattr(method, MARK, SubscribeMark(topic, depth, sole_source))
        return method

    return cast(_Subscribing, mark)


def service(name: str) -> Callable[[Callable[[N, Q], A]], Callable[[N, Q], A]]:
    """Answer the calls of a service with this method: it takes the request and returns the response.

        @service("reset_distance")
        def reset(self, request: Trigger.Request) -> Trigger.Response: ...

    What the method raises reaches the caller as a `ServiceError` with its message.

    Args:
        name: of the service: relative, absolute or private.
    """

    def mark(method: Callable[[N, Q], A]) -> Callable[[N, Q], A]:
        setattr(method, MARK, ServiceMark(name))
        return method

    return mark


def timer(*, rate: float | str) -> Callable[[Callable[[N], None]], Callable[[N], None]]:
    """Call this method at a steady rate: in Hz, or the name of the parameter that says it."""
    if not isinstance(rate, str):
        period_of(rate)

    def mark(method: Callable[[N], None]) -> Callable[[N], None]:
        setattr(method, MARK, TimerMark(rate))
        return method

    return mark
