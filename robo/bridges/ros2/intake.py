"""What comes from one network: the messages of some topics, and what latched publishers have kept."""

import threading
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import zenoh

from robo.bridges.ros2.tally import Tally
from robo.wire import names
from robo.wire.targets import OF_ALL

MOST_ROUTES = 2_000
"""Topics that cross."""
SLOTS = 1_024
"""Messages that may wait until they are converted; of more the oldest are lost, and counted."""
LARGE = 16_384
"""Bytes: so large a message is not converted where nobody on the other side listens."""
_KEPT_WITHIN = 2.0
"""How long latched publishers may take to answer, s."""


class Intake:
    """The messages of some topics, each handed on once, and one after the other where one pattern has found them."""

    def __init__(
        self,
        session: zenoh.Session,
        patterns: Iterable[str],
        take: Callable[[str, zenoh.Sample], None],
        tally: Tally,
        thread: str,
        *,
        local: bool = False,
    ) -> None:
        """
        Args:
            session: the network.
            patterns: of the topics' keys.
            take: gets each message with its key; any thread may call it.
            tally: is told of what it has raised.
            thread: what the threads are called.
            local: whether only what this session itself says counts.
        """
        self._session, self._take, self._tally, self._name = session, take, tally, thread
        self._origin = zenoh.Locality.SESSION_LOCAL if local else zenoh.Locality.ANY
        self._expressions = expressions(patterns)
        self._subscribers: list[Any] = []

    def start(self) -> None:
        """Begin to receive."""
        for number, expression in enumerate(self._expressions):
            channel: zenoh.handlers.RingChannel[zenoh.Sample] = zenoh.handlers.RingChannel(SLOTS)
            subscriber = self._session.declare_subscriber(expression, channel, allowed_origin=self._origin)
            self._subscribers.append(subscriber)
            threading.Thread(
                target=self._receive, args=(number, subscriber.handler), name=self._name, daemon=True
            ).start()

    def close(self) -> None:
        """Receive no more."""
        for subscriber in self._subscribers:
            subscriber.undeclare()

    def _receive(self, number: int, handler: Any) -> None:
        mine: dict[str, bool] = {}
        recv = handler.recv
        while True:
            try:
                sample = recv()
            except zenoh.ZError:
                return  # undeclared
            key = str(sample.key_expr)
            is_mine = mine.get(key)
            if is_mine is None:
                if len(mine) > MOST_ROUTES:
                    mine.clear()
                is_mine = mine[key] = first_of(self._expressions, key) == number
            if not is_mine or sample.kind != zenoh.SampleKind.PUT:
                continue
            try:
                self._take(key, sample)
            except Exception as error:  # of one topic: all others go on
                self._tally.fault(f"message {key}", f"/{key} does not cross: {type(error).__name__}: {error}")


def ask_kept(session: zenoh.Session, selector: str, tell: Callable[[zenoh.Sample], None]) -> None:
    """Ask latched publishers for the messages that they keep; they come on a thread of their own."""

    def hear(reply: zenoh.Reply) -> None:
        if reply.ok is not None and reply.ok.kind == zenoh.SampleKind.PUT:
            tell(reply.ok)

    session.get(selector, hear, timeout=_KEPT_WITHIN, accept_replies=zenoh.ReplyKeyExpr.ANY, **OF_ALL)


def expressions(patterns: Iterable[str]) -> list[zenoh.KeyExpr]:
    """Key expressions of patterns, without those that others include."""
    found: list[zenoh.KeyExpr] = []
    for pattern in sorted(set(patterns), key=lambda one: ("**" not in one, "*" not in one, one)):
        expression = zenoh.KeyExpr(names.key_of(pattern))
        if not any(other.includes(expression) for other in found):
            found.append(expression)
    return found


def first_of(among: Sequence[zenoh.KeyExpr], key: str) -> int:
    """The first of some expressions that a key fits: messages come once for each of them."""
    exact = zenoh.KeyExpr(key)
    return next((number for number, one in enumerate(among) if one.intersects(exact)), -1)
