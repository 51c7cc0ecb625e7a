"""The async callbacks of one node: as functions that a node's threads call, and that wait for the loop."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Coroutine
from contextvars import Context
from time import monotonic
from typing import Any

from robo.node import async_loop
from robo.node.async_loop import Alarms, Behalf
from robo.node.clock import Clock
from robo.node.ending import NodeStopping
from robo.node.stage import Stage
from robo.node.turn import Turn, name_of, paused


class Coroutines:
    """Runs the async callbacks of one node on the loop of its process."""

    def __init__(self, clock: Clock, on_held: Callable[[str, float], None]) -> None:
        """
        Args:
            clock: the node's, by which they sleep.
            on_held: is told of a callback that kept the loop to itself, and for how long, s.
        """
        self._clock = clock
        self._on_held = on_held
        self._stage = clock.stage
        self._loop = async_loop.join(clock.stage, clock)
        self._tasks: set[asyncio.Task[Any]] = set()
        self._alarms: dict[int, Alarms] = {}
        self._stopping = False
        self._idle = threading.Event()

    def plain(
        self, callback: Callable[..., Coroutine[Any, Any, Any]], turn: Turn, on_error: Callable[[BaseException], None]
    ) -> Plain:
        """A callback that a thread of the node calls as any other one.

        Args:
            callback: is async.
            turn: which it takes.
            on_error: is told what a task of it raised that nobody awaits.
        """
        name, alarms = name_of(callback), self._alarms_of
        behalf = Behalf(name, turn, self._clock, on_error, self._on_held, alarms, self._tasks)
        return Plain(callback, behalf, self._begin)

    def interrupt(self) -> None:
        """Cancel all that runs, and take nothing new: the node is told to stop."""
        self._stopping = True
        self._loop.call_soon_threadsafe(self._cancel, context=Context())

    def stop(self, timeout: float) -> bool:
        """Leave the loop. Returns whether all tasks have ended within `timeout` seconds."""
        self.interrupt()
        ended = self._idle.wait(timeout)
        for alarms in self._alarms.values():
            alarms.stop()
        async_loop.leave(self._stage, wait=ended)
        return ended

    def _begin(self, coroutine: Coroutine[Any, Any, Any], behalf: Behalf) -> Job:
        """Begin to run a coroutine."""
        if self._stopping:
            coroutine.close()
            raise NodeStopping
        job = Job(coroutine, behalf, self._loop, self._stage, lambda: self._stopping)
        self._loop.call_soon_threadsafe(job.start, context=Context())
        return job

    def _cancel(self) -> None:
        for task in list(self._tasks):
            if not task.cancelling():  # else it is putting things in order
                task.cancel()
        self._look()

    def _look(self) -> None:
        if not self._tasks:
            self._idle.set()
        else:
            # By whom each task that has ended is taken out runs before this.
            next(iter(self._tasks)).add_done_callback(lambda _: self._look(), context=Context())

    def _alarms_of(self, clock: Clock) -> Alarms:
        return self._alarms.get(id(clock)) or self._alarms.setdefault(id(clock), Alarms(clock, self._loop))


class Plain:
    """An async callback as a function."""

    def __init__(
        self,
        callback: Callable[..., Coroutine[Any, Any, Any]],
        behalf: Behalf,
        begin: Callable[[Coroutine[Any, Any, Any], Behalf], Job],
    ) -> None:
        self.__name__ = behalf.name
        self._callback = callback
        self._behalf = behalf
        self._begin = begin

    def __call__(self, *arguments: Any) -> Any:
        """Run it to its end."""
        return self.begin(*arguments).wait()

    def begin(self, *arguments: Any) -> Job:
        """Begin to run it; whoever does so waits for its end."""
        return self._begin(self._callback(*arguments), self._behalf)


class Job:
    """One run of an async callback."""

    def __init__(
        self,
        coroutine: Coroutine[Any, Any, Any],
        behalf: Behalf,
        loop: asyncio.AbstractEventLoop,
        stage: Stage,
        is_stopping: Callable[[], bool],
    ) -> None:
        self._coroutine = coroutine
        self._behalf = behalf
        self._loop = loop
        self._stage = stage
        self._is_stopping = is_stopping
        self._question = stage.question()
        self._begun = monotonic()
        self._done = threading.Lock()
        """Released when it has ended."""
        self._done.acquire()
        self._task: asyncio.Task[None] | None = None
        self._result: Any = None
        self._error: BaseException | None = None

    def start(self) -> None:
        """Begin; in the loop."""
        self._task = self._loop.create_task(self._work(), context=self._behalf.context())
        self._task.add_done_callback(self._finish, context=Context())

    def cancel(self) -> None:
        """Cancel it, from any thread."""
        self._loop.call_soon_threadsafe(self._cancel, context=Context())

    def wait(self) -> Any:
        """Wait for its end, in a thread of the node, whose turn others have meanwhile. Returns what it returned.

        Raises:
            NodeStopping: it was cancelled because the node stops.
            BaseException: what it raised.
        """
        with paused(), self._stage.waiting(self._question):
            self._done.acquire()
        self._behalf.turn.busy -= monotonic() - self._begun  # each of its steps has told its own time
        error, self._error = self._error, None
        if error is None:
            return self._result
        try:
            if self._is_stopping() and isinstance(error, asyncio.CancelledError):
                raise NodeStopping from None
            raise error
        finally:
            del error  # its traceback would hold it

    def _cancel(self) -> None:
        if self._task is not None and not self._task.cancelling():
            self._task.cancel()

    async def _work(self) -> None:
        try:
            self._result = await self._coroutine
        except BaseException as error:  # a SystemExit, too, is for the thread that waits
            self._error = error

    def _finish(self, task: asyncio.Task[None]) -> None:
        if task.cancelled():  # before its first step
            self._coroutine.close()
            self._error = asyncio.CancelledError()
        self._stage.answered(self._question)
        self._done.release()
