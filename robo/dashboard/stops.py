"""Emergency stops that are on their way: to each robot a few at once, so that one that hangs holds up no other one."""

import asyncio
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import zenoh

from robo.dashboard import requests

_MOST = 2
"""Calls of one robot: those that are asked for meanwhile share the next one."""
_THREADS = 128
"""So many stops wait at once, of 64 robots at least."""


class Stops:
    """Has robots stop. Used by one thread, that of the event loop."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._threads = ThreadPoolExecutor(_THREADS, "robo-dashboard-stop")
        self._running: dict[str, list[asyncio.Future[object]]] = {}
        self._next: dict[str, asyncio.Future[asyncio.Future[object]]] = {}
        """Of robots of which as many calls are under way as may be: the one that begins when one of these has ended."""

    async def stop(self, service: str) -> object:
        """Have a robot stop; errors are those of `requests.stop`.

        The answer is one to a call that began after this: what answers an earlier one may have been reset since.

        Args:
            service: the key of its service.
        """
        if len(self._running.get(service, ())) < _MOST:
            return await asyncio.shield(self._begin(service))
        loop = asyncio.get_running_loop()
        said = loop.run_in_executor(self._threads, requests.say_stop, self._session, service)
        said.add_done_callback(_take)
        if service not in self._next:
            self._next[service] = loop.create_future()
        return await asyncio.shield(await asyncio.shield(self._next[service]))

    def close(self) -> None:
        """Begin none any more, and wait for none."""
        for following in self._next.values():
            following.cancel()
        self._next.clear()
        for call in [call for calls in self._running.values() for call in calls]:
            call.cancel()
        self._threads.shutdown(wait=False, cancel_futures=True)

    def _begin(self, service: str) -> asyncio.Future[object]:
        work = partial(requests.stop, self._session, service)
        call = asyncio.get_running_loop().run_in_executor(self._threads, work)
        self._running.setdefault(service, []).append(call)
        call.add_done_callback(partial(self._has_ended, service))
        return call

    def _has_ended(self, service: str, done: asyncio.Future[object]) -> None:
        _take(done)
        self._running[service].remove(done)
        if (following := self._next.pop(service, None)) is not None:
            following.set_result(self._begin(service))
        if not self._running[service]:
            del self._running[service]


def _take(done: asyncio.Future[Any]) -> None:
    """What went wrong is told to who waits, if anybody still does."""
    if not done.cancelled():
        done.exception()
