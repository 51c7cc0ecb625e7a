"""The loop of async callbacks: one for each process, in a thread of its own. Imported where a node has any.

The loop is asyncio's. What it runs for a callback takes the callback's turn first and gives it away afterwards: each
step of its task from one `await` to the next, those of tasks that it has started, and whatever these have scheduled.
On whose behalf something runs stands in its context, which asyncio hands on. Where the turn is not free the loop goes
on with other things.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextvars import Context, ContextVar, copy_context
from functools import partial
from time import monotonic
from typing import Any, TypeVarTuple

from robo.errors import ContractError
from robo.node.clock import Clock
from robo.node.stage import Stage
from robo.node.turn import Turn, enter

_Ts = TypeVarTuple("_Ts")

HELD = 0.5
"""Whoever holds the loop for longer from one `await` to the next is told of, s."""

JOIN = 1.0
"""How long one waits for the loop to end, s."""


class Behalf:
    """On whose behalf the loop runs something: a callback of a node."""

    def __init__(
        self,
        name: str,
        turn: Turn,
        clock: Clock,
        on_error: Callable[[BaseException], None],
        on_held: Callable[[str, float], None],
        alarms: Callable[[Clock], Alarms],
        tasks: set[asyncio.Task[Any]],
    ) -> None:
        """
        Args:
            name: of the callback.
            turn: which it takes.
            clock: by which it sleeps.
            on_error: is told what a task raised that nobody awaits.
            on_held: is told who held the loop, and for how long, s.
            alarms: what wakes it by a clock that the loop knows nothing of.
            tasks: where those go that it starts.
        """
        self.name = name
        self.turn = turn
        self.clock = clock
        self.on_error = on_error
        self.on_held = on_held
        self.alarms = alarms
        self.tasks = tasks

    def context(self) -> Context:
        """A context in which all runs on this behalf."""
        context = copy_context()
        context.run(_behalf.set, self)
        return context


_behalf: ContextVar[Behalf] = ContextVar("robo_behalf")
_WALL = Clock()


class Loop(asyncio.SelectorEventLoop):
    """asyncio's loop, whose steps take turns. `time()` is the node's where it is asked on behalf of one."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        super().__init__(stage.selector())
        self.set_task_factory(_new_task)
        self.set_exception_handler(_tell)
        # One of its own, as nobody could end asyncio's without waiting for it.
        self._helpers = ThreadPoolExecutor(thread_name_prefix="robo-to-thread")
        self.set_default_executor(self._helpers)
        self.thread = threading.Thread(target=self._work, name="robo-asyncio", daemon=True)

    def time(self) -> float:
        """The time by which is slept."""
        behalf = _behalf.get(None)
        return (_WALL if behalf is None else behalf.clock).monotonic()

    def call_soon(
        self, callback: Callable[[*_Ts], object], *args: *_Ts, context: Context | None = None
    ) -> asyncio.Handle:
        """As asyncio's, in the turn of whoever asks for it."""
        step = self._step(callback, args, context)
        if step is None:
            return super().call_soon(callback, *args, context=context)
        step.handle = super().call_soon(step, context=step.context)
        return step.handle

    def call_soon_threadsafe(
        self, callback: Callable[[*_Ts], object], *args: *_Ts, context: Context | None = None
    ) -> asyncio.Handle:
        """As asyncio's, in the turn of whoever asks for it."""
        step = self._step(callback, args, context)
        self._stage.posted()
        try:
            if step is None:
                return super().call_soon_threadsafe(self._take, partial(callback, *args), context=context)
            step.handle = super().call_soon_threadsafe(self._take, step, context=step.context)
        except RuntimeError:  # it is closed
            self._stage.taken()
            raise
        return step.handle

    def call_at(
        self, when: float, callback: Callable[[*_Ts], object], *args: *_Ts, context: Context | None = None
    ) -> asyncio.TimerHandle:
        """As asyncio's, by the clock of whoever asks for it, and in his turn."""
        step = self._step(callback, args, context)
        if step is None:
            return super().call_at(when, callback, *args, context=context)
        return self._call_at(step.behalf.clock, when, step)

    def wall_later(self, delay: float, callback: Callable[..., object], *args: Any) -> asyncio.TimerHandle:
        """As `call_later`, by the clock that goes on where simulated time stands still."""
        step = self._step(callback, args, None)
        if step is None:
            return super().call_later(delay, callback, *args)
        wall = step.behalf.clock.wall
        return self._call_at(wall, wall.monotonic() + delay, step)

    def _call_at(self, clock: Clock, when: float, step: _Step) -> asyncio.TimerHandle:
        if type(clock) is Clock:
            timer = super().call_at(when, step, context=step.context)
        else:
            timer = asyncio.TimerHandle(when, step, (), self, step.context)
            step.behalf.alarms(clock).add(timer, step)
        step.handle = timer
        return timer

    def _step(self, callback: Callable[..., object], args: tuple[Any, ...], context: Context | None) -> _Step | None:
        behalf = _behalf.get(None) if context is None else context.get(_behalf)
        return None if behalf is None else _Step(self, behalf, callback, args, context or copy_context())

    def _take(self, callback: Callable[[], object]) -> None:
        self._stage.taken()
        callback()

    def _work(self) -> None:
        asyncio.set_event_loop(self)
        self.run_forever()
        self._helpers.shutdown(wait=False, cancel_futures=True)
        self.close()


