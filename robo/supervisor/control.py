"""A run's control keys: what `robo ps`, `why`, `stop`, `start`, `restart`, `down`, `events` and `logs` ask for.

`@robo/<robot>/supervisor/<verb>` takes and gives MessagePack; a query on `@robo/**/supervisor/ps` asks all robots, but
what is done is done for a query on exactly its key. `@robo/<robot>/events` carries what happens, and
`@robo/<robot>/output` what is printed.
"""

import asyncio
from collections.abc import Coroutine, Mapping
from typing import Any

import msgspec
import zenoh

from robo.errors import RoboError, RunError, UsageError
from robo.supervisor.commands import Verb
from robo.text.levels import level_of
from robo.text.readable import readable
from robo.text.unreadable import UNREADABLE
from robo.wire import codec
from robo.wire.keys import control_key, event_key, log_key
from robo.wire.queries import Fault, QueryLoop, reply, reply_error
from robo.wire.reports import COMMAND_LIMIT, Event, LogRecord, LogsRequest

_LARGEST = 100_000
"""A longer request is refused, bytes."""


class Control:
    """Answers for one run, from its asyncio loop."""

    def __init__(
        self,
        session: zenoh.Session,
        robot: str,
        tells: Mapping[str, Verb],
        acts: Mapping[str, Verb],
        loop: asyncio.AbstractEventLoop,
        limit: float = COMMAND_LIMIT,
    ) -> None:
        """
        Args:
            session: the network.
            robot: what the run is called.
            tells: what only tells, by verb; it answers queries with wildcards, too.
            acts: what does something, by verb; for a query on exactly its key.
            loop: where verbs are called. A RoboError of theirs is the answer.
            limit: how long one may take, s; then it is given up.
        """
        self._verbs = {**tells, **acts}
        self._loop = loop
        self._limit = limit
        self._events = session.declare_publisher(event_key(robot), encoding=f"{codec.MSGPACK};supervisor/Event")
        self._output = session.declare_publisher(log_key(robot), encoding=f"{codec.MSGPACK};supervisor/LogRecord")
        self._followed = False
        self._listener = self._output.declare_matching_listener(self._notice)
        self._queries = QueryLoop(
            session,
            control_key(robot, "*"),
            self._answer,
            acts=[control_key(robot, verb) for verb in acts],
            tells=[control_key(robot, verb) for verb in tells],
        )
        self._queries.start()

    def publish(self, event: Event) -> None:
        """Tell whoever listens."""
        self._events.put(msgspec.msgpack.encode(event))

    def publish_line(self, line: LogRecord) -> None:
        """Tell whoever follows the output."""
        if self._followed:
            self._output.put(msgspec.msgpack.encode(line))

    def _notice(self, status: Any) -> None:
        self._followed = bool(status.matching)

    def _answer(self, query: zenoh.Query, key: str) -> None:
        self._queries.spare()  # a stop takes a while, and `ps` does not wait for it
        work = self._verbs[key.rpartition("/")[2]]
        payload = query.payload.to_bytes() if query.payload is not None else b""
        try:
            answer = self._wait_for(work(read_request(payload)))
        except (RoboError, RuntimeError) as error:  # the latter where the loop has just ended
            reply_error(query, Fault.of(error))
            return
        reply(query, key, answer)

    def _wait_for(self, work: Coroutine[Any, Any, object]) -> object:
        """What came of something that is done in the loop.

        Raises:
            RunError: it was not done in time; then it is given up.
        """
        done = asyncio.run_coroutine_threadsafe(work, self._loop)
        try:
            return done.result(self._limit)
        except TimeoutError:
            if done.done():  # its own error
                raise
            done.cancel()
            raise RunError(f"not done within {self._limit:g} s") from None
        finally:
            del done  # an error that it holds leads to this frame: both would stay until Python looks for such rings


def read_request(payload: bytes) -> LogsRequest:
    """What a query asks for; an empty one for all. Whatever the verb, what `logs` may be asked is no mistake.

    Raises:
        UsageError: it is no request; names the field.
    """
    if len(payload) > _LARGEST:
        raise UsageError(f"the request has {len(payload):,} bytes; it may have {_LARGEST:,}")
    try:
        asked = msgspec.msgpack.decode(payload, type=readable(LogsRequest)) if payload else LogsRequest()
    except UNREADABLE as error:
        what, _, field = str(error).partition(" - at `$.")
        where = f"{field.rstrip('`')}: " if field else ""
        raise UsageError(f"the request cannot be read: {where}{what}") from None
    if asked.level is not None:
        level_of(asked.level)
    return asked
