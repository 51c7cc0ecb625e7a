"""Answering Zenoh queries, in order of arrival, on threads of the node's own."""

import logging
import queue
import threading
from collections.abc import Callable

import msgspec
import zenoh

from robo import codec

_logger = logging.getLogger("robo.queries")

MOST_WAITING = 10_000
"""Queries that may wait; further ones are refused at once."""

MOST_WORKERS = 64
"""Handlers of one queryable that may wait for other services at the same time."""


class QueryLoop:
    """One queryable and the thread that answers its queries, which starts with the first of them."""

    def __init__(self, session: zenoh.Session, key: str, answer: Callable[[zenoh.Query], None]) -> None:
        """`answer` is given each query, one after the other."""
        self._answer = answer
        self._name = key
        self._waiting: queue.SimpleQueue[zenoh.Query | None] = queue.SimpleQueue()
        self._workers: list[threading.Thread] = []
        self._idle = 0
        self._lock = threading.Lock()
        # Zenoh's own thread only puts the query down: it never waits for a callback.
        self._queryable = session.declare_queryable(key, self._take_in, complete=True)

    def _take_in(self, query: zenoh.Query) -> None:
        if self._waiting.qsize() >= MOST_WAITING:
            reply_error(query, "Busy", f"{self._name}: more than {MOST_WAITING} requests wait")
            return
        self._waiting.put(query)
        if not self._workers:
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
            query = self._waiting.get()
            with self._lock:
                self._idle -= 1
            if query is None:
                return
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
        for _ in self._workers:
            self._waiting.put(None)
        others = [worker for worker in self._workers if worker is not threading.current_thread()]
        for worker in others:
            worker.join(timeout)
        return not any(worker.is_alive() for worker in others)


class Fault(msgspec.Struct, frozen=True):
    """The payload of an error reply."""

    error: str
    """What kind: the name of the exception's class."""
    message: str


def reply(query: zenoh.Query, key: str, value: object, encoding: str = codec.MSGPACK) -> None:
    """Answer a query with MessagePack."""
    query.reply(key, msgspec.msgpack.encode(value), encoding=encoding)


def reply_error(query: zenoh.Query, kind: str, message: str) -> None:
    """Answer a query with an error."""
    query.reply_err(msgspec.msgpack.encode(Fault(kind, message)), encoding=codec.MSGPACK)