class _Step:
    """Something that the loop is to run in a turn; also what waits for that turn in the loop's place."""

    __slots__ = ("args", "behalf", "callback", "context", "handle", "loop")

    def __init__(
        self, loop: Loop, behalf: Behalf, callback: Callable[..., object], args: tuple[Any, ...], context: Context
    ) -> None:
        self.loop = loop
        self.behalf = behalf
        self.callback = callback
        self.args = args
        self.context = context
        self.handle: asyncio.Handle | None = None

    def __call__(self) -> None:
        """Run it, at once or as soon as the turn is there."""
        turn = self.behalf.turn
        if turn.try_acquire(False) or turn.queue(self):
            self._run()

    def acquire(self) -> None:
        """As a gate is born closed, there is nothing to do."""

    def release(self) -> None:
        """The turn is there: whoever had it says so, in any thread."""
        try:
            # The context is entered again, as this may be called in another one, or in another thread.
            self.loop.call_soon_threadsafe(self.context.run, self._run, context=Context())
        except RuntimeError:  # the loop is closed
            self.behalf.turn.release()

    def _run(self) -> None:
        behalf, turn = self.behalf, self.behalf.turn
        handle, self.handle = self.handle, None  # each holds the other
        if handle is not None and handle.cancelled():
            turn.release()
            return
        enter(turn, _refuse_to_wait)
        turn.running, turn.since = behalf.name, monotonic()
        try:
            self.callback(*self.args)
        except BaseException as error:  # a task keeps what it raises; this ends the node, or nothing
            behalf.on_error(error)
        # The traceback of what a task has raised holds this frame: a task that nobody awaits would be told of late.
        self.callback, self.args = _nothing, ()
        held = monotonic() - turn.since
        turn.ended(turn.since)
        enter(None)
        turn.release()
        if held > HELD:
            behalf.on_held(behalf.name, held)


def _nothing() -> None:
    """What is left of a step that has run."""


def _refuse_to_wait() -> None:
    raise ContractError(
        "a call of a service in an async callback holds up all others of the process; write `await"
        " self.client.call_async(request)`, or call it in `await asyncio.to_thread(…)`"
    )


class _Task(asyncio.Task[Any]):
    """A task that says on whose behalf it runs."""

    behalf: Behalf | None = None


def _new_task(loop: asyncio.AbstractEventLoop, coroutine: Any, **options: Any) -> asyncio.Task[Any]:
    task = _Task(coroutine, loop=loop, **options)
    context = options.get("context")
    task.behalf = _behalf.get(None) if context is None else context.get(_behalf)
    if task.behalf is not None:
        task.behalf.tasks.add(task)  # asyncio itself would let go of one that nobody holds
        task.add_done_callback(task.behalf.tasks.discard, context=Context())
    return task


def _tell(loop: asyncio.AbstractEventLoop, told: dict[str, Any]) -> None:
    """What asyncio has nobody to raise it to: an exception of a task that nobody awaits."""
    behalf = getattr(told.get("task") or told.get("future"), "behalf", None)
    error = told.get("exception")
    if behalf is None or error is None:
        loop.default_exception_handler(told)
    else:
        behalf.on_error(error)


class Alarms:
    """Wakes what sleeps by one clock that somebody else sets, in a thread of its own: simulated time, or a test's."""

    def __init__(self, clock: Clock, loop: Loop) -> None:
        self._clock = clock
        self._loop = loop
        self._lock = threading.Lock()
        self._alarms: list[tuple[asyncio.TimerHandle, _Step]] = []
        self._woken = threading.Event()
        self._stopped = False
        self._thread = threading.Thread(target=self._work, name="robo-sleep", daemon=True)
        clock.expect(self._thread)
        self._thread.start()

    def add(self, timer: asyncio.TimerHandle, step: _Step) -> None:
        """Run a step at its time."""
        with self._lock:
            self._alarms.append((timer, step))
            self._alarms.sort(key=lambda alarm: alarm[0].when())
        self._wake()

    def stop(self) -> None:
        """End."""
        self._stopped = True
        self._wake()
        self._thread.join(JOIN)

    def _wake(self) -> None:
        self._woken.set()
        self._clock.wake()

    def _work(self) -> None:
        clock = self._clock
        while not self._stopped:
            self._woken.clear()
            jumps = clock.jumps
            with self._lock:
                self._alarms = [alarm for alarm in self._alarms if not alarm[0].cancelled()]
                until = self._alarms[0][0].when() if self._alarms else float("inf")
            if clock.wait(self._woken, until, jumps):
                # As `Node.sleep`: a time that jumps is no longer the one by which was reckoned when to go on.
                self._ring(0 if jumps == clock.jumps else len(self._alarms))
            else:
                self._ring(1)

    def _ring(self, count: int) -> None:
        with self._lock:
            due, self._alarms = self._alarms[:count], self._alarms[count:]
        for _, step in due:
            self._loop.call_soon_threadsafe(step.context.run, step, context=Context())


def join(stage: Stage, clock: Clock) -> Loop:
    """The loop of a stage, which runs while anybody needs it."""
    with stage.lock:
        stage.users += 1
        if stage.loop is None:
            stage.loop = loop = Loop(stage)
            clock.expect(loop.thread)
            loop.thread.start()
        assert isinstance(stage.loop, Loop)
        return stage.loop


def leave(stage: Stage, *, wait: bool) -> None:
    """Need the loop no longer; `wait` for its end where it may come."""
    with stage.lock:
        stage.users -= 1
        if stage.users or stage.loop is None:
            return
        loop, stage.loop = stage.loop, None
    assert isinstance(loop, Loop)
    loop.call_soon_threadsafe(loop.stop, context=Context())
    loop.thread.join(JOIN if wait else 0.0)
