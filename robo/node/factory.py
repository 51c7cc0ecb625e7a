"""Making the live ends of a node that has joined the network."""

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from functools import partial, wraps
from typing import TYPE_CHECKING, Any, TypeVar

import msgspec
import zenoh

from robo.errors import ContractError
from robo.node.callables import check_plain, check_steps, is_async, takes_info
from robo.node.clock import Clock, SimClock
from robo.node.deadline import Deadline
from robo.node.endpoints import Endpoints, Interruptible
from robo.node.identity import Identity
from robo.node.intake import Intake
from robo.node.loops import TimerLoop, checked_period
from robo.node.message_info import PLAIN, MessageInfo
from robo.node.services import ServiceClient, ServiceServer, service_token
from robo.node.topics import TopicPublisher, TopicSubscription, endpoint_token
from robo.node.troubles import Troubles
from robo.node.turn import Turn, name_of
from robo.node.turns import Turns
from robo.wire.keys import EndpointToken, action_key
from robo.wire.qos import KEEP_ALL, Priority, QoS, Quality
from robo_messages import Clock as ClockMessage
from robo_messages import Message

if TYPE_CHECKING:
    from robo.node.action_client import ActionCaller
    from robo.node.action_server import ActionServer
    from robo.node.gate import Gate
    from robo.node.handler import Handling
    from robo.wire.actions import ActionTypes

M = TypeVar("M", bound=Message)
Q = TypeVar("Q", bound=Message)
A = TypeVar("A", bound=Message)


