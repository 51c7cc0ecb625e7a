"""One child of a member, from its start to its end, and what it shows meanwhile. A restart makes another one."""

import os
import signal
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

import msgspec

from robo.launch.plan import ProcessPlan
from robo.machine.ancestry import ancestors, is_exiting
from robo.machine.child import Spawned
from robo.machine.forks import Fork, Template
from robo.machine.limits import Hold, Limiter
from robo.machine.orphans import Left
from robo.machine.priority import give_priority
from robo.machine.probe import succeeds
from robo.machine.usage import Usage
from robo.supervisor.pulse import Pulse, beat_period
from robo.supervisor.readiness import Readiness
from robo.supervisor.topic_watch import Flow
from robo.wire.reports import Exit, ProcessStatus


class Run(Protocol):
    """What a child needs of the run that it is part of."""

    spawned: Spawned
    template: Template | None
    limiter: Limiter

    def environment(self, plan: ProcessPlan) -> dict[str, str]:
        """The environment of a process; each start has its own."""

    def flow(self, key: str) -> Flow | None:
        """What comes on a topic that is watched."""


class Child(Protocol):
    """What an instance needs of the process that it is."""

    left: Sequence[Left]
    """Who of its process group was still there when it had ended, though nobody had told the group to."""

    @property
    def last_lines(self) -> deque[str]:
        """The end of its stderr."""

    @property
    def pid(self) -> int | None:
        """The process id, once started; None again where it has ended and its process, which it shared, goes on."""

    @property
    def running(self) -> bool:
        """Whether it has started and not yet ended."""

    async def start(
        self, command: Sequence[str], environment: Mapping[str, str], *, cwd: str | None, fork: Fork | None
    ) -> None:
        """Start it; raises OSError where that is not possible."""

    async def wait(self) -> int:
        """Wait for its end and return the exit code."""

    def send(self, number: signal.Signals) -> None:
        """Send a signal to its whole group."""


MakeChild = Callable[[Spawned, Callable[[str, str], None], Callable[[bytes], None] | None, float], Child]
"""Takes the processes of the run; what takes lines, by stream; what takes heartbeats; the time between two, s."""


class Instance:
    """A child with its readiness, its signs of life and its use of the machine."""

    def __init__(
        self,
        plan: ProcessPlan,
        run: Run,
        make: MakeChild,
        output: Callable[[str, str], None],
        clock: Callable[[], float],
        told: Callable[[], None] = lambda: None,
    ) -> None:
        """
        Args:
            plan: how it is run.
            run: what it is part of.
            make: makes the child.
            output: takes what it prints, by stream.
            clock: the time, s.
            told: is called when it has said how it is.
        """
        self.started_at = clock()
        self.readiness = Readiness(plan.ready, run.flow, self._probe)
        self.pulse = Pulse(plan.watchdog, plan.publishes, run.flow, self.started_at, plan.ready.timeout)
        self.files: tuple[str, ...] = ()
        """The source files of a node, where the run watches them."""
        self._plan = plan
        self._run = run
        self._output = output
        self._clock = clock
        self._told = told
        beats = plan.service is not None or plan.ready.when == "node"
        self._child = make(run.spawned, self._on_line, self._on_beat if beats else None, beat_period(plan.watchdog))
        self._usage: Usage | None = None
        self._hold: Hold | None = None

    @property
    def pid(self) -> int | None:
        """The process id, once started."""
        return self._child.pid

    @property
    def running(self) -> bool:
        """Whether it has started and not yet ended."""
        return self._child.running

    @property
    def left(self) -> Sequence[Left]:
        """What it had started and not ended, once it has ended by itself."""
        return self._child.left

    async def start(self) -> str | None:
        """Start it. Returns why it cannot be started, where that is so."""
        plan = self._plan
        command, template = plan.command(), self._run.template if plan.plain else None
        fork = template.module(plan.module) if template is not None else None
        try:
            await self._child.start(command, self._run.environment(plan), cwd=plan.cwd, fork=fork)
        except OSError as error:
            place = f" in {plan.cwd}" if plan.cwd else ""
            return f"cannot be started{place}: {error.strerror}: {error.filename or command[0]}"
        if self.pid is not None:
            self._usage = Usage(self.pid)
            lacking = give_priority(self.pid, plan.priority, plan.cpus)
            if lacking is not None:
                self._output("robo", f"WARN  runs without {lacking}")
            if plan.limits:
                self._hold = self._run.limiter.hold(self.pid, plan.process or plan.full_name, plan.limits)
                if self._hold.lacking:
                    self._output("robo", f"WARN  runs without the limit {self._hold.lacking}")
        return None

    async def wait(self) -> int:
        """Wait for its end and return the exit code."""
        return await self._child.wait()

    def send(self, number: signal.Signals) -> None:
        """Send a signal to the process and its group."""
        self._child.send(number)

    def is_over_limit(self) -> bool:
        """Whether it uses more than it may, and is to be killed; to be called a few times a second."""
        return self._hold is not None and self.running and self._hold.look()

    def is_exiting(self) -> bool:
        """Whether its process ends, or was killed, and is only not gone yet."""
        return self.running and self.pid is not None and is_exiting(self.pid)

    def limit_reached(self, code: int) -> str:
        """Which limit it has ended by, in words to follow its exit code; empty where it was none."""
        return self._hold.blame(code, self._child.last_lines) if self._hold is not None else ""

    def leads(self, pid: int) -> bool:
        """Whether a process of this machine is the child, or in its process group."""
        try:
            return self.running and os.getpgid(pid) == self.pid
        except OSError:
            return False

    def owns(self, pid: int) -> bool:
        """Whether a process is the child, or was started by it: a debugger or a script in between."""
        if self.pid is None or pid == self.pid or self.leads(pid):
            return self.pid is not None
        return self.pid in ancestors(pid)

    def exit(self, code: int, reason: str, time: int) -> Exit:
        """How it has ended; `time` is now, ns since the epoch."""
        uptime = self._clock() - self.started_at
        lines = list(self._child.last_lines)
        return Exit(time=time, exit_code=code, reason=reason, uptime=uptime, last_lines=lines)

    def measure(self) -> None:
        """Begin to measure the processor time that it uses, if that has not begun."""
        if self._usage is not None and self.running:
            self._usage.begin()

    def measured(self, status: ProcessStatus) -> ProcessStatus:
        """A status with what is known of this child."""
        if not self.running:
            return status
        now, held_up = self._clock(), self.pulse.held_up
        cpu, memory = self._usage.measure() if self._usage is not None else (None, None)
        published, received = self.pulse.rates(now)
        health, trouble = self.pulse.health(now)
        return msgspec.structs.replace(
            status,
            pid=self.pid,
            uptime=round(now - self.started_at, 3),
            cpu=cpu if self.pulse.cpu is None else self.pulse.cpu,
            process_cpu=cpu if self._plan.process is not None else None,
            memory=memory,
            published=published,
            received=received,
            running=held_up.running if held_up is not None else "",
            running_for=held_up.running_for if held_up is not None else 0.0,
            health=health,
            trouble=trouble,
        )

    async def _probe(self) -> bool:
        plan = self._plan
        return await succeeds(plan.ready.probe, self._run.environment(plan), plan.cwd, self._run.spawned)

    def _on_line(self, stream: str, text: str) -> None:
        self._output(stream, text)
        self.readiness.see_line(text)

    def _on_beat(self, data: bytes) -> None:
        beat = self.pulse.hear(data, self._clock())
        if beat is not None and beat.files:
            self.files = tuple(beat.files)
        self._told()
