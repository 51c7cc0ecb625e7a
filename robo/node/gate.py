"""What of a managed node works only while it is active: its publishers and its callbacks."""

from collections import deque
from collections.abc import Callable
from functools import update_wrapper
from typing import Any, TypeVar

from robo.errors import NotActive
from robo.node.topics import Publish
from robo.node.turn import name_of
from robo_messages import Message

M = TypeVar("M", bound=Message)
Q = TypeVar("Q", bound=Message)
A = TypeVar("A", bound=Message)


class Gate:
    """Stands before the ends of one managed node. Only such a node has one. It is moved under the node's turn."""

    def __init__(self, state: Callable[[], str]) -> None:
        """`state` says in which state the node is, for those whose calls are refused."""
        self.for_callbacks = False
        """Whether it is open for messages, ticks and calls."""
        self.for_messages = False
        """Whether it is open for what the node publishes: from `on_activate` to the end of `on_deactivate`."""
        self._state = state
        self._latched: list[_Latched] = []
        self._on_shut: list[Callable[[], None]] = []

    def open(self) -> None:
        """Let callbacks run, first with what latched topics have said that the node does not know."""
        self.for_callbacks = True
        for topic in self._latched:
            topic.catch_up()

    def shut(self) -> None:
        """Let no callback run, and interrupt the goals that are handled."""
        self.for_callbacks = False
        for notice in self._on_shut:
            notice()

    def when_shut(self, notice: Callable[[], None]) -> None:
        """Have it told when callbacks are to run no longer."""
        self._on_shut.append(notice)

    def forget(self) -> None:
        """The node knows no more than at its start: what was latched is told to it again."""
        for topic in self._latched:
            topic.known = 0

    def publish(self, publish: Publish[M]) -> Publish[M]:
        """`publish` of a publisher: what comes while the gate is shut is dropped, and not counted."""

        def guarded(message: M, age: float = 0.0) -> None:
            if self.for_messages:
                publish(message, age)

        return guarded

    def subscriber(
        self, callback: Callable[..., Any], kept: int, on_error: Callable[[BaseException], None]
    ) -> Callable[..., Any]:
        """The callback of a subscription, which is not called while the gate is shut.

        Args:
            callback: of the node.
            kept: how many of the last messages are there for it when the gate opens.
            on_error: is told what it raises then.
        """
        if kept == 0:
            return self.ticker(callback)
        topic = _Latched(self, callback, kept, on_error)
        self._latched.append(topic)

        def guarded(*arguments: object) -> object:
            return topic.take(*arguments)

        return _named(guarded, callback)

    def ticker(self, callback: Callable[..., Any]) -> Callable[..., Any]:
        """The callback of a timer, which is not called while the gate is shut."""

        def guarded(*arguments: object) -> object:
            return callback(*arguments) if self.for_callbacks else None

        return _named(guarded, callback)

    def why_shut(self) -> str:
        """Why goals are not handled; empty while it is open."""
        return "" if self.for_callbacks else f"its node is {self._state()}"

    def handler(self, handler: Callable[[Q], A]) -> Callable[[Q], A]:
        """The handler of a service, in place of which the caller gets an error while the gate is shut."""

        def guarded(request: Q) -> A:
            if not self.for_callbacks:
                raise NotActive(f"the node is {self._state()}; it answers while it is active")
            return handler(request)

        return _named(guarded, handler)


class _Latched:
    """A subscription of a latched topic, whose messages come once and for all."""

    def __init__(
        self, gate: Gate, callback: Callable[..., Any], kept: int, on_error: Callable[[BaseException], None]
    ) -> None:
        self.known = 0
        """How many of the last messages the node has been told."""
        self._gate = gate
        self._callback = callback
        self._on_error = on_error
        self._last: deque[tuple[object, ...]] = deque(maxlen=kept)
        self._catching_up = False

    def take(self, *arguments: object) -> object:
        """Give the callback a message, now or when the gate opens."""
        falls_out = len(self._last) == self._last.maxlen
        self._last.append(arguments)
        if not self._gate.for_callbacks or self._catching_up:
            self.known = max(0, self.known - falls_out)
            return None
        self.known = len(self._last)
        return self._callback(*arguments)

    def catch_up(self) -> None:
        """Give the callback what it has not had."""
        if self._catching_up:  # the one who does goes on, also where the gate was shut meanwhile
            return
        self._catching_up = True
        while self.known < len(self._last) and self._gate.for_callbacks:
            self.known += 1
            try:
                self._callback(*self._last[self.known - 1])
            except BaseException as error:
                self._on_error(error)
        self._catching_up = False


def _named(guarded: Callable[..., Any], callback: Callable[..., Any]) -> Callable[..., Any]:
    """What stands in the place of a callback, under its name."""
    update_wrapper(guarded, callback)
    guarded.__name__ = name_of(callback)
    return guarded
