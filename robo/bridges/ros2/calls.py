"""Calls from one network to the other: a question on one side is asked on the other one, and the answer handed back.

No thread waits for an answer: a server that hangs holds up nobody but who has called it. So many calls of a service may
wait; one more is answered by an error at once.
"""

import queue
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import zenoh

from robo.bridges.ros2 import stamps
from robo.bridges.ros2.forms import ServiceForm
from robo.bridges.ros2.tally import Count
from robo.text.brief import brief
from robo.wire import queries
from robo.wire.codec import Malformed
from robo.wire.queries import Fault
from robo.wire.targets import OF_ONE

MOST_WAITING = 256
"""Calls of one service that may wait for their answers."""
MOST_AT_ONCE = 2_000
"""Calls and answers of which nobody has done anything yet."""
MOST_KEYS = 20_000
"""Of services that have been there."""
ANSWER_WITHIN = 60.0
"""How long an answer may take, s: ROS's clients know no limit of their own."""
GONE = "its server has gone"
_WORKERS = 4
_MOST_ERROR = 300
"""Of an error's text, characters."""

Answer = bytes | Fault
"""A payload, or the error in its place."""
Asked = Callable[[bytes, Callable[[Answer], None]], None]
"""Asks something; the second one gets the answer, once, on any thread."""


class Workers:
    """Threads that hand answers back: what Zenoh's own threads learn is only noted there."""

    def __init__(self, failed: Callable[[BaseException], None]) -> None:
        """`failed` is told what a piece of work has raised."""
        self._failed = failed
        self._lock = threading.Lock()
        self._over = False
        self._keys: dict[tuple[str, str], zenoh.KeyExpr] = {}
        self._work: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._threads = [
            threading.Thread(target=self._run, name="robo-ros2-answers", daemon=True) for _ in range(_WORKERS)
        ]
        for thread in self._threads:
            thread.start()

    def key(self, session: zenoh.Session, key: str) -> zenoh.KeyExpr:
        """A key, declared by itself and for as long as these are there.

        One that goes with its queryable is unknown to a call that is just on its way to it: Zenoh 1.10 drops that
        without a word, and who has called waits for his own time-out.
        """
        whose = str(session.info.zid()), key
        declared = self._keys.get(whose)
        if declared is None:
            declared = session.declare_keyexpr(key)
            if len(self._keys) < MOST_KEYS:
                self._keys[whose] = declared  # Zenoh counts who holds it
        return declared

    def do(self, work: Callable[[], None]) -> None:
        """Have something done soon; nothing once they are closed."""
        with self._lock:  # what comes behind the last word would be kept for ever, and a call with it
            if not self._over:
                self._work.put(work)

    def take(self, query: zenoh.Query, work: Callable[[zenoh.Query], None]) -> None:
        """Have a call answered; of too many at once the last ones are refused. For Zenoh's own threads."""
        if self._work.qsize() > MOST_AT_ONCE:
            query.reply_err(b"too many calls at once")
            query.drop()
        else:
            self.do(lambda: work(query))

    def close(self) -> None:
        """Do what has come, and nothing more."""
        with self._lock:
            self._over = True
            for _ in self._threads:
                self._work.put(None)

    def _run(self) -> None:
        while (work := self._work.get()) is not None:
            try:
                work()
            except zenoh.ZError:
                pass  # whoever has asked may be gone, or the network has been left
            except Exception as error:  # what a stranger says ends no worker
                self._failed(error)


class TooMany(Exception):
    """A call that may not wait."""


class Gone(Exception):
    """A call of what is no more."""


