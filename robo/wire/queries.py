"""Answering Zenoh queries, in order of arrival, on threads of the node's own.

A query may hold wildcards, and whoever looks around asks `**`. What acts (a service, a parameter that is
set, a node that is stopped) answers a query on exactly its key; what only tells answers any that reaches it.
"""

import logging
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack, suppress

import msgspec
import zenoh

from robo import errors
from robo.errors import RoboError, RunError
from robo.text.brief import brief_lines
from robo.text.readable import readable
from robo.text.suggestions import suggest
from robo.text.unreadable import UNREADABLE
from robo.wire import codec

_logger = logging.getLogger("robo.wire.queries")

MOST_WAITING = 1_000
"""Queries of one queryable that may wait. Of more the oldest get no answer: nothing else is held up by them."""

MOST_WORKERS = 64
"""Handlers of one queryable that may wait for other services at the same time."""

MOST_IDLE = 4
"""Threads of one queryable that are kept for the next such time."""


def reached(asked: str, acts: Iterable[str], tells: Iterable[str]) -> list[str]:
    """The keys of a queryable on which a query is answered.

    Args:
        asked: the key of the query itself, wildcards included.
        acts: keys on which something is done.
        tells: keys on which something is only read.
    """
    if "*" not in asked:
        return [key for key in (*acts, *tells) if key == asked]
    expression = zenoh.KeyExpr(asked)
    return [key for key in tells if expression.intersects(zenoh.KeyExpr(key))]


class QueryLoop:
    """One queryable and the thread that answers its queries. Every queryable of robo is one of these."""

    def __init__(
        self,
        session: zenoh.Session,
        key: str,
        answer: Callable[[zenoh.Query, str], "bool | None"],
        *,
        acts: Sequence[str] = (),
        tells: Sequence[str] = (),
        complete: bool = True,
    ) -> None:
        """
        Args:
            session: the network.
            key: of the queryable: of all that it answers, `r1/base/parameters/*`.
            answer: is given each query with the key on which it is to be answered, one after the other; where it
                returns true it keeps the query, and is to answer and `drop` it later.
            acts: keys on which something is done; a query names them exactly.
            tells: keys on which something is only read; a query with wildcards reads them as well.
            complete: whether one of several queryables of this key is enough for whoever asks any of them.
        """
        self._answer = answer
        self._name = key
        self._acts, self._tells = acts, tells
        self._queryable = session.declare_queryable(key, zenoh.handlers.RingChannel(MOST_WAITING), complete=complete)
        self._handler = self._queryable.handler
        self._workers: list[threading.Thread] = []
        self._idle = 0
        self._lock = threading.Lock()

    def start(self) -> None:
        """Begin to answer."""
        self.spare()

    def spare(self) -> None:
        """Make sure that somebody takes the next query while the present handler waits for something."""
        with self._lock:
            if self._idle or len(self._workers) >= MOST_WORKERS:
                return
            worker = threading.Thread(target=self._work, name=f"robo-{self._name}", daemon=True)
            self._workers.append(worker)
            self._idle += 1
        worker.start()

    def _work(self) -> None:
        while True:
            try:
                query = self._handler.recv()
            except zenoh.ZError:
                return  # undeclared
            with self._lock:
                self._idle -= 1
            with ExitStack() as over:
                over.enter_context(query)
                if self._answer_all(query):
                    over.pop_all()
            with self._lock:
                if self._idle >= MOST_IDLE:
                    self._workers.remove(threading.current_thread())
                    return
                self._idle += 1

    def _answer_all(self, query: zenoh.Query) -> bool:
        """Answer a query on all the keys that it reaches. Returns whether it is kept, to be answered later."""
        asked = str(query.key_expr)
        keys = reached(asked, self._acts, self._tells)
        kept = False
        with suppress(zenoh.ZError):  # whoever asked may be gone, or this node may be leaving
            for key in keys:
                try:
                    kept |= bool(self._answer(query, key))
                except Exception as error:  # whatever a request brings about, the next one is answered
                    _logger.exception("a query on %s failed", self._name)
                    reply_error(query, Fault.of(error))
            if not keys:
                reply_error(query, self._refusal(asked))
        return kept

    def _refusal(self, asked: str) -> "Fault":
        """What is said to a query that reaches the queryable and none of its keys."""
        if "*" in asked:
            named = ", ".join(self._acts)
            return Fault(
                "TooWide", f"a query with wildcards runs nothing; ask for exactly the key that is meant: {named}"
            )
        there = [key.rpartition("/")[2] for key in (*self._tells, *self._acts)]
        return Fault("UsageError", f"nothing is answered on {asked}; {suggest(asked.rpartition('/')[2], there)}")

    def stop(self, timeout: float) -> bool:
        """Take no more queries. Returns whether the handlers came back within `timeout` seconds."""
        self._queryable.undeclare()
        with self._lock:
            others = [worker for worker in self._workers if worker is not threading.current_thread()]
        end = time.monotonic() + timeout
        for worker in others:
            if worker.is_alive():  # Ctrl-C may have come while it was being started
                worker.join(max(0.0, end - time.monotonic()))
        return not any(worker.is_alive() for worker in others)


class Fault(msgspec.Struct, frozen=True):
    """The payload of an error reply."""

    error: str
    """What kind: the name of the exception's class."""
    message: str

    @classmethod
    def of(cls, error: BaseException) -> "Fault":
        """What is told of an exception."""
        return cls(type(error).__name__, str(error))

    def raised(self) -> RoboError:
        """The error again: of its own class where that is one of robo's, else a RunError."""
        return _ERRORS.get(self.error, RunError)(self.message)


_ERRORS: dict[str, type[RoboError]] = {
    name: kind for name, kind in vars(errors).items() if isinstance(kind, type) and issubclass(kind, RoboError)
}
del _ERRORS[RoboError.__name__]  # it says no more than a RunError, which the tools' callers wait for


def first_answer(replies: Iterable[zenoh.Reply]) -> zenoh.Sample | Fault | None:
    """The first reply to a query, or the error in its place; None where nobody answered in time."""
    for one in replies:
        if one.ok is not None:
            return one.ok
        if one.err is not None:
            return read_fault(one)
    return None


def read_fault(reply: zenoh.Reply) -> Fault | None:
    """The error in a reply; None for Zenoh's own word for a server that did not answer in time."""
    if reply.err is None:
        return None
    try:
        return msgspec.msgpack.decode(reply.err.payload.to_bytes(), type=readable(Fault))
    except UNREADABLE:
        return None


def reply(query: zenoh.Query, key: str, value: object, encoding: str = codec.MSGPACK) -> None:
    """Answer a query with MessagePack."""
    query.reply(key, msgspec.msgpack.encode(value), encoding=encoding)


def reply_error(query: zenoh.Query, fault: Fault) -> None:
    """Answer a query with an error."""
    # What a message quotes may be long, and may hold half a surrogate pair, which cannot be sent.
    text = brief_lines(fault.message).encode("utf-8", "replace").decode()
    query.reply_err(msgspec.msgpack.encode(Fault(fault.error, text)), encoding=codec.MSGPACK)
