"""Emergency stops that are on their way: to each robot a few at once, so that one that hangs holds up no other one."""

import asyncio
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import zenoh

from robo.dashboard import requests

_MOST = 2
"""Of one robot: one that is asked for meanwhile shares the answer of the last one."""
_THREADS = 128
"""So many stops wait at once, of 64 robots at least."""


class Stops:
    """Has robots stop. Used by one thread, that of the event loop."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._threads = ThreadPoolExecutor(_THREADS, "robo-dashboard-stop")
        self._running: dict[str, list[asyncio.Future[object]]] = {}

    async def stop(self, service: str) -> object:
        """Have a robot stop; errors are those of `requests.stop`.

        Args:
            service: the key of its service.
        """
        running = self._running.setdefault(service, [])
        if len(running) < _MOST:
            work = partial(requests.stop, self._session, service)
            running.append(asyncio.get_running_loop().run_in_executor(self._threads, work))
            running[-1].add_done_callback(partial(self._has_ended, service))
        return await asyncio.shield(running[-1])

    def close(self) -> None:
        """Begin none any more."""
        self._threads.shutdown(wait=False, cancel_futures=True)

    def _has_ended(self, service: str, done: asyncio.Future[object]) -> None:
        self._running[service].remove(done)
        if not self._running[service]:
            del self._running[service]
