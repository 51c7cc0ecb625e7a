"""Making ends while a node runs: `create_publisher` and the like."""

from __future__ import annotations

import sys
from collections.abc import Callable, Coroutine
from types import FrameType
from typing import Any, TypeVar

from robo.errors import ContractError
from robo.node.clock import Clock
from robo.node.factory import EndpointFactory
from robo.node.hooks import Hooks
from robo.node.life import Life
from robo.node.loops import TimerLoop
from robo.node.message_info import MessageInfo
from robo.node.services import ServiceClient, ServiceServer
from robo.node.topics import TopicPublisher, TopicSubscription
from robo.wire.qos import DEFAULT_TIMEOUT, Priority, QoS, check_priority, said
from robo_messages import Message

M = TypeVar("M", bound=Message)
Q = TypeVar("Q", bound=Message)
A = TypeVar("A", bound=Message)
Returned = None | Coroutine[Any, Any, None]
"""What a callback returns: nothing, at once or once it has been awaited."""


class Creating(Hooks):
    """What a node makes beyond what its class declares; all of it goes with the node."""

    full_name: str
    clock: Clock
    _life: Life | None

    def create_publisher(
        self,
        message_type: type[M],
        topic: str,
        depth: int | None = None,
        *,
        qos: QoS | None = None,
        latched: bool | None = None,
        priority: Priority | None = None,
        deadline: float | None = None,
    ) -> TopicPublisher[M]:
        """Make a publisher while running; for one the class always has, declare a `Publisher`, which takes the same."""
        quality = said(qos, depth=depth, latched=latched, priority=priority, deadline=deadline).of_publisher()
        return self._make("create_publisher").publisher(message_type, topic, quality)

    def create_subscription(
        self,
        message_type: type[M],
        topic: str,
        callback: Callable[[M], Returned] | Callable[[M, MessageInfo], Returned],
        depth: int | None = None,
        sole_source: Callable[[], str] | None = None,
        *,
        qos: QoS | None = None,
        latched: bool | None = None,
        deadline: float | None = None,
        lifespan: float | None = None,
        turn: str = "",
    ) -> TopicSubscription[M]:
        """Subscribe while running; for a topic the class always reads, use `@subscribe`.

        Args:
            message_type: what is read.
            topic: its name: relative, absolute or private.
            callback: takes the message and, if it has a second parameter, its `MessageInfo`.
            depth: keep the newest n messages while the node is busy; KEEP_ALL to lose none.
            sole_source: says whose messages alone count, as for `@subscribe`; the callback takes a `MessageInfo`.
            qos, latched, deadline, lifespan, turn: as for `@subscribe`.

        Raises:
            ContractError: the node has not started, the callback yields, or there is a sole source and it takes
                no `MessageInfo`.
        """
        quality = said(qos, depth=depth, latched=latched, deadline=deadline, lifespan=lifespan).of_subscription()
        make = self._make("create_subscription")
        return make.subscription(message_type, topic, callback, quality, sole_source, turn)

    def create_timer(
        self,
        period: float | Callable[[], float],
        callback: Callable[[], Returned],
        clock: Clock | None = None,
        turn: str = "",
    ) -> TimerLoop:
        """Call `callback` every `period` seconds; a function is asked before each tick.

        Args:
            period: in s.
            callback: what to call.
            clock: whose seconds; by default the node's, which may be simulated.
            turn: as for `@timer`.

        Raises:
            ContractError: the period is not 1e-6 to 1e9 s, or the callback yields.
        """
        return self._make("create_timer").timer(period, callback, clock or self.clock, turn)

    def create_service(
        self,
        request_type: type[Q],
        response_type: type[A],
        name: str,
        handler: Callable[[Q], A | Coroutine[Any, Any, A]],
        turn: str = "",
    ) -> ServiceServer[Q, A]:
        """Serve while running; for a service the class always has, use `@service`.

        Raises:
            ContractError: the node has not started, or the handler yields.
        """
        return self._make("create_service").service(request_type, response_type, name, handler, turn)

    def create_client(
        self,
        request_type: type[Q],
        response_type: type[A],
        name: str,
        timeout: float = DEFAULT_TIMEOUT,
        *,
        priority: Priority = "data",
    ) -> ServiceClient[Q, A]:
        """Make a client of a service while running; for one the class always has, declare a `Client`."""
        return self._make("create_client").client(request_type, response_type, name, timeout, check_priority(priority))

    def _make(self, making: str) -> EndpointFactory:
        """What makes live ends, once there is a network to make them on."""
        if self._life is None or self._life.is_over:
            raise _too_early(self.full_name, making, sys._getframe(2))  # of the caller of create_…
        return self._life.factory


def _too_early(full_name: str, making: str, frame: FrameType) -> ContractError:
    return ContractError(
        f"{frame.f_code.co_filename}:{frame.f_lineno}: {making} before {full_name} has started; call it in"
        " on_start(), or declare what the class always has (Publisher, @subscribe, @timer, @service, Client)"
    )
