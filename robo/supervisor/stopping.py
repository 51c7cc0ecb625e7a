"""The end of a run: who asks for it, its exit code, and the ordered stop with its limits."""

import asyncio
import signal
from collections.abc import Mapping, Set
from contextlib import suppress
from functools import partial
from typing import Literal, Protocol

from robo.machine import last_resort
from robo.supervisor import journal, needs
from robo.supervisor.changes import Changes

HURRY = 0.5
"""How long processes have after a second Ctrl-C, s."""

LAST_RESORT = 15.0
"""How long all but the processes may take to end, s: the network, and what processes have left behind."""

Demand = Literal["none", "stop", "hurry", "kill"]
"""What whoever sits at the terminal has demanded so far."""

_NEXT: dict[Demand, Demand] = {"none": "stop", "stop": "hurry", "hurry": "kill", "kill": "kill"}


class Process(journal.Process, Protocol):
    """What of a process matters to its end."""

    @property
    def running(self) -> bool:
        """Whether a child of it runs."""

    @property
    def spawning(self) -> bool:
        """Whether a child is just being started."""

    @property
    def finished(self) -> bool:
        """Whether it has ended and nothing starts it again but a command."""

    @property
    def failed(self) -> bool:
        """Whether it has ended badly, and not because it was asked to."""

    def retire(self) -> None:
        """The run ends: it is not started any more."""

    async def stop(self) -> None:
        """Stop it; returns when it has ended."""

    def send(self, number: signal.Signals) -> None:
        """Send a signal to the process and its group."""


class Journal(Protocol):
    """Where the end is told."""

    def say(self, text: str) -> None:
        """Tell what people may want to know."""

    def warn(self, text: str) -> None:
        """Tell what went wrong."""


class Stopping:
    """The end of one run. Times are of the running loop's clock."""

    def __init__(self, processes: Mapping[str, Process], changes: Changes, journal: Journal) -> None:
        """
        Args:
            processes: of the run, by full name.
            changes: is notified of what happens to them.
            journal: is told of signals, and of what has to be killed.
        """
        self.begun = False
        """Whether the run is to end, or ends."""
        self.demand: Demand = "none"
        self.failed: list[Process] = []
        """What had failed when the end began."""
        self._exit_code: int | None = None
        self._processes = processes
        self._changes = changes
        self._journal = journal
        self._stopping: dict[str, asyncio.Task[None]] = {}
        self._limit_over = False

    @property
    def result(self) -> int:
        """The exit code of the run: 0 all went well, 1 a process failed, or what was said when the end began."""
        if self._exit_code is not None:
            return self._exit_code
        unstarted = any(not one.exits and not one.finished for one in self._processes.values())
        return 1 if self.failed or unstarted else 0

    # -- who asks for it -------------------------------------------------------------------------

    def finish(self, exit_code: int | None) -> None:
        """End the run; the first one to say so decides the exit code, or with None that what has failed decides it."""
        if not self.begun:
            self.failed = [one for one in self._processes.values() if one.failed]
            self._exit_code = exit_code
            self.begun = True
            self._changes.notify()

    def on_signal(self, number: signal.Signals) -> None:
        """Somebody demands the end: in order at first, then sooner, then at once."""
        self.demand = _NEXT[self.demand]
        if self.demand == "stop":
            self._journal.say("stopping; Ctrl-C again to hurry, a third time to kill")
            self.finish(128 + signal.SIGINT if number == signal.SIGINT else 0)
        elif self.demand == "hurry":
            for one in self._processes.values():
                one.send(signal.SIGTERM)
            asyncio.get_running_loop().call_later(HURRY, self.kill_all)
        else:
            self.kill_all()

    # -- the ordered stop ------------------------------------------------------------------------

    @property
    def limit(self) -> float:
        """How long the ordered stop may take, s."""
        return needs.stop_limit({name: one.plan for name, one in self._processes.items()})

    async def stop_all(self) -> None:
        """Stop processes, each after those that need it; all at once where nothing needs another."""
        self.begun = True
        for one in self._processes.values():
            one.retire()
        limit = asyncio.get_running_loop().call_later(self.limit, self._on_limit)
        while alive := {n: one for n, one in self._processes.items() if one.running or one.spawning}:
            needed = {need for one in alive.values() for need in one.plan.needs}
            for name in due(alive, needed, self._stopping.keys()):
                self._stopping[name] = asyncio.create_task(alive[name].stop())
                if self._limit_over:  # its start took that long
                    self._kill(alive[name])
            self._changes.notify()
            await self._changes.until(partial(_has_got_on, alive, self._stopping.keys() | needed))
        await asyncio.gather(*self._stopping.values())
        limit.cancel()

    def kill_all(self) -> None:
        """Kill what still runs."""
        for one in self._processes.values():
            if one.running:
                self._kill(one)

    def _on_limit(self) -> None:
        self._limit_over = True
        self.kill_all()

    def _kill(self, one: Process) -> None:
        self._journal.warn(f"{one.label} does not end; killing it")
        one.send(signal.SIGKILL)


def due(alive: Mapping[str, Process], needed: Set[str], begun: Set[str]) -> list[str]:
    """Which of those that are alive can be told to stop now: nobody needs them who is alive, and they have started."""
    return [name for name, one in alive.items() if name not in begun and name not in needed and one.running]


def _has_got_on(alive: Mapping[str, Process], settled: Set[str]) -> bool:
    """Whether one of those that were alive has ended, or one that was being started can be stopped now."""
    return any(
        not (one.running or one.spawning) or (one.running and name not in settled) for name, one in alive.items()
    )


def take_signals(loop: asyncio.AbstractEventLoop, stopping: Stopping) -> None:
    """End when told to, even where the loop does not come to it: its output may be blocked, for example."""

    def handle(number: int, _: object) -> None:
        end_within_limits(stopping)
        with suppress(RuntimeError):  # the loop is closed
            loop.call_soon_threadsafe(stopping.on_signal, signal.Signals(number))

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, handle)


def end_within_limits(stopping: Stopping) -> None:
    """From now on this process ends in time, whatever hangs."""
    last_resort.end_within(stopping.limit + LAST_RESORT)