class Pending:
    """The calls of one service that wait."""

    def __init__(self, most: int = MOST_WAITING) -> None:
        self._lock = threading.Lock()
        self._held: dict[int, zenoh.Query] = {}
        self._most = most
        self._over = False

    def begin(self, query: zenoh.Query) -> None:
        """One more waits.

        Raises:
            Gone: it was given up.
            TooMany: so many wait already.
        """
        with self._lock:
            if self._over:
                raise Gone(GONE)
            if len(self._held) >= self._most:
                raise TooMany(f"{self._most} calls of it wait already")
            self._held[id(query)] = query

    def end(self, query: zenoh.Query) -> bool:
        """One has its answer. Returns whether it was still to be answered."""
        with self._lock:
            return self._held.pop(id(query), None) is not None

    def give_up(self) -> list[zenoh.Query]:
        """All that wait: nobody else answers them, and none waits from now on."""
        with self._lock:
            self._over = True
            given_up = list(self._held.values())
            self._held.clear()
        return given_up


class Asking:
    """Asks on one network."""

    def __init__(self, session: zenoh.Session, key: str, workers: Workers, timeout: float = ANSWER_WITHIN) -> None:
        """
        Args:
            session: the network.
            key: of the service.
            workers: where answers are handed back.
            timeout: how long an answer may take, s.
        """
        self._session, self._key, self._workers, self._timeout = session, key, workers, timeout

    def ask(self, tell: Callable[[Answer], None], **said: Any) -> None:
        """Ask; `said` is what Zenoh is told of the question."""
        found: list[Answer] = []

        def take(reply: zenoh.Reply) -> None:
            if found:
                return
            if reply.ok is not None:
                found.append(reply.ok.payload.to_bytes())
            elif (fault := _fault_of(reply)) is not None:
                found.append(fault)

        def end() -> None:
            answer = found[0] if found else Fault("ServiceTimeout", f"{self._key} was not answered")
            self._workers.do(lambda: tell(answer))

        handler = zenoh.handlers.Callback(take, end, indirect=False)
        self._session.get(self._key, handler, timeout=self._timeout, **OF_ONE, **said)


def _fault_of(reply: zenoh.Reply) -> Fault | None:
    fault = queries.read_fault(reply)
    if fault is not None or reply.err is None:
        return fault
    text = reply.err.payload.to_bytes()[:_MOST_ERROR].decode("utf-8", "replace")
    return Fault("ServiceTimeout" if text == "Timeout" else "ServiceError", text)


class _Door(ABC):
    """A service in one network, which is asked for in the other one."""

    def __init__(
        self,
        session: zenoh.Session,
        key: str,
        form: ServiceForm,
        asked: Asked,
        count: Count,
        pending: Pending,
        workers: Workers,
    ) -> None:
        """
        Args:
            session: the network in which it is.
            key: of the service.
            form: its types.
            asked: gets a request as the other network has it.
            count: where calls are counted.
            pending: how many may wait.
            workers: do it all.
        """
        self._key, self._form, self._asked, self._count, self._pending = key, form, asked, count, pending
        # No thread for each service: Zenoh's own hands a call over.
        at_once: Any = zenoh.handlers.Callback(lambda query: workers.take(query, self._take), indirect=False)
        self._queryable = session.declare_queryable(workers.key(session, key), at_once, complete=True)

    def close(self) -> None:
        """Answer nothing more: Zenoh itself does not end a question whose server is killed.

        Who waits is told before it has gone: of what is answered afterwards routers may know no more. Who came
        meanwhile, and is still in the workers' hands, is told by them.
        """
        for query in self._pending.give_up():
            with suppress(zenoh.ZError):  # whoever has asked may be gone
                self._tell_gone(query)
            query.drop()
        self._queryable.undeclare()

    @abstractmethod
    def _take(self, query: zenoh.Query) -> None:
        """Ask in the other network, or refuse."""

    @abstractmethod
    def _tell_gone(self, query: zenoh.Query) -> None:
        """Answer one whose server has gone."""


