"""What the nodes of one test share: their network, their time, and what becomes of their mistakes."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from typing import Any

import zenoh

from robo.node import log
from robo.node.node import Node
from robo.node.topics import TopicPublisher
from robo.testing.clock import Clock
from robo.testing.session import NodeSession, Note
from robo.testing.stepper import Hung, Stepper
from robo.wire.qos import Quality

CLOSE_TIMEOUT = 1.0
"""How long callbacks have to come back at the end of a test, s; the whole test has failed by then if one hung."""


class NodeEnded(AssertionError):
    """A node ended by itself, and the test did not ask for it."""


class _Errors(logging.Handler):
    """Keeps the exceptions that a node tells in its log: what killed a thread, and those of its callbacks."""

    def __init__(self, errors: list[BaseException]) -> None:
        super().__init__(logging.ERROR)
        self._errors = errors

    def emit(self, record: logging.LogRecord) -> None:
        if record.exc_info and record.exc_info[1] is not None:
            self.keep(record.exc_info[1])

    def keep(self, error: BaseException) -> None:
        """Keep one, unless it is there."""
        if not any(error is one for one in self._errors):
            self._errors.append(error)


class Seat:
    """One node under test, as the bench knows it."""

    def __init__(self, node: Node, session: NodeSession) -> None:
        self.node = node
        self.session = session
        self.errors: list[BaseException] = []
        """What its callbacks have raised and nobody has been told."""
        self.ended = False
        """Whether it has left the network."""
        self.end_known = False
        """Whether the test has been told, or has asked, how it ended."""
        self._handler = _Errors(self.errors)
        self.node.logger.logger.addHandler(self._handler)
        self.node._troubles.listener = self._handler.keep  # the log leaves out what is like the one before

    def close(self, timeout: float) -> None:
        """Let it leave the network."""
        if not self.ended:
            self.ended = True
            self.node.close(timeout)
        self.node.logger.logger.removeHandler(self._handler)


class Bench:
    """Runs nodes in the test's process, one callback at a time."""

    def __init__(self, session: zenoh.Session, patience: float) -> None:
        """
        Args:
            session: the network of all of them.
            patience: how long a callback may take, s of the wall clock.
        """
        self.network = session
        self.stepper = Stepper(patience)
        self.clock = Clock(self.stepper, self.settle)
        self.senders: list[TopicPublisher[Any]] = []
        """In whose names tests send."""
        self.seats: list[Seat] = []
        """Of the nodes that have started."""
        self._hung = False
        self._level = logging.getLogger(log.ROOT).level

    def start(
        self,
        node_class: type[Node],
        options: dict[str, Any],
        *,
        autostart: bool = True,
        note: Note | None = None,
        qualities: Mapping[str, Quality] | None = None,
    ) -> Seat:
        """Make a node and start it; a managed one is brought to active, unless `autostart` is false.

        Args:
            node_class: its class.
            options: what it is made with.
            autostart: whether a managed one comes to active.
            note: takes what it publishes, see `NodeSession`.
            qualities: what its launch says of its topics.

        Raises:
            Exception: what the node raised while it was made or started; then nothing of it runs.
        """
        # The usual level of a node, unless the test has asked for another one; caplog has its own say above it.
        logger = logging.getLogger(log.ROOT)
        if logger.level == logging.NOTSET:
            logger.setLevel(logging.INFO)
        logger.propagate = True
        session = NodeSession(self.network, self.stepper, note)
        given: Any = session  # it is one in all that a node asks of a session
        seat = Seat(node_class(**options, session=given, clock=self.clock), session)
        seat.node.qualities = qualities or {}
        try:
            with self.stepper.held():
                seat.node.start(autostart=autostart)
        except BaseException:
            seat.ended = True
            seat.close(0)
            raise
        self.seats.append(seat)
        self.settle()
        return seat

    def settle(self, until: int = 0) -> None:
        """Let everything happen that is to happen until a time, ns.

        Raises:
            Hung: a callback does not come back.
            Exception: what a callback has raised.
        """
        self.settle_quietly(until)
        self.complain()

    def settle_quietly(self, until: int = 0) -> None:
        """The same without the errors of callbacks."""
        try:
            self.stepper.settle(until)
        except Hung as stuck:
            self._hung = True
            raise Hung("\n".join([*self._running(), str(stuck)])) from None
        over = [seat for seat in self.seats if seat.node.stopping and not seat.ended]
        for seat in over:  # as its process would end now
            seat.close(CLOSE_TIMEOUT)
        if over:
            self.settle_quietly()

    def complain(self) -> None:
        """Raise what a callback has raised and nobody has been told."""
        for seat in self.seats:
            if not seat.errors:
                continue
            seat.end_known = True
            error, *more = seat.errors
            seat.errors.clear()
            for other in more:
                error.add_note(f"then {seat.node.full_name} raised {type(other).__name__}: {other}")
            raise error

    def close(self) -> None:
        """End all nodes.

        Raises:
            NodeEnded: one had ended by itself with an exit code other than 0, and the test did not ask for it.
            Exception: what a callback has raised meanwhile.
        """
        with ExitStack() as ends:
            ends.callback(logging.getLogger(log.ROOT).setLevel, self._level)
            for sender in self.senders:
                ends.callback(sender.undeclare)
            for seat in self.seats:
                ends.callback(seat.close, 0.0 if self._hung else CLOSE_TIMEOUT)
        if self._hung:
            return  # the test has failed with that; what came of it is no news
        self.complain()
        for seat in self.seats:
            if seat.node.exit_code and not seat.end_known:
                raise NodeEnded(f"{seat.node.full_name} ended with exit code {seat.node.exit_code}; its log says why")

    def wait(self, seconds: float) -> None:
        """Let the wall clock go on: threads that a node has started itself are not stepped."""
        time.sleep(seconds)

    def _running(self) -> list[str]:
        told = []
        for seat in self.seats:
            with suppress(Exception):
                status = seat.node.status
                if status.running:
                    told.append(f"{status.node}: {status.running} has been running for {status.running_for:.1f} s")
        return told
