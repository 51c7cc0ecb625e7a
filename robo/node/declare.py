"""What a node declares: `Publisher`, `Client`, `@subscribe`, `@service`, `@timer`, `@check`. They only declare."""

from __future__ import annotations

from collections.abc import Callable, Coroutine, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Protocol, TypeVar, cast, overload

import msgspec

from robo.errors import ContractError
from robo.node.loops import period_of
from robo.node.message_info import MessageInfo
from robo.node.turns import check_turn
from robo.parameters.model import Parameters
from robo.wire.qos import DEFAULT_TIMEOUT, Priority, QoS, check_priority, said
from robo_messages import Message

if TYPE_CHECKING:
    from robo.node.health import Health
    from robo.node.services import ServiceClient
    from robo.node.topics import TopicPublisher

M = TypeVar("M", bound=Message)
Q = TypeVar("Q", bound=Message)
A = TypeVar("A", bound=Message)
if TYPE_CHECKING:
    N = TypeVar("N", bound="Declares")
else:  # a name as a text would have Python's compiler set up in each node
    N = TypeVar("N")

R = TypeVar("R")
Awaited = Coroutine[Any, Any, R]
"""What an `async def` that returns R returns."""

MARK = "__robo_contract__"

HOOKS = ("on_start", "ready", "on_stop", "on_parameters_changing", "on_parameters_changed")
"""Methods of every node that robo calls; `main` apart, which may be async."""
LIFECYCLE_HOOKS = ("on_configure", "on_activate", "on_deactivate", "on_cleanup", "on_shutdown", "on_error")
"""What a managed node may do on its way from state to state."""


class Declares:
    """What a class that declares has: parameters, beside the endpoints that are declared with the words below."""

    Parameters: ClassVar[type[Parameters]] = Parameters
    IS_MANAGED: ClassVar[bool] = False
    """Whether it has ROS's states of a managed node: that of a `LifecycleNode`."""
    REQUIRES: ClassVar[Mapping[str, str]] = {}
    """Modules that it imports only when it runs, and what `pip install` brings each: `{"serial": "pyserial"}`.

    Where one is not there, `robo up` says so before anything starts, and `robo run` before the node does; see
    `lacking`.
    """


class Publisher(Generic[M]):
    """Declares a topic that a node publishes: `position = Publisher(Point, "current_position")`.

    On a node, `self.position` is the publisher itself.
    """

    def __init__(
        self,
        message_type: type[M],
        topic: str,
        *,
        qos: QoS | None = None,
        depth: int | None = None,
        latched: bool | None = None,
        priority: Priority | None = None,
        deadline: float | None = None,
    ) -> None:
        """
        Args:
            message_type: what is published.
            topic: its name: relative, absolute or private (`~/state`).
            qos: a profile, such as `QoS.COMMAND`; what is said beside it comes before it.
            depth: KEEP_ALL makes `publish` wait for receivers that asked for every message;
                with any other depth it never waits.
            latched: whoever comes later gets the last message, or the last `depth`.
            priority: what goes first where a link has more to carry than it can, as Zenoh has it.
            deadline: promises a message at least so often, s.
        """
        self.message_type = message_type
        self.topic = topic
        self.qos = said(qos, depth=depth, latched=latched, priority=priority, deadline=deadline).of_publisher()

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
        raise too_early(owner, self._attribute)


def too_early(owner: type[object], attribute: str) -> ContractError:
    """What is raised where an end is used before there is a network."""
    text = f"{owner.__name__}.{attribute} is used before the node has started; use it in on_start() or later"
    return ContractError(text)


class Client(Generic[Q, A]):
    """Declares a service that a node calls: `reset = Client(Trigger.Request, Trigger.Response, "reset")`.

    On a node, `self.reset(Trigger.Request())` is the call.
    """

    def __init__(
        self,
        request_type: type[Q],
        response_type: type[A],
        service: str,
        *,
        timeout: float = DEFAULT_TIMEOUT,
        priority: Priority = "data",
    ) -> None:
        """
        Args:
            request_type: what is asked.
            response_type: what is answered.
            service: its name: relative, absolute or private.
            timeout: how long a call waits for its answer, s.
            priority: what goes first where a link has more to carry than it can; a call of an emergency stop does.
        """
        self.request_type = request_type
        self.response_type = response_type
        self.service = service
        self.timeout = timeout
        self.priority = check_priority(priority)

    def __set_name__(self, owner: type[object], name: str) -> None:
        self._attribute = name

    @overload
    def __get__(self, instance: None, owner: type[object]) -> Client[Q, A]: ...
    @overload
    def __get__(self, instance: Declares, owner: type[object]) -> ServiceClient[Q, A]: ...
    def __get__(self, instance: Declares | None, owner: type[object]) -> Client[Q, A] | ServiceClient[Q, A]:
        if instance is None:
            return self
        raise too_early(owner, self._attribute)


class SubscribeMark(msgspec.Struct):
    """What `@subscribe` leaves on a method."""

    topic: str
    qos: QoS
    sole_source: str | None
    turn: str = ""
    """Which turn it takes; empty for the node's own. So for the marks below."""


class TimerMark(msgspec.Struct):
    """What `@timer` leaves on a method."""

    rate: float | str
    turn: str = ""


