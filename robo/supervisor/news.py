"""What people are told of how a run comes along: that all is ready, and what becomes of single processes."""

import os
import time
from collections.abc import Callable, Mapping
from typing import Protocol

from robo.machine.ancestry import age
from robo.supervisor import journal, needs
from robo.supervisor.timing import Started, timing_text

ENDS = "ends: "
"""What stands before the word on a failure with which the run ends."""
HEED = "heed: "
"""What stands before a word on what is not as it should be, with which the run goes on."""


class Process(needs.Process, journal.Process, Protocol):
    """What of a process people are told."""

    @property
    def reason(self) -> str:
        """Why it is in its state."""

    @property
    def ready(self) -> bool:
        """Whether all that tells of readiness has come."""

    @property
    def down(self) -> bool:
        """Whether it has failed for good, or is in a storm and tried slowly."""

    @property
    def shows_readiness(self) -> bool:
        """Whether being ready says more than having been started."""

    @property
    def started_at(self) -> float:
        """When the present child was started, by the monotonic clock."""

    @property
    def ready_at(self) -> float:
        """When the present child became ready, by the monotonic clock."""

    def healthy(self) -> bool:
        """Whether nothing is wrong with it."""


class Journal(Protocol):
    """Where it is told."""

    def say(self, text: str) -> None:
        """Tell what people may want to know."""

    def warn(self, text: str) -> None:
        """Tell what went wrong."""

    def event(self, what: str, reason: str = "", process: journal.Process | None = None) -> None:
        """Something has happened to a process; or to the run as a whole, where none is named."""


class News:
    """Tells what a run comes to, each thing once."""

    def __init__(
        self,
        processes: Mapping[str, Process],
        journal: Journal,
        notify: Callable[[str], None] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """
        Args:
            processes: of the run, by full name.
            journal: where it is told.
            notify: is told `up`, `ready`, `down` and why something fails before, after `ENDS` if the run ends with it,
                and after `HEED` what else people should know: for whoever waits in the background.
            clock: monotonic, s; the run begins now.
        """
        self.all_ready = False
        """Whether all has been ready once."""
        self.begin = clock()
        """By the clock, s."""
        self._processes = processes
        self._journal = journal
        self._notify = notify or (lambda _: None)
        self._clock = clock
        self._is_up = False
        self._phases: list[tuple[str, float]] = []

    def phase_over(self, what: str) -> None:
        """A part of the start is over."""
        self._phases.append((what, time.time()))

    def up(self) -> None:
        """The run can be asked over the network from now on."""
        self._journal.event("up")
        self._notify("up")
        self._is_up = True

    def down(self) -> None:
        """The run is over."""
        self._notify("down")

    def heed(self, text: str) -> None:
        """Something about the run as a whole is not as people may think."""
        self._journal.warn(text)
        self._notify(f"{HEED}{text}")

    def changed(self, process: Process, *, closing: bool) -> None:
        """A process has come to another state; whether the run ends already."""
        self._journal.event(process.state, process.reason, process)
        self._tell(process, closing=closing)
        if not closing and process.finished:
            for other, until in needs.in_vain(self._processes, process):
                self._journal.warn(f"{other.label} is not started: it needs {process.label} {until}")

    def look(self, robot: str, where: str, *, with_timing: bool) -> None:
        """Tell that all is ready, once it is.

        Args:
            robot: what the run is called.
            where: at which endpoints it is reached, in words.
            with_timing: whether to say where the time of the start went.
        """
        # What has done its work and ended well is as good as ready.
        if self.all_ready or not all(one.healthy() for one in self._processes.values()):
            return
        self.all_ready = True
        seconds = self._clock() - self.begin
        count = len(self._processes)
        nodes = "1 node" if count == 1 else f"{count} nodes"
        self._journal.say(f"{robot} is ready: {nodes} in {seconds:.2f} s, {where}; Ctrl-C stops")
        if with_timing:
            for line in self._timing():
                self._journal.say(line)
        self._journal.event("ready")
        self._notify("ready")

    def tell_starter(self, *, ends: bool) -> None:
        """Let whoever waits for this run in the background know that it will not be ready all by itself.

        Args:
            ends: whether the run ends with what has failed.
        """
        if self.all_ready or not self._is_up:
            return  # who is told too early finds nobody to ask
        for one in self._processes.values():
            if one.down:
                self._notify(f"{ENDS if ends else ''}{one.label} {one.reason}")

    def _tell(self, process: Process, *, closing: bool) -> None:
        state, reason, label = process.state, process.reason, process.label
        if state == "failed" and not closing:
            self._journal.warn(f"{label} {reason or state}; it is not started again: robo start {label} does that")
        elif state in ("failed", "restarting"):
            self._journal.warn(f"{label} {reason or state}")
        elif state == "degraded":
            self._journal.warn(f"{label} is degraded: {reason}")
        elif state == "standby":
            self._journal.say(f"{label} is {reason}")
        elif state == "completed":
            self._journal.say(f"{label} {reason}")
        elif state == "stopped" and not closing:
            self._journal.say(f"{label} is stopped")
        elif state == "ready" and (self.all_ready or process.restarts.count) and process.shows_readiness:
            self._journal.say(f"{label} is ready" + (" again" if process.restarts.count else ""))

    def _timing(self) -> list[str]:
        born = time.time() - age(os.getpid())
        shift = time.time() - self._clock() - born
        started = {
            name: Started(one.label, list(one.plan.needs), one.started_at + shift, one.ready_at + shift)
            for name, one in self._processes.items()
            if one.ready
        }
        return timing_text([(what, at - born) for what, at in self._phases], started)
