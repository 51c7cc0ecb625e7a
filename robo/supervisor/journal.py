"""What is told of a run: on the console, in its files, to whoever listens over the network or asks later."""

import os
import time
import traceback
from collections import deque
from collections.abc import Callable, Collection, Iterable, Sequence
from typing import Literal, Protocol

from robo.launch.plan import ProcessPlan
from robo.machine.log_files import SUPERVISOR, LogFilter, record
from robo.machine.orphans import Left
from robo.supervisor.restart import Restarts
from robo.wire import names
from robo.wire.reports import MOST_LINES, Event, Exit, LogRecord

MOST_EVENTS = 1000
"""Events that are kept for whoever asks over the network."""

_ONE_SCREEN = 24
"""Lines that whoever looks at the console has before his eyes: nobody needs to be told them again."""
_LAST_WORDS = 8
"""Lines of its last words that the summary repeats of a process."""


class Console(Protocol):
    """Where people look."""

    def line(self, node: str, text: str) -> None:
        """Show one line of a node's output."""

    def say(self, text: str) -> None:
        """Show what the supervisor itself has to say."""

    def warn(self, text: str) -> None:
        """Show what went wrong."""


class Files(Protocol):
    """Where lines are kept."""

    @property
    def problem(self) -> str:
        """Why lines are in no file just now; empty where they are."""

    def write(self, line: LogRecord) -> None:
        """Add a line."""


class Audience(Protocol):
    """Whoever listens over the network."""

    def publish(self, event: Event) -> None:
        """Tell of something that has happened."""

    def publish_line(self, line: LogRecord) -> None:
        """Tell what is printed."""


class Process(Protocol):
    """A process that something is told of."""

    label: str

    @property
    def plan(self) -> ProcessPlan:
        """How it is run."""

    @property
    def pid(self) -> int | None:
        """The process id while it runs."""

    @property
    def restarts(self) -> Restarts:
        """How often it has been started again."""

    @property
    def exits(self) -> Sequence[Exit]:
        """How it has ended, oldest first."""

    @property
    def failed(self) -> bool:
        """Whether it has ended badly, and not because it was asked to."""


class Journal:
    """Tells what happens in one run, and keeps the newest of it."""

    def __init__(self, robot: str, console: Console, files: Files, clock: Callable[[], int] = time.time_ns) -> None:
        """
        Args:
            robot: what the run is called.
            console: where people look.
            files: where lines are kept.
            clock: the time of day, ns since the epoch.
        """
        self.audience: Audience | None = None
        """Whoever listens over the network, once it is there."""
        self._robot = robot
        self._console = console
        self._files = files
        self._clock = clock
        self._events: deque[Event] = deque(maxlen=MOST_EVENTS)
        self._lines: deque[LogRecord] = deque(maxlen=MOST_LINES)

    @property
    def problem(self) -> str:
        """Why lines are in no file just now; empty where they are."""
        return self._files.problem

    def say(self, text: str) -> None:
        """Tell what people may want to know."""
        self._console.say(text)
        self._log(LogRecord(time=self._clock(), node=SUPERVISOR, message=text, level="INFO"))

    def warn(self, text: str) -> None:
        """Tell what went wrong."""
        self._console.warn(text)
        self._log(LogRecord(time=self._clock(), node=SUPERVISOR, message=text, level="WARN"))

    def warn_of(self, error: Exception) -> None:
        """Tell of a mistake of robo's own."""
        self.warn(f"the supervisor has failed: {type(error).__name__}: {error}")
        for line in "".join(traceback.format_exception(error)).splitlines():
            self.warn(f"  {line}")

    def left_behind(self, left: Left) -> None:
        """Tell of a process that had to be ended, for whoever had started it had not done so."""
        self.warn(left.sentence(names.label(self._robot, left.node)))

    def output(self, process: Process, stream: str, text: str) -> None:
        """Tell what a process has printed, where its manifest wants it."""
        where = process.plan.log.output
        if where != "file":
            self._console.line(process.label, text)
        if where != "screen":
            self._log(record(process.label, stream, text))

    def shared_output(self, process: str, stream: str, text: str) -> None:
        """Tell what a process has printed that several nodes share, by full name, where none of them has said it."""
        label = names.label(self._robot, process)
        self._console.line(label, text)
        self._log(record(label, stream, text))

    def note_trouble(self, line: LogRecord) -> None:
        """Tell of trouble with the files themselves: they cannot have the line."""
        self._console.warn(line.message)
        self._keep(line)

    def event(self, what: str, reason: str = "", process: Process | None = None) -> None:
        """Something has happened to a process; or to the run as a whole, where none is named."""
        event = Event(
            time=self._clock(),
            robot=self._robot,
            node=process.plan.full_name if process is not None else "",
            event=what,
            reason=reason,
            pid=process.pid if process is not None else os.getpid(),
            restarts=process.restarts.count if process is not None else 0,
            alarm=_alarm(what, process) if process is not None else "",
        )
        self._events.append(event)
        if self.audience is not None:
            self.audience.publish(event)

    def events(self, nodes: Collection[str] | None = None) -> list[Event]:
        """What has happened, in order: all of it, or what has to some nodes, by full name."""
        return [event for event in self._events if nodes is None or event.node in nodes]

    def lines(
        self, wanted: LogFilter, labels: Collection[str] | None = None, newest: int | None = None
    ) -> list[LogRecord]:
        """What was printed, in order.

        Args:
            wanted: which lines.
            labels: of which processes; None for all.
            newest: how many at most.
        """
        found = [one for one in self._lines if (labels is None or one.node in labels) and wanted.wants(one)]
        return found if newest is None else found[-newest:] if newest else []

    def summarize(self, failed: Iterable[Process]) -> None:
        """Repeat why processes failed: their own last words, where these may have scrolled away."""
        for process in failed:
            if not process.exits:
                continue
            last = process.exits[-1]
            self.warn(f"{process.label} failed: {last.reason}")
            lines = last.last_lines[-_LAST_WORDS:]
            if process.plan.log.output != "file":
                on_screen = {one.message for one in list(self._lines)[-_ONE_SCREEN:] if one.node == process.label}
                if all(line in on_screen or line[6:] in on_screen for line in lines):  # without its level
                    lines = lines[-1:]
            for line in lines:
                self.warn(f"  {line}")

    def _log(self, line: LogRecord) -> None:
        self._keep(line)
        self._files.write(line)

    def _keep(self, line: LogRecord) -> None:
        self._lines.append(line)
        if self.audience is not None:
            self.audience.publish_line(line)


def _alarm(state: str, process: Process) -> Literal["", "died", "degraded"]:
    """Whether the state that a process has come to is a fault that is new."""
    # One that waits for its next start is shown as restarting, in a storm as degraded.
    if process.failed and process.exits and process.exits[-1].exit_code:
        return "died"
    return "degraded" if state == "degraded" and not process.restarts.storm else ""
