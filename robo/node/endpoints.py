"""The live ends of a node: what it publishes, subscribes, serves and calls, and its timers, as one."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any, Protocol

from robo.node.callables import AsyncCallback
from robo.node.loops import TimerLoop
from robo.node.services import ServiceClient, ServiceServer
from robo.node.topics import TopicPublisher, TopicSubscription
from robo.node.turn import Turn
from robo.wire.keys import EndpointToken

if TYPE_CHECKING:
    from robo.node.action_client import ActionCaller
    from robo.node.action_server import ActionServer


class Stoppable(Protocol):
    """What runs callbacks, or answers queries, on a thread of its own."""

    def stop(self, timeout: float) -> bool:
        """End. Returns whether the callback came back within `timeout` seconds."""


class Interruptible(Stoppable, Protocol):
    """What runs async callbacks."""

    def plain(
        self, callback: Callable[..., Any], turn: Turn, on_error: Callable[[BaseException], None]
    ) -> AsyncCallback:
        """An async callback as a function that any thread may call."""

    def interrupt(self) -> None:
        """Cancel all that runs, and take nothing new."""


class Startable(Stoppable, Protocol):
    """What begins when the node does."""

    def start(self) -> None:
        """Begin to call the callback."""


class Announced(Protocol):
    """What others see of an end."""

    announced: EndpointToken


class Caller(Protocol):
    """What asks other nodes."""

    def abandon(self) -> None:
        """Let who waits for an answer go on at once."""

    def close(self) -> None:
        """Leave the network."""


class Endpoints:
    """Begins the ends of a node together and ends them together; any thread may add one meanwhile."""

    def __init__(self) -> None:
        self.publishers: list[TopicPublisher[Any]] = []
        self.subscriptions: list[TopicSubscription[Any]] = []
        self.timers: list[TimerLoop] = []
        self.services: list[ServiceServer[Any, Any]] = []
        self.clients: list[ServiceClient[Any, Any]] = []
        self.actions: list[ActionServer] = []
        self.action_clients: list[ActionCaller[Any, Any, Any]] = []
        self._others: list[Stoppable] = []
        self._coroutines: Interruptible | None = None
        self._begun = False
        self._lock = threading.Lock()

    def add_publisher(self, publisher: TopicPublisher[Any]) -> None:
        """Take in a publisher, which works at once."""
        self.publishers.append(publisher)

    def add_client(self, client: ServiceClient[Any, Any]) -> None:
        """Take in a client, which works at once."""
        self.clients.append(client)

    def add_service(self, service: ServiceServer[Any, Any]) -> None:
        """Take in a service, which answers already."""
        self.services.append(service)

    def add_subscription(self, subscription: TopicSubscription[Any]) -> None:
        """Take in a subscription; it begins when the others do, or at once."""
        self._add(self.subscriptions, subscription)

    def add_timer(self, timer: TimerLoop) -> None:
        """Take in a timer; it begins when the others do, or at once."""
        self._add(self.timers, timer)

    def add_action(self, action: ActionServer) -> None:
        """Take in an action; its handler begins to run when the others do, or at once."""
        self._add(self.actions, action)

    def add_action_client(self, client: ActionCaller[Any, Any, Any]) -> None:
        """Take in a client of an action, which works at once."""
        self.action_clients.append(client)

    def add_other(self, loop: Stoppable) -> None:
        """Take in what answers already and is to be stopped with the callbacks."""
        self._others.append(loop)

    def coroutines(self, make: Callable[[], Interruptible]) -> Interruptible:
        """What runs the async callbacks of the node, made for the first one."""
        with self._lock:
            if self._coroutines is None:
                self._coroutines = make()
            return self._coroutines

    def interrupt(self) -> None:
        """Let nobody wait for others any more, and cancel the async callbacks: those of actions as ends of goals."""
        clients: list[Caller] = [*self.clients, *self.action_clients]
        for client in clients:
            client.abandon()
        if self._coroutines is not None:
            for action in self.actions:
                action.interrupt()
            self._coroutines.interrupt()

    def announced(self) -> list[EndpointToken]:
        """What is announced of all of them."""
        with self._lock:
            topics: list[Announced] = [*self.publishers, *self.subscriptions]
            served: list[Announced] = [*self.services, *self.actions]
            called: list[Announced] = [*self.clients, *self.action_clients]
            return [one.announced for one in (*topics, *served, *called)]

    def begin(self) -> None:
        """Begin to run callbacks: the subscriptions' first, then the timers'."""
        with self._lock:
            self._begun = True
            waiting: list[Startable] = [*self.subscriptions, *self.actions, *self.timers]
        for loop in waiting:
            loop.start()

    def drop(self, timer: TimerLoop) -> None:
        """End a timer that is no longer needed, without waiting for its callback."""
        self.timers.remove(timer)
        timer.stop(0)

    def stop(self, deadline: float, now: Callable[[], float] = time.monotonic) -> bool:
        """End all callbacks, and let those that run return until `deadline`, by `now`, s.

        Publishers, and clients as far as an answer is under way, still work.

        Returns:
            Whether all callbacks came back.
        """
        with self._lock:
            self._begun = False
            # Handlers of actions first: what they have to put in order may need all the others.
            loops: list[Stoppable] = [*self.actions, *self.timers, *self.subscriptions, *self.services, *self._others]
        if self._coroutines is not None:
            loops.append(self._coroutines)
        self.interrupt()
        # One after the other against one deadline: each is told to stop, be there time left to wait for it or not.
        returned = [loop.stop(max(0.0, deadline - now())) for loop in loops]
        return all(returned)

    def withdraw(self) -> None:
        """Take the publishers and clients off the network."""
        with ExitStack() as ends:  # each of them, should one fail
            for publisher in self.publishers:
                ends.callback(publisher.undeclare)
            callers: list[Caller] = [*self.clients, *self.action_clients]
            for client in callers:
                ends.callback(client.close)

    def _add(self, ends: list[Any], loop: Startable) -> None:
        with self._lock:
            ends.append(loop)
            begun = self._begun
        if begun:
            loop.start()
