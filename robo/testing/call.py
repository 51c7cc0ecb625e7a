"""A question to a node under test, and its answer."""

from __future__ import annotations

from typing import Any

import zenoh

import robo_messages
from robo.errors import ServiceError
from robo.node import diagnostics
from robo.testing.bench import Bench, Seat
from robo.testing.clock import LONGEST
from robo.wire import codec
from robo.wire.queries import Fault, read_fault

_ANSWER_TIMEOUT = 3600.0
"""How long a question stays open, s: the patience of the bench ends long before."""


class StillWaiting(AssertionError):
    """What a test asked for does not come unless the test lets time pass."""


class Call:
    """A call of a service that may not have been answered yet."""

    def __init__(self, name: str, replies: Any, bench: Bench, seat: Seat) -> None:
        self._name = name
        self._replies = replies
        self._bench = bench
        self._seat = seat
        self._answer: zenoh.Reply | None = None

    @classmethod
    def begin(cls, bench: Bench, seat: Seat, number: int, key: str, payload: bytes, encoding: str) -> Call:
        """Ask a node.

        Args:
            bench: where it runs.
            seat: the node's.
            number: of the question.
            key: on which it answers.
            payload: what to ask.
            encoding: of the payload.
        """
        replies = bench.network.get(
            key,
            payload=payload,
            encoding=encoding,
            attachment=codec.pack_attachment(number, bench.clock.time_ns()),
            timeout=_ANSWER_TIMEOUT,
            consolidation=zenoh.ConsolidationMode.NONE,
        )
        return cls(key, replies, bench, seat)

    def done(self) -> bool:
        """Whether the answer is there."""
        if self._answer is None:
            try:
                self._answer = self._replies.try_recv()
            except zenoh.ZError:
                raise ServiceError(f"service {self._name}: its node went away without an answer") from None
        return self._answer is not None

    def result(self) -> Any:
        """The answer, as a message of the type that its node declared.

        Raises:
            ServiceError: the handler raised; what it raised is the cause.
            StillWaiting: the answer is not there, and comes only when time goes on.
        """
        self._bench.settle_quietly()
        if not self.done():
            text = f"service {self._name} has not answered; use begin_call(), and clock.advance() before result()"
            raise StillWaiting(f"{text}. {who_waits(self._bench)}")
        assert self._answer is not None
        sample = self._answer.ok
        if sample is None:
            fault = read_fault(self._answer) or Fault("ServiceTimeout", "no answer")
            text = f"service {self._name}: {fault.error}: {fault.message}"
            raise ServiceError(text, fault.error, fault.message) from self._cause(fault)
        self._bench.complain()
        return decoded(sample)

    @property
    def answer(self) -> zenoh.Reply | None:
        """The answer, if it is there, or the error in its place."""
        return self._answer if self.done() else None

    def _cause(self, fault: Fault) -> BaseException | None:
        """What the handler raised: it has been told with this."""
        for error in self._seat.errors:
            if type(error).__name__ == fault.error:
                self._seat.errors.remove(error)
                return error
        return None


def decoded(sample: zenoh.Sample) -> Any:
    """An answer, as a message of the type that it says it is."""
    payload, encoding = sample.payload.to_bytes(), str(sample.encoding)
    response = robo_messages.find_type(encoding.partition(";")[2])
    return codec.Decoder(response).decode(payload, encoding)


def who_waits(bench: Bench) -> str:
    """Which threads of nodes wait for time to pass, as a sentence."""
    asleep = [
        f"{name} for {left:g} s"
        for name, left in bench.stepper.sleepers()
        if left <= LONGEST and name not in diagnostics.THREADS
    ]
    return f"These wait for the time: {', '.join(asleep) or 'none'}"