class EndpointFactory:
    """Makes ends under the node's names, whose callbacks take its turns, and adds them to its endpoints.

    Every method raises InvalidName where the name breaks the rules.
    """

    def __init__(
        self,
        session: zenoh.Session,
        identity: Identity,
        ends: Endpoints,
        turns: Turns,
        troubles: Troubles,
        clock: Clock,
        qualities: Mapping[str, Quality],
        gate: "Gate | None" = None,
    ) -> None:
        """`qualities` has by topic what is said of its ends over what they say themselves.

        With a `gate`, what is made works only while that is open.
        """
        self.session = session
        self._identity = identity
        self._ends = ends
        self._turns = turns
        self._troubles = troubles
        self._clock = clock
        self._gate = gate
        self._qualities = qualities

    def publisher(self, message_type: type[M], topic: str, qos: QoS) -> TopicPublisher[M]:
        """An end that publishes."""
        publisher = self._publisher(message_type, topic, qos)
        if self._gate is not None:
            publisher.publish = self._gate.publish(publisher.publish)
        return publisher

    def subscription(
        self,
        message_type: type[M],
        topic: str,
        callback: Callable[..., object],
        qos: QoS,
        sole_source: Callable[[], str] | None,
        turn: str = "",
    ) -> TopicSubscription[M]:
        """An end that subscribes; `callback`, `sole_source` and `turn` as for `Node.create_subscription`.

        Raises:
            ContractError: the callback yields, or there is a sole source and it takes no `MessageInfo`.
        """
        qos = self._over(self._identity.resolve(topic), qos).of_subscription()
        informed = takes_info(callback)
        examined = informed or qos.lifespan is not None
        if sole_source is not None and not informed:
            raise ContractError(f"{name_of(callback)}: a sole source needs a callback that takes a MessageInfo too")
        with ExitStack() as made:
            intake = self._intake(self._identity.resolve(topic), sole_source, qos.lifespan) if examined else None
            if intake is not None:
                made.callback(intake.close)
            taken = self._turns.of(turn, name_of(callback))
            called = self.plain(callback, taken)
            if intake is not None and not informed:
                called = _without_info(called)
            if self._gate is not None:
                _check_kept(callback, qos, turn)
                kept = qos.depth if qos.latched else 0
                called = self._gate.subscriber(called, kept, self._troubles.handler(callback))
            subscription = self._subscription(message_type, topic, called, qos, taken, intake)
            made.pop_all()
        if qos.deadline is not None:
            self._watch(subscription, qos.deadline)
        return subscription

    def timer(
        self, period: float | Callable[[], float], callback: Callable[[], object], clock: Clock, turn: str = ""
    ) -> TimerLoop:
        """A timer; the arguments as for `Node.create_timer`.

        Raises:
            ContractError: the period is not 1e-6 to 1e9 s, or the callback yields.
        """
        ask = period if callable(period) else lambda: period
        checked_period(ask())
        name, handler = name_of(callback), self._troubles.handler(callback)
        taken = self._turns.of(turn, name)
        called = self.plain(callback, taken)
        if self._gate is not None:
            called = self._gate.ticker(called)
        timer = TimerLoop(name, ask, taken, called, handler, clock)
        self._ends.add_timer(timer)
        return timer

    def service(
        self, request_type: type[Q], response_type: type[A], name: str, handler: Callable[[Q], Any], turn: str = ""
    ) -> ServiceServer[Q, A]:
        """An end that serves.

        Raises:
            ContractError: the handler yields.
        """
        node = self._identity
        token = service_token(node.namespace, node.name, "srv", request_type, response_type, node.resolve(name))
        on_error = self._troubles.handler(handler)
        taken = self._turns.of(turn, name_of(handler))
        called = self.plain(handler, taken)
        if self._gate is not None:
            called = self._gate.handler(called)
        service = ServiceServer(self.session, token, request_type, response_type, taken, called, on_error)
        self._ends.add_service(service)
        return service

    def client(
        self, request_type: type[Q], response_type: type[A], name: str, timeout: float, priority: Priority
    ) -> ServiceClient[Q, A]:
        """An end that calls a service."""
        node = self._identity
        token = service_token(node.namespace, node.name, "cli", request_type, response_type, node.resolve(name))
        client = ServiceClient(self.session, token, request_type, response_type, timeout, priority)
        self._ends.add_client(client)
        return client

    def _over(self, key: str, qos: QoS) -> QoS:
        quality = self._qualities.get(key)
        return qos if quality is None else quality.over(qos)

    # What runs actions is imported by nodes that have some: the others save the time and the memory.

    def action(self, types: "ActionTypes", name: str, handling: "Handling", turn: str = "") -> "ActionServer":
        """An end that executes an action.

        Raises:
            ContractError: the handler is async and yields, or what is asked before a goal is taken is async.
        """
        from robo.node.action_server import ActionServer
        from robo_messages.action import GoalStatusArray

        taken, on_error = self._turns.of(turn, name_of(handling.handler)), self._troubles.handler(handling.handler)
        if check_steps(handling.handler):
            coroutines = self._ends.coroutines(self._new_coroutines)
            handling = msgspec.structs.replace(
                handling, begin=coroutines.plain(handling.handler, taken, on_error).begin
            )
        if handling.accept is not None:
            check_plain(handling.accept)
        if self._gate is not None:
            handling = msgspec.structs.replace(handling, why_not=self._gate.why_shut)
        node, key = self._identity, self._identity.resolve(name)
        token = EndpointToken(node.namespace, node.name, "act", types.name, QoS(depth=KEEP_ALL), key)
        feedback = self._publisher(types.feedback_message, f"/{action_key(key, 'feedback')}", QoS.DEFAULT)
        status = self._publisher(GoalStatusArray, f"/{action_key(key, 'status')}", QoS.LATCHED)
        publish = feedback.publish, status.publish
        action = ActionServer(self.session, token, types, handling, taken, self._clock, *publish, on_error)
        if self._gate is not None:
            self._gate.when_shut(action.look)
        self._ends.add_action(action)
        return action

    def action_client(self, types: "ActionTypes", name: str, timeout: float) -> "ActionCaller[Any, Any, Any]":
        """An end that sends goals to an action."""
        from robo.node.action_client import ActionCaller

        node, key = self._identity, self._identity.resolve(name)
        token = EndpointToken(node.namespace, node.name, "acl", types.name, QoS(depth=KEEP_ALL), key)
        client: ActionCaller[Any, Any, Any] = ActionCaller(self.session, token, types, timeout, self._clock)
        self._ends.add_action_client(client)
        topic = f"/{action_key(key, 'feedback')}"
        self.subscription(types.feedback_message, topic, client.take_feedback, QoS.DEFAULT, None)
        return client

    def plain(self, callback: Callable[..., Any], turn: Turn) -> Callable[..., Any]:
        """A callback as its thread calls it: as it is, or, if it is async, as what has the loop run it.

        Raises:
            ContractError: it yields.
        """
        if not is_async(callback):
            return callback
        return self._ends.coroutines(self._new_coroutines).plain(callback, turn, self._troubles.handler(callback))

    def _new_coroutines(self) -> Interruptible:
        from robo.node.coroutines import Coroutines  # asyncio is for nodes that use it

        return Coroutines(self._clock, self._troubles.held_loop)

    def follow_clock(self, clock: SimClock) -> None:
        """Take the time from the topic `/clock`, past the callbacks: these may wait for it."""

        def follow(message: ClockMessage) -> None:
            clock.advance(message.clock.to_nanoseconds())

        self._subscription(ClockMessage, "/clock", follow, QoS(depth=1), Turn(self._turns.own.on_death), None)

    def _publisher(self, message_type: type[M], topic: str, qos: QoS) -> TopicPublisher[M]:
        node, key = self._identity, self._identity.resolve(topic)
        qos = self._over(key, qos).of_publisher()
        token = endpoint_token(node.namespace, node.name, "pub", message_type, qos, key)
        publisher = TopicPublisher(self.session, token, message_type, self._clock)
        self._ends.add_publisher(publisher)
        return publisher

    def _subscription(
        self,
        message_type: type[M],
        topic: str,
        callback: Callable[..., object],
        qos: QoS,
        turn: Turn,
        intake: Intake | None,
    ) -> TopicSubscription[M]:
        node = self._identity
        subscription = TopicSubscription(
            self.session,
            endpoint_token(node.namespace, node.name, "sub", message_type, qos, node.resolve(topic)),
            message_type,
            turn,
            callback,
            self._troubles.handler(callback),
            partial(self._troubles.malformed, self.session),
            intake,
        )
        self._ends.add_subscription(subscription)
        return subscription

    def _watch(self, subscription: TopicSubscription[M], deadline: float) -> None:
        """Tell when messages do not come as often as is needed, whatever the callbacks do meanwhile."""
        tell = partial(self._troubles.late, subscription.topic, deadline)
        look = Deadline(lambda: subscription.received, tell).look
        on_error, turn = self._troubles.handler(look), Turn(self._turns.own.on_death)
        self._ends.add_timer(TimerLoop(name_of(look), lambda: deadline, turn, look, on_error, self._clock))

    def _intake(self, topic: str, sole_source: Callable[[], str] | None, lifespan: float | None) -> Intake:
        """What examines the messages of a topic, and tells of those that are left out."""

        def wanted() -> str:
            name = sole_source() if sole_source is not None else ""
            return name if name in ("", PLAIN) else self._identity.absolute(name)

        def tell(sender: str, count: int) -> None:
            self._troubles.left_out(topic, wanted(), sender, count)

        return Intake(self.session, topic, wanted if sole_source is not None else None, tell, self._clock, lifespan)


def _without_info(callback: Callable[..., object]) -> Callable[..., object]:
    """A callback that takes the message alone, for a subscription that wants to know more of it than the callback."""

    @wraps(callback)
    def take(message: Message, _info: MessageInfo) -> object:
        return callback(message)

    return take


def _check_kept(callback: Callable[..., object], qos: QoS, turn: str) -> None:
    """Refuse what a managed node cannot keep of a topic for when it is active again.

    Raises:
        ContractError: the topic is latched, and its callback has a turn of its own or there would be no end of it.
    """
    if turn and qos.latched:
        raise ContractError(
            f"{name_of(callback)}: a latched topic of a managed node takes the node's turn, in which it is"
            " told again when the node becomes active; leave out turn"
        )
    if qos.latched and qos.depth == KEEP_ALL:
        raise ContractError(
            f"{name_of(callback)}: a managed node keeps what a latched topic says for when it is active"
            " again; depth=KEEP_ALL would keep it all for ever: say how many"
        )