class ServiceMark(msgspec.Struct):
    """What `@service` leaves on a method."""

    service: str
    turn: str = ""


class CheckMark(msgspec.Struct):
    """What `@check` leaves on a method."""

    name: str


class _Subscribing(Protocol):
    """A method that takes a message, or a message and what is known of it."""

    @overload
    def __call__(self, method: Callable[[N, M], None]) -> Callable[[N, M], None]: ...
    @overload
    def __call__(self, method: Callable[[N, M, MessageInfo], None]) -> Callable[[N, M, MessageInfo], None]: ...
    @overload
    def __call__(self, method: Callable[[N, M], Awaited[None]]) -> Callable[[N, M], Awaited[None]]: ...
    @overload
    def __call__(
        self, method: Callable[[N, M, MessageInfo], Awaited[None]]
    ) -> Callable[[N, M, MessageInfo], Awaited[None]]: ...


class _Serving(Protocol):
    """A method that takes a request and returns the response, at once or once it has been awaited."""

    @overload
    def __call__(self, method: Callable[[N, Q], A]) -> Callable[[N, Q], A]: ...
    @overload
    def __call__(self, method: Callable[[N, Q], Awaited[A]]) -> Callable[[N, Q], Awaited[A]]: ...


class _Ticking(Protocol):
    """A method that takes nothing."""

    @overload
    def __call__(self, method: Callable[[N], None]) -> Callable[[N], None]: ...
    @overload
    def __call__(self, method: Callable[[N], Awaited[None]]) -> Callable[[N], Awaited[None]]: ...


def subscribe(
    topic: str,
    *,
    qos: QoS | None = None,
    depth: int | None = None,
    latched: bool | None = None,
    deadline: float | None = None,
    lifespan: float | None = None,
    sole_source: str | None = None,
    turn: str = "",
) -> _Subscribing:
    """Call this method with each message of a topic; the message type is the parameter's annotation.

    A method with one parameter more gets a `MessageInfo` there: how old the message is, and whose.

    Args:
        topic: its name: relative, absolute or private.
        qos: a profile, such as `QoS.SENSOR_DATA`; what is said beside it comes before it.
        depth: keep the newest n messages while the node is busy; KEEP_ALL to lose none.
        latched: begin with the last message of each latched publisher, or with its last `depth`.
        deadline: needs a message at least so often, s.
        lifespan: drop messages that are older than this, s.
        sole_source: the parameter, a text, that says whose messages alone count: the name of a node;
            `plain` for plain Zenoh clients, which say no name; empty for the first node that comes.
            Those of others are counted, told and left out.
        turn: a turn of its own, by any name: it waits only for callbacks that name the same one (ROS:
            a mutually exclusive callback group). By default it takes the node's.
    """
    check_turn(turn)
    quality = said(qos, depth=depth, latched=latched, deadline=deadline, lifespan=lifespan).of_subscription()

    def mark(method: Any) -> Any:
        setattr(method, MARK, SubscribeMark(topic, quality, sole_source, turn))
        return method

    return cast(_Subscribing, mark)


def service(name: str, *, turn: str = "") -> _Serving:
    """Answer the calls of a service with this method: it takes the request and returns the response.

        @service("reset_distance")
        def reset(self, request: Trigger.Request) -> Trigger.Response: ...

    What the method raises reaches the caller as a `ServiceError` with its message.

    Args:
        name: of the service: relative, absolute or private.
        turn: a turn of its own, as for `subscribe`: `@service("emergency_stop", turn="stop")`.
    """
    check_turn(turn)

    def mark(method: Any) -> Any:
        setattr(method, MARK, ServiceMark(name, turn))
        return method

    return cast(_Serving, mark)


def timer(*, rate: float | str, turn: str = "") -> _Ticking:
    """Call this method at a steady rate.

    Args:
        rate: in Hz, or the name of the parameter that says it.
        turn: a turn of its own, as for `subscribe`.
    """
    check_turn(turn)
    if not isinstance(rate, str):
        period_of(rate)

    def mark(method: Any) -> Any:
        setattr(method, MARK, TimerMark(rate, turn))
        return method

    return cast(_Ticking, mark)


def check(name: str) -> Callable[[Callable[[N], Health]], Callable[[N], Health]]:
    """Ask this method once a second how well something does; it returns a `Health`.

        @check("battery")
        def battery(self) -> Health:
            if self.volts < 11.0:
                return Health.warn("charge it", volts=self.volts)
            return Health.ok(volts=self.volts)

    It takes the node's turn, so it looks at what callbacks have found, and waits for nothing. What it says is
    published on `diagnostics` of the node's namespace, and shown by `robo top`, `robo why` and `robo node info`.

    Args:
        name: of what is checked, in a word or two: one of its own within the node.

    Raises:
        ContractError: the name cannot be one.
    """
    if callable(name):  # the parentheses were forgotten
        given = getattr(name, "__name__", "what")
        raise ContractError(f'@check needs the name of what is checked: @check("{given}")')
    if not name or not name.isprintable() or name != name.strip() or {*name} & {"/", ":"}:
        raise ContractError(f"@check({name!r}): name what is checked in a word or two, without / and :")

    def mark(method: Callable[[N], Health]) -> Callable[[N], Health]:
        setattr(method, MARK, CheckMark(name))
        return method

    return mark
