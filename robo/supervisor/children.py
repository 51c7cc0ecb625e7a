"""The children of one process, one after the other.

`ProcessLife` decides what is to be done; `Instance` is the child that it is done to. Here the one is told what happens
to the other.
"""

import asyncio
import signal
import time
from collections import deque
from collections.abc import Callable
from typing import Protocol

from robo.launch.plan import ProcessPlan
from robo.machine.child import describe_exit
from robo.machine.orphans import Left
from robo.supervisor import instance
from robo.supervisor.alarm import Alarm
from robo.supervisor.changes import Changes
from robo.supervisor.instance import Instance, MakeChild
from robo.supervisor.process_life import CANNOT_START, Phase, ProcessLife
from robo.supervisor.restart import Restarts
from robo.wire.reports import Exit, State

_EXITS = 20
"""How many ends are remembered."""


class Run(instance.Run, Protocol):
    """What they need of the run that they are part of."""

    changes: Changes

    def unmet(self, plan: ProcessPlan) -> list[str]:
        """What a process still waits for, in words."""

    def sigkill_hint(self) -> str:
        """What is to be said of a process that has just been ended by a SIGKILL that nobody here has sent."""

    def left_behind(self, left: Left) -> None:
        """A process was still there when the one that had started it was gone; it has been ended."""


class Children:
    """Starts a child, looks after it, notes its end, and starts the next one, as their life wants it."""

    def __init__(
        self,
        plan: ProcessPlan,
        run: Run,
        make: MakeChild,
        clock: Callable[[], float],
        output: Callable[[str, str], None],
        changed: Callable[[State], None],
    ) -> None:
        """
        Args:
            plan: how they are run.
            run: what they are part of.
            make: makes a child.
            clock: the time, s.
            output: takes what they print, by stream.
            changed: is told when they are shown in another way, with the state before.
        """
        self.life = ProcessLife(plan, Restarts(plan.restart), clock, self)
        self.present: Instance | None = None
        """The child that runs, or the last one that ran."""
        self.exits: deque[Exit] = deque(maxlen=_EXITS)
        self._run = run
        self._make = make
        self._clock = clock
        self._output = output
        self._changed = changed
        self._alarm = Alarm(self.life.elapsed, clock)
        self._ended_pids: deque[int] = deque(maxlen=_EXITS)
        """Of the last ones that have ended: their tokens may still be on the way."""
        self._files: tuple[str, ...] = ()
        """Of those before the present one."""
        self._readiness: asyncio.Task[None] | None = None
        """Waits for what tells that the present one is ready."""

    @property
    def spawning(self) -> bool:
        """Whether one is just being started."""
        on_its_way = self.life.phase in (Phase.SPAWNING, Phase.STOPPING, Phase.RESTARTING)
        return on_its_way and self.present is not None and self.present.pid is None

    @property
    def files(self) -> tuple[str, ...]:
        """The source files of the last one that has told them."""
        return (self.present.files if self.present is not None else ()) or self._files

    async def live(self) -> None:
        """Run one child after the other until cancelled."""
        try:
            while True:
                await self._run.changes.until(self._is_to_start)
                await self._run_once()
        finally:
            self._alarm.set(None)

    def notice_token(self, pid: int) -> None:
        """A node's liveliness token shows; it may be that of a child that has ended."""
        if self.present is not None and pid not in self._ended_pids:
            self.present.readiness.see_token()

    def notice_token_gone(self, pid: int) -> None:
        """A node's liveliness token shows no more."""
        if self.present is not None and pid not in self._ended_pids:
            self.present.readiness.lose_token()

    def check(self, now: float) -> None:
        """Look after a child; called a few times a second."""
        if self.present is None or not self.present.running:
            return
        if self.present.is_over_limit():
            self.present.send(signal.SIGKILL)
            return
        if self.life.phase not in (Phase.READY, Phase.STANDBY):
            return
        pulse = self.present.pulse
        hang, problem = pulse.hang(now), pulse.problem(now)
        silent = pulse.silent_topic(now) if problem is not None else None
        if (hang or silent) and self.present.is_exiting():  # nothing would end it sooner, and its exit says why
            self.life.checked("is ending, or was killed, and its process is not gone yet")
        elif hang is not None:
            self.life.hung(hang)
        elif self.life.phase is Phase.STANDBY:
            self._heed_lifecycle()
        else:
            self.life.checked(problem, silent)

    def _is_to_start(self) -> bool:
        if self.life.phase is Phase.WAITING:
            self.life.needs_are(self._run.unmet(self.life.plan))
        return self.life.phase is Phase.SPAWNING

    async def _run_once(self) -> None:
        """Start a child, and wait for its end."""
        self._files = self.files
        told = self._heed_lifecycle
        child = Instance(self.life.plan, self._run, self._make, self._output, self._clock, told)
        self.present = child
        try:
            why = await child.start()
        except Exception as error:  # a mistake of robo's own: this life is over, and nobody is to wait for the child
            self.life.could_not_start(f"cannot be started: {error!r}")
            raise
        if why is not None:
            self.exits.append(child.exit(CANNOT_START, why, time.time_ns()))
            self.life.could_not_start(why)
            return
        self.life.spawned()
        self._readiness = asyncio.create_task(self._become_ready(child))
        try:
            code = await child.wait()
        finally:
            self._readiness.cancel()
        hint = child.limit_reached(code) if self.life.unasked else ""
        if not hint and code == -signal.SIGKILL and self.life.unasked:
            hint = self._run.sigkill_hint()
        words = describe_exit(code) + hint
        for left in child.left:
            self._run.left_behind(left._replace(node=self.life.plan.full_name))
        if child.pid is not None:
            self._ended_pids.append(child.pid)
        self.exits.append(child.exit(code, self.life.blame or words, time.time_ns()))
        self.life.exited(code, words)

    def _heed_lifecycle(self) -> None:
        """A managed node stands by while it is not active, and may be ready again once it is."""
        child = self.present
        if child is None or not child.running:
            return
        state = child.pulse.lifecycle
        if state not in ("", "active"):
            self.life.stands_by(state)
        elif self.life.phase is Phase.STANDBY and self._readiness is not None and self._readiness.done():
            self._readiness = asyncio.create_task(self._become_ready(child))

    async def _become_ready(self, child: Instance) -> None:
        await child.readiness.wait()
        child.pulse.became_ready(self._clock())
        self.life.became_ready()

    # What their life asks.

    def send(self, number: signal.Signals) -> None:
        """Send a signal to the child and its group."""
        if self.present is not None:
            self.present.send(number)

    def lacks(self) -> str:
        """What the child's readiness still waits for, in words."""
        return self.present.readiness.missing if self.present is not None else ""

    def moved(self) -> None:
        """There is another phase or another deadline."""
        self._alarm.set(self.life.deadline)
        self._run.changes.notify()

    def changed(self, before: State) -> None:
        """They are shown in another way."""
        self._changed(before)
