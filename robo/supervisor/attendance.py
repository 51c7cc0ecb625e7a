"""What the service manager that has started the run, such as systemd, hears of it: ready, how it is, not hung, the end.

All of it is said from the run's own loop, so that a supervisor that hangs is silent.
"""

import asyncio
import math
import time
from collections.abc import Callable, Mapping
from typing import Protocol

from robo.launch.plan import ProcessPlan
from robo.machine.service_manager import ServiceManager

PERIOD = 1.0
"""How often it is told at least, s."""
EXTENSION = 30.0
"""How much longer a start may take, told while it goes on, s: longer than a busy machine is silent."""

_STANDBY = 60.0
"""For how long a managed node may be on its way to active before it counts as one that stays where it is, s."""
_MOST_TROUBLES = 3
"""So many processes are named."""
_LONGEST = 300
"""Of a status, letters."""


class Process(Protocol):
    """What of a process is told."""

    label: str

    @property
    def plan(self) -> ProcessPlan:
        """How it is run."""

    @property
    def state(self) -> str:
        """How it is shown."""

    @property
    def reason(self) -> str:
        """Why it is in its state."""

    @property
    def running(self) -> bool:
        """Whether a child of it runs."""

    @property
    def spawning(self) -> bool:
        """Whether a child is just being started."""

    @property
    def next_start(self) -> float | None:
        """When it is started again."""

    @property
    def started_at(self) -> float:
        """When the present child was started, by the monotonic clock."""

    @property
    def finished(self) -> bool:
        """Whether it has ended and nothing starts it again but a command."""

    @property
    def down(self) -> bool:
        """Whether it has failed for good, or is in a storm and tried slowly."""

    def healthy(self) -> bool:
        """Whether nothing is wrong with it."""


class Stopping(Protocol):
    """The end of the run."""

    begun: bool

    @property
    def limit(self) -> float:
        """How long the ordered stop may take, s."""


class Attendance:
    """Tells the service manager, each thing once, but for signs of life."""

    def __init__(
        self,
        manager: ServiceManager,
        processes: Mapping[str, Process],
        stopping: Stopping,
        unmet: Callable[[ProcessPlan], list[str]],
        last_resort: float,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """
        Args:
            manager: is told.
            processes: of the run, by full name.
            stopping: the end of the run.
            unmet: what a process still waits for.
            last_resort: how long all but the processes may take to end, s.
            clock: monotonic, s.
        """
        self.ready = False
        """Whether the start is over, and that was told."""
        self._manager = manager
        self._processes = processes
        self._stopping = stopping
        self._unmet = unmet
        self._last_resort = last_resort
        self._clock = clock
        self._status = ""
        self._tells_end = True

    async def attend(self) -> None:
        """Tell it again and again, until cancelled."""
        watchdog = self._manager.watchdog
        period = PERIOD if watchdog is None else min(PERIOD, watchdog / 2)
        while True:
            self.look()
            if watchdog is not None:
                self._manager.tell("WATCHDOG=1")
            await asyncio.sleep(period)

    def look(self) -> None:
        """Tell what is new."""
        if self._stopping.begun:
            self._tell_end()
            return
        lines = []
        status = status_of(self._processes)
        over = self.ready or start_is_over(self._processes, self._unmet, self._clock())
        if not self.ready:
            lines.append("READY=1" if over else f"EXTEND_TIMEOUT_USEC={EXTENSION * 1e6:.0f}")
        if status != self._status:
            lines.append(f"STATUS={status}")
        if lines and self._manager.tell(*lines):
            self.ready, self._status = over, status

    def _tell_end(self) -> None:
        if self._tells_end:
            longest = self._stopping.limit + self._last_resort
            told = self._manager.tell("STOPPING=1", "STATUS=stopping", f"EXTEND_TIMEOUT_USEC={longest * 1e6:.0f}")
            self._tells_end = not told


def start_is_over(processes: Mapping[str, Process], unmet: Callable[[ProcessPlan], list[str]], now: float) -> bool:
    """Whether nothing is on its way any more: all is ready, or has failed for good, or waits for others.

    A robot without one of its sensors is up all the same, as it would be for somebody who starts it by hand.
    """
    return all(
        one.healthy() or one.down or one.finished or not _on_its_way(one, unmet, now) for one in processes.values()
    )


def _on_its_way(one: Process, unmet: Callable[[ProcessPlan], list[str]], now: float) -> bool:
    if one.spawning or one.next_start is not None:
        return True
    if not one.running:  # it waits, for what may never come
        return not unmet(one.plan)
    if one.state == "degraded":
        return False
    longest = one.plan.ready.timeout or (_STANDBY if one.state == "standby" else math.inf)
    return now - one.started_at < longest


def status_of(processes: Mapping[str, Process]) -> str:
    """One line for people: how many are ready, and what is wrong with the others."""
    ready = sum(one.healthy() and one.state != "degraded" for one in processes.values())
    count = len(processes)
    nodes = "1 node" if count == 1 else f"{count} nodes"
    wrong = [one for one in processes.values() if not one.healthy() or one.state == "degraded"]
    said = [f"{one.label} {one.state}" + (f": {one.reason}" if one.reason else "") for one in wrong]
    more = [f"{len(said) - _MOST_TROUBLES} more"] if len(said) > _MOST_TROUBLES else []
    text = "; ".join([f"{ready} of {nodes} ready", *said[:_MOST_TROUBLES], *more])
    line = " ".join(text.split())
    return line if len(line) <= _LONGEST else line[: _LONGEST - 1] + "…"
