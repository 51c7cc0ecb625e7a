"""Making the live ends of a node that has joined the network."""

from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from typing import TypeVar

import zenoh

from robo.errors import ContractError
from robo.node.clock import Clock, SimClock
from robo.node.contract import check_plain, takes_info
from robo.node.endpoints import Endpoints
from robo.node.identity import Identity
from robo.node.intake import Intake
from robo.node.loops import TimerLoop, checked_period
from robo.node.message_info import PLAIN
from robo.node.services import ServiceClient, ServiceServer, service_token
from robo.node.topics import TopicPublisher, TopicSubscription, endpoint_token
from robo.node.troubles import Troubles
from robo.node.turn import Turn, name_of
from robo_messages import Clock as ClockMessage
from robo_messages import Message

M = TypeVar("M", bound=Message)
Q = TypeVar("Q", bound=Message)
A = TypeVar("A", bound=Message)


class EndpointFactory:
    """Makes ends under the node's names, whose callbacks take its turn, and adds them to its endpoints.

    Every method raises InvalidName where the name breaks the rules.
    """

    def __init__(
        self,
        session: zenoh.Session,
        identity: Identity,
        ends: Endpoints,
        turn: Turn,
        troubles: Troubles,
        clock: Clock,
    ) -> None:
        self.session = session
        self._identity = identity
        self._ends = ends
        self._turn = turn
        self._troubles = troubles
        self._clock = clock

    def publisher(self, message_type: type[M], topic: str, depth: int) -> TopicPublisher[M]:
        """An end that publishes."""
        node = self._identity
        token = endpoint_token(node.namespace, node.name, "pub", message_type, depth, node.resolve(topic))
        publisher = TopicPublisher(self.session, token, message_type, self._clock)
        self._ends.add_publisher(publisher)
        return publisher

    def subscription(
        self,
        message_type: type[M],
        topic: str,
        callback: Callable[..., None],
        depth: int,
        sole_source: Callable[[], str] | None,
    ) -> TopicSubscription[M]:
        """An end that subscribes; `callback` and `sole_source` as for `Node.create_subscription`.

        Raises:
            ContractError: the callback is async, or there is a sole source and it takes no `MessageInfo`.
        """
        check_plain(callback)
        informed = takes_info(callback)
        if sole_source is not None and not informed:
            raise ContractError(f"{name_of(callback)}: a sole source needs a callback that takes a MessageInfo too")
        with ExitStack() as made:
            intake = self._intake(self._identity.resolve(topic), sole_source) if informed else None
            if intake is not None:
                made.callback(intake.close)
            subscription = self._subscription(message_type, topic, callback, depth, self._turn, intake)
            made.pop_all()
        return subscription

    def timer(self, period: float | Callable[[], float], callback: Callable[[], None], clock: Clock) -> TimerLoop:
        """A timer; the arguments as for `Node.create_timer`.

        Raises:
            ContractError: the period is not 1e-6 to 1e9 s, or the callback is async.
        """
        check_plain(callback)
        ask = period if callable(period) else lambda: period
        checked_period(ask())
        handler = self._troubles.handler(callback)
        timer = TimerLoop(name_of(callback), ask, self._turn, callback, handler, clock)
        self._ends.add_timer(timer)
        return timer

    def service(
        self, request_type: type[Q], response_type: type[A], name: str, handler: Callable[[Q], A]
    ) -> ServiceServer[Q, A]:
        """An end that serves.

        Raises:
            ContractError: the handler is async.
        """
        check_plain(handler)
        node = self._identity
        token = service_token(node.namespace, node.name, "srv", request_type, response_type, node.resolve(name))
        on_error = self._troubles.handler(handler)
        service = ServiceServer(self.session, token, request_type, response_type, self._turn, handler, on_error)
        self._ends.add_service(service)
        return service

    def client(self, request_type: type[Q], response_type: type[A], name: str, timeout: float) -> ServiceClient[Q, A]:
        """An end that calls a service."""
        node = self._identity
        token = service_token(node.namespace, node.name, "cli", request_type, response_type, node.resolve(name))
        client = ServiceClient(self.session, token, request_type, response_type, timeout)
        self._ends.add_client(client)
        return client

    def follow_clock(self, clock: SimClock) -> None:
        """Take the time from the topic `/clock`, past the callbacks: these may wait for it."""

        def follow(message: ClockMessage) -> None:
            clock.advance(message.clock.to_nanoseconds())

        self._subscription(ClockMessage, "/clock", follow, 1, Turn(self._turn.on_death), None)

    def _subscription(
        self,
        message_type: type[M],
        topic: str,
        callback: Callable[..., None],
        depth: int,
        turn: Turn,
        intake: Intake | None,
    ) -> TopicSubscription[M]:
        node = self._identity
        subscription = TopicSubscription(
            self.session,
            endpoint_token(node.namespace, node.name, "sub", message_type, depth, node.resolve(topic)),
            message_type,
            turn,
            callback,
            self._troubles.handler(callback),
            partial(self._troubles.malformed, self.session),
            intake,
        )
        self._ends.add_subscription(subscription)
        return subscription

    def _intake(self, topic: str, sole_source: Callable[[], str] | None) -> Intake:
        """What examines the messages of a topic, and tells of those that are left out."""

        def wanted() -> str:
            name = sole_source() if sole_source is not None else ""
            return name if name in ("", PLAIN) else self._identity.absolute(name)

        def tell(sender: str, count: int) -> None:
            self._troubles.left_out(topic, wanted(), sender, count)

        return Intake(self.session, topic, wanted if sole_source is not None else None, tell, self._clock)