class RosDoor(_Door):
    """A service in ROS's network; it asks with requests as robo has them."""

    def _tell_gone(self, query: zenoh.Query) -> None:
        _refuse(query, GONE)

    def _take(self, query: zenoh.Query) -> None:
        kept = False
        try:
            attachment = query.attachment
            stamp = stamps.unpack(attachment.to_bytes()) if attachment is not None else None
            if str(query.key_expr) != self._key or stamp is None or query.payload is None:
                _refuse(query, "a call of ROS has the service's key, a payload, and rmw_zenoh's attachment")
                self._count.refused += 1
                return
            try:
                request = self._form.request.to_robo(query.payload.to_bytes())
            except Malformed as reason:
                _refuse(query, str(reason))
                self._count.refused += 1
                return
            try:
                self._pending.begin(query)
            except Gone:
                self._tell_gone(query)
                return
            except TooMany as reason:
                _refuse(query, str(reason))
                self._count.dropped += 1
                return
            found = stamp
            try:
                self._asked(request, lambda answer: self._reply(query, found, answer))
                kept = True
            except Exception as error:
                self._pending.end(query)
                _refuse(query, f"{type(error).__name__}: {error}")
        finally:
            if not kept:
                query.drop()

    def _reply(self, query: zenoh.Query, stamp: stamps.Stamp, answer: Answer) -> None:
        if not self._pending.end(query):
            return  # it was given up
        try:
            if isinstance(answer, Fault):
                _refuse(query, f"{answer.error}: {answer.message}")
                self._count.refused += 1
                return
            try:
                data = self._form.response.to_cdr(answer)
            except Malformed as reason:
                _refuse(query, str(reason))
                self._count.refused += 1
                return
            attachment = stamps.pack(stamp.number, time.time_ns(), stamp.gid)
            query.reply(self._key, data, encoding="application/cdr", attachment=attachment)
            self._count.crossed += 1
        finally:
            query.drop()


class RoboDoor(_Door):
    """A service in robo's network; it asks with CDR, and is told CDR."""

    def _tell_gone(self, query: zenoh.Query) -> None:
        queries.reply_error(query, Fault("ServiceTimeout", GONE))

    def _take(self, query: zenoh.Query) -> None:
        kept = False
        try:
            if str(query.key_expr) != self._key:
                queries.reply_error(query, Fault("TooWide", f"ask for exactly {self._key}"))
                return
            payload = query.payload.to_bytes() if query.payload is not None else b"\x80"  # nothing is an empty map
            try:
                request = self._form.request.to_cdr(payload)
            except Malformed as reason:
                queries.reply_error(query, Fault.of(reason))
                self._count.refused += 1
                return
            try:
                self._pending.begin(query)
            except Gone:
                self._tell_gone(query)
                return
            except TooMany as reason:
                queries.reply_error(query, Fault("ServiceError", str(reason)))
                self._count.dropped += 1
                return
            try:
                self._asked(request, lambda answer: self._reply(query, answer))
                kept = True
            except Exception as error:
                self._pending.end(query)
                queries.reply_error(query, Fault.of(error))
        finally:
            if not kept:
                query.drop()

    def _reply(self, query: zenoh.Query, answer: Answer) -> None:
        if not self._pending.end(query):
            return  # it was given up
        try:
            if not isinstance(answer, Fault):
                try:
                    payload = self._form.response.to_robo(answer)
                    query.reply(self._key, payload, encoding=self._form.response.encoding)
                    self._count.crossed += 1
                    return
                except Malformed as reason:
                    answer = Fault.of(reason)
            queries.reply_error(query, answer)
            self._count.refused += 1
        finally:
            query.drop()


def _refuse(query: zenoh.Query, why: str) -> None:
    query.reply_err(brief(why, _MOST_ERROR).encode())


def to_robo(asking: Asking, form: ServiceForm) -> Asked:
    """Asks a service of robo's."""
    return lambda request, tell: asking.ask(tell, payload=request, encoding=form.request.encoding)


def to_ros(asking: Asking, gid: bytes) -> Asked:
    """Asks a service of ROS's, as the client of an id."""
    numbers = iter(range(1, 2**62))

    def ask(request: bytes, tell: Callable[[Answer], None]) -> None:
        stamp = stamps.pack(next(numbers), time.time_ns(), gid)
        asking.ask(tell, payload=request, encoding="application/cdr", attachment=stamp)

    return ask
