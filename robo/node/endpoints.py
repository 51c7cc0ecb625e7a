"""The live ends of a node: what it publishes, subscribes, serves and calls, and its timers, as one."""

import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any, Protocol

from robo.node.loops import TimerLoop
from robo.node.services import ServiceClient, ServiceServer
from robo.node.topics import TopicPublisher, TopicSubscription


class Stoppable(Protocol):
    """What runs callbacks, or answers queries, on a thread of its own."""

    def stop(self, timeout: float) -> bool:
        """End. Returns whether the callback came back within `timeout` seconds."""


class Startable(Stoppable, Protocol):
    """What begins when the node does."""

    def start(self) -> None:
        """Begin to call the callback."""


class Endpoints:
    """Begins the ends of a node together and ends them together; any thread may add one meanwhile."""

    def __init__(self) -> None:
        self.publishers: list[TopicPublisher[Any]] = []
        self.subscriptions: list[TopicSubscription[Any]] = []
        self.timers: list[TimerLoop] = []
        self.services: list[ServiceServer[Any, Any]] = []
        self.clients: list[ServiceClient[Any, Any]] = []
        self._others: list[Stoppable] = []
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

    def add_other(self, loop: Stoppable) -> None:
        """Take in what answers already and is to be stopped with the callbacks."""
        self._others.append(loop)

    def begin(self) -> None:
        """Begin to run callbacks: the subscriptions' first, then the timers'."""
        with self._lock:
            self._begun = True
            waiting: list[Startable] = [*self.subscriptions, *self.timers]
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
            loops: list[Stoppable] = [*self.timers, *self.subscriptions, *self.services, *self._others]
        for client in list(self.clients):
            client.abandon()
        # One after the other against one deadline: each is told to stop, be there time left to wait for it or not.
        returned = [loop.stop(max(0.0, deadline - now())) for loop in loops]
        return all(returned)

    def withdraw(self) -> None:
        """Take the publishers and clients off the network."""
        with ExitStack() as ends:  # each of them, should one fail
            for publisher in self.publishers:
                ends.callback(publisher.undeclare)
            for client in self.clients:
                ends.callback(client.close)

    def _add(self, ends: list[Any], loop: Startable) -> None:
        with self._lock:
            ends.append(loop)
            begun = self._begun
        if begun:
            loop.start()
