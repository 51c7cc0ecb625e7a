"""Answering Zenoh queries, in order of arrival, on threads of the node's own."""

import logging
import threading
import time
from collections.abc import Callable, Iterable

import msgspec
import zenoh

from robo import codec

_logger = logging.getLogger("robo.queries")

MOST_WAITING = 10_000
"""Queries that may wait; further ones make their senders wait."""

MOST_WORKERS = 64
"""Handlers of one queryable that may wait for other services at the same time."""


class QueryLoop:
    """One queryable and the thread that answers its queries."""

    def __init__(self, session: zenoh.Session, key: str, answer: Callable[[zenoh.Query], None]) -> None:
        """`answer` is given each query, one after the other."""
        self._answer = answer
        self._name = key
        self._queryable = session.declare_queryable(key, zenoh.handlers.FifoChannel(MOST_WAITING), complete=True)
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
            with query:
                try:
                    self._answer(query)
                except Exception as error:  # whatever a request brings about, the next one is answered
                    reply_error(query, type(error).__name__, str(error))
                    _logger.exception("a query on %s failed", self._name)
            with self._lock:
                self._idle += 1

    def stop(self, timeout: float) -> bool:
        """Take no more queries. Returns whether the handlers came back within `timeout` seconds."""
        self._queryable.undeclare()
        others = [worker for worker in self._workers if worker is not threading.current_thread()]
        end = time.monotonic() + timeout
        for worker in others:
            worker.join(max(0.0, end - time.monotonic()))
        return not any(worker.is_alive() for worker in others)


class Fault(msgspec.Struct, frozen=True):
    """The payload of an error reply."""

    error: str
    """What kind: the name of the exception's class."""
    message: str


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
        return msgspec.msgpack.decode(reply.err.payload.to_bytes(), type=Fault)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None


def reply(query: zenoh.Query, key: str, value: object, encoding: str = codec.MSGPACK) -> None:
    """Answer a query with MessagePack."""
    query.reply(key, msgspec.msgpack.encode(value), encoding=encoding)


def reply_error(query: zenoh.Query, kind: str, message: str) -> None:
    """Answer a query with an error."""
    query.reply_err(msgspec.msgpack.encode(Fault(kind, message)), encoding=codec.MSGPACK)
