"""A node under test, in the test's own process."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Mapping
from typing import Any, Generic, TypeVar, cast, overload

import msgspec
import zenoh

import robo_messages
from robo.errors import ParameterError
from robo.node.contract import check_constructor
from robo.node.declare import Publisher
from robo.node.node import Node
from robo.node.topics import TopicPublisher, endpoint_token
from robo.testing.bench import CLOSE_TIMEOUT, Bench, NodeEnded, Seat
from robo.testing.call import Call
from robo.testing.goal import Goal
from robo.testing.session import NodeSession
from robo.text.readable import readable
from robo.text.suggestions import suggest
from robo.wire import codec, keys, names
from robo.wire.qos import QoS
from robo.wire.reports import Result
from robo_messages import Message

M = TypeVar("M", bound=Message)
N = TypeVar("N", bound=Node)

SENDER = "test"
"""The name of the node in whose name a test sends."""


class NotThere(AssertionError):
    """The node under test has no such topic or service."""


class NodeUnderTest(Generic[N]):
    """A node that runs in the test's process.

    Each method returns when all callbacks are done that follow from it, and raises what a callback raised.
    Names are relative to the node's namespace and remapped, as in the node itself.
    """

    def __init__(self, bench: Bench, seat: Seat, node: N) -> None:
        self.node = node
        """The node itself."""
        self._bench = bench
        self._seat = seat
        self._senders: dict[tuple[str, str, type[Message]], TopicPublisher[Any]] = {}
        self._numbers = itertools.count(1)

    def send(self, topic: str, message: Message, *, age: float = 0.0, source: str | None = SENDER) -> None:
        """Publish a message to the node, as another one would.

        Args:
            topic: which one the node subscribes to.
            message: what to send.
            age: how long ago it was said, s.
            source: the name of the node that sends it; None for a plain Zenoh client, which says no name.

        Raises:
            NotThere: the node does not subscribe to that topic.
            TypeError: it subscribes to it with another type.
        """
        key = self._subscribed(topic, type(message))
        with self._bench.stepper.held():
            if source is None:
                self._put(key, message, age)
            else:
                self._sender(source, key, type(message)).publish(message, age)
        self._bench.settle()

    @overload
    def published(self, topic: Publisher[M]) -> list[M]: ...
    @overload
    def published(self, topic: str) -> list[Any]: ...
    def published(self, topic: str | Publisher[M]) -> list[Any]:
        """What the node has published so far, or since `clear`, in order.

        Args:
            topic: its name, or what declares it (`Gripper.grip`), by which a type checker knows the messages' type.

        Raises:
            NotThere: the node does not publish that topic.
        """
        self._bench.settle()
        return self._published(topic.topic if isinstance(topic, Publisher) else topic)

    def clear(self) -> None:
        """Forget what has been published so far."""
        self._bench.settle()
        self._seat.session.sent.clear()

    def wait_for(
        self, topic: str, condition: Callable[[Any], bool] = lambda _: True, timeout: float | None = None
    ) -> Any:
        """Wait for a message that comes from a thread of the node's own, which no clock of a test steps.

        Args:
            topic: as for `published`.
            condition: what the message has to fulfil.
            timeout: how long to wait, s of the wall clock; by default the clock's patience.

        Returns:
            The first such message, be it one that is there already.
        """
        timeout = self._bench.clock.patience if timeout is None else timeout
        end = time.monotonic() + timeout
        while True:
            for message in self.published(topic):
                if condition(message):
                    return message
            if time.monotonic() > end:
                raise AssertionError(f"{self.node.full_name} has not published it on {topic} within {timeout:g} s")
            self._bench.wait(0.002)

    def call(self, service: str, request: Message) -> Any:
        """Call a service of the node.

        Args:
            service: its name.
            request: what to ask.

        Returns:
            The answer.

        Raises:
            NotThere: the node has no such service.
            ServiceError: the handler raised; what it raised is the cause.
            StillWaiting: the handler waits for time to pass; then use `begin_call`.
        """
        return self.begin_call(service, request).result()

    def begin_call(self, service: str, request: Message) -> Call:
        """Call a service whose handler waits for time to pass: `clock.advance(…)`, then `result()` of what is returned.

        Raises:
            NotThere: the node has no such service.
        """
        node, key = self._living(), self.node.resolve(service)
        declared = {node.resolve(one.service): one for one in node.contract.services}
        if key not in self._seat.session.services:
            raise NotThere(f"{node.full_name} has no service {service}; {suggest(key, declared)}")
        if key in declared and not isinstance(request, declared[key].request_type):
            wanted = robo_messages.type_name(declared[key].request_type)
            raise TypeError(f"service {service} takes {wanted}, not {type(request).__name__}")
        return self._ask(key, msgspec.msgpack.encode(request), codec.encoding_of(type(request)))

    def change_state(self, transition: str) -> bool:
        """Take a managed node through a transition, as `robo lifecycle set` does.

        Args:
            transition: `configure`, `activate`, `deactivate`, `cleanup` or `shutdown`.

        Returns:
            Whether its hook succeeded.

        Raises:
            NotThere: it is no managed node.
            LifecycleError: there is no such transition in its present state; says which there are.
            Exception: what a hook raised.
        """
        from robo.node.managed import LifecycleNode
        from robo_messages import lifecycle

        node = self._living()
        if not isinstance(node, LifecycleNode):
            raise NotThere(f"{node.full_name} is a plain node; a managed one derives from LifecycleNode")
        node.check_transition(transition)
        request = lifecycle.ChangeState.Request(transition=lifecycle.Transition(label=transition))
        return bool(self.call("~/change_state", request).success)

    def send_goal(self, action: str, goal: Message) -> Goal:
        """Send a goal to an action of the node.

        Args:
            action: its name.
            goal: what to do.

        Returns:
            The goal, which the node has taken; `clock.advance(…)` lets its handler go on.

        Raises:
            NotThere: the node has no such action.
            ActionError: it refuses the goal.
        """
        node, key = self._living(), self.node.resolve(action)
        declared = {node.resolve(one.action): one.types for one in node.contract.actions}
        if key not in declared:
            raise NotThere(f"{node.full_name} has no action {action}; {suggest(key, declared)}")
        sent = Goal(declared[key], key, self._bench, self._seat, next(self._numbers))
        sent.send(goal)
        return sent

    def set(self, **values: object) -> None:
        """Change parameters, as `robo param set` does: all of them, or none.

        Raises:
            ParameterError: a name is unknown, a value does not fit, is read-only, or was refused.
        """
        node = self._living()
        key = keys.parameters_key(node.namespace, node.name, "set")
        call = self._ask(key, msgspec.msgpack.encode(values), codec.MSGPACK)
        self._bench.settle_quietly()
        if not call.done() or call._answer is None or call._answer.ok is None:
            call.result()  # which says why not
        else:
            result = msgspec.msgpack.decode(call._answer.ok.payload.to_bytes(), type=readable(Result))
            if not result.successful:
                self._seat.errors.clear()
                raise ParameterError(result.reason)
        self._bench.complain()

    def has_ended(self) -> bool:
        """Whether the node has ended: by `shutdown`, because its `main` returned, or because it died."""
        self._bench.settle_quietly()
        return self._seat.ended

    @property
    def exit_code(self) -> int:
        """With what its process would end. A node that ends otherwise than with 0 fails the test that never asks."""
        self._bench.settle_quietly()
        self._seat.end_known = True
        return self.node.exit_code

    def close(self) -> None:
        """End the node, as Ctrl-C does; at the end of the test this happens by itself."""
        self._bench.settle()
        self._seat.close(CLOSE_TIMEOUT)
        self._bench.settle()

    def _living(self) -> N:
        if self.has_ended():
            self._seat.end_known = True
            raise NodeEnded(f"{self.node.full_name} has ended, with exit code {self.node.exit_code}")
        return self.node

    def _ask(self, key: str, payload: bytes, encoding: str) -> Call:
        return Call.begin(self._bench, self._seat, next(self._numbers), key, payload, encoding)

    def _subscribed(self, topic: str, kind: type[Message]) -> str:
        node = self._living()
        key = node.resolve(topic)
        there = [expression for expression, inbox in self._seat.session.inboxes if not inbox.closed]
        if not any(zenoh.KeyExpr(expression).intersects(zenoh.KeyExpr(key)) for expression in there):
            raise NotThere(f"{node.full_name} does not subscribe to {topic}; {suggest(key, there)}")
        for declared in node.contract.subscriptions:
            if node.resolve(declared.topic) == key and not issubclass(kind, declared.message_type):
                wanted = robo_messages.type_name(declared.message_type)
                raise TypeError(f"{topic} takes {wanted}, not {kind.__name__}")
        return key

    def _put(self, key: str, message: Message, age: float) -> None:
        stamp = codec.pack_attachment(next(self._numbers), self._bench.clock.time_ns() - round(age * 1e9))
        payload, encoding = msgspec.msgpack.encode(message), codec.encoding_of(type(message))
        self._bench.network.put(key, payload, encoding=encoding, attachment=stamp)

    def _sender(self, source: str, key: str, kind: type[M]) -> TopicPublisher[M]:
        made = self._senders.get((source, key, kind))
        if made is None:
            session: Any = NodeSession(self._bench.network, self._bench.stepper)
            namespace, _, name = names.absolute(source, self.node.namespace)[1:].rpartition("/")
            token = endpoint_token(namespace, name, "pub", kind, QoS.DEFAULT, key)
            made = self._senders[source, key, kind] = TopicPublisher(session, token, kind, self._bench.clock)
            self._bench.senders.append(made)
        return cast(TopicPublisher[M], made)

    def _published(self, topic: str) -> list[Any]:
        session, key = self._seat.session, self.node.resolve(topic)
        if key not in session.topics:
            raise NotThere(f"{self.node.full_name} does not publish {topic}; {suggest(key, session.topics)}")
        return [
            robo_messages.decode(sent.payload, robo_messages.find_type(sent.type))
            for sent in session.sent
            if sent.key == key
        ]


class RunNode:
    """What `run_node` gives a test."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench

    def __call__(
        self,
        node_class: type[N],
        /,
        *,
        name: str | None = None,
        namespace: str = "",
        remap: Mapping[str, str] | None = None,
        parameters: Mapping[str, object] | None = None,
        autostart: bool = True,
        **values: object,
    ) -> NodeUnderTest[N]:
        """Make a node, start it, and wait until it has nothing left to do.

        Args:
            node_class: its class.
            name: the node's; by default the class's in snake_case.
            namespace: where its relative names live; by default the root.
            remap: other names for topics and services, from declared name to new name.
            parameters: values over the declared defaults, by name.
            autostart: whether a managed node is brought to active; else the test does it, with `change_state`.
            values: more of them: `rate=10.0`.

        Raises:
            RoboError: the class, a value or a name is wrong.
            Exception: what the node raised while it was made or started.
        """
        check_constructor(node_class)
        options = {
            "name": name,
            "namespace": namespace,
            "remappings": remap,
            "parameters": {**(parameters or {}), **values},
        }
        seat = self._bench.start(node_class, options, autostart=autostart)
        return NodeUnderTest(self._bench, seat, cast(N, seat.node))
