"""One process of a plan: what others ask of it, and tell it."""

import signal
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Protocol

from robo.launch.plan import ProcessPlan, Until
from robo.machine.child import Child
from robo.supervisor import children
from robo.supervisor.children import Children
from robo.supervisor.instance import MakeChild
from robo.supervisor.process_life import STARTING_AGAIN, UP, Phase
from robo.supervisor.readiness import says_more_than_a_start
from robo.supervisor.restart import Restarts
from robo.wire.reports import Exit, Explanation, ProcessStatus, State


class Run(children.Run, Protocol):
    """What a member needs of the run that it is part of."""

    def output(self, member: "Member", stream: str, text: str) -> None:
        """A line that a process has printed."""

    def changed(self, member: "Member", before: State) -> None:
        """A process has come to another state, or to another reason for it."""


class Member:
    """A process of the plan: its child, which a restart replaces, and how far it has come."""

    def __init__(
        self,
        plan: ProcessPlan,
        label: str,
        run: Run,
        make: MakeChild = Child,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """
        Args:
            plan: how it is run.
            label: what it is called in the output.
            run: what it is part of.
            make: makes its children.
            clock: the time, s; it never steps back.
        """
        self.label = label
        self._run = run
        self._clock = clock
        self._children = Children(plan, run, make, clock, partial(run.output, self), partial(run.changed, self))
        self._life = self._children.life

    # -- what others ask -------------------------------------------------------------------------

    @property
    def plan(self) -> ProcessPlan:
        """How it is run; another plan holds from its next start on."""
        return self._life.plan

    @plan.setter
    def plan(self, plan: ProcessPlan) -> None:
        self._life.plan = plan
        self._life.restarts.plan = plan.restart

    @property
    def state(self) -> State:
        """How it is shown."""
        return self._life.state

    @property
    def reason(self) -> str:
        """Why it is in this state."""
        return self._life.reason

    @property
    def restarts(self) -> Restarts:
        """How often it has been started again."""
        return self._life.restarts

    @property
    def ready(self) -> bool:
        """Whether all that tells of readiness has come."""
        return self._life.phase is Phase.READY

    def healthy(self) -> bool:
        """Whether nothing is wrong with it: one that its manifest lets stand by does so."""
        stands_by = self._life.phase is Phase.STANDBY and not self.plan.autostart
        return stands_by or self._life.phase in (Phase.READY, Phase.COMPLETED)

    @property
    def wanted(self) -> bool:
        """Whether it is to run; false once somebody has asked it to stop."""
        return self._life.wanted

    @property
    def finished(self) -> bool:
        """Whether it has ended and nothing starts it again but a command."""
        return self._life.finished

    @property
    def down(self) -> bool:
        """Whether it has failed for good, or is in a storm and tried slowly."""
        return self._life.down

    @property
    def failed(self) -> bool:
        """Whether it has ended badly, and not because it was asked to."""
        return self._life.phase in (Phase.FAILED, Phase.BACKING_OFF)

    @property
    def started_at(self) -> float:
        """When the present child was started, by the clock."""
        return self._life.started_at

    @property
    def ready_at(self) -> float:
        """When the present child became ready, by the clock."""
        return self._life.ready_at

    @property
    def next_start(self) -> float | None:
        """When it is started again, by the clock."""
        return self._life.deadline if self._life.phase is Phase.BACKING_OFF else None

    @property
    def pid(self) -> int | None:
        """The process id while it runs."""
        present = self._children.present
        return present.pid if present is not None and present.running else None

    @property
    def running(self) -> bool:
        """Whether a child of it runs."""
        return self._children.present is not None and self._children.present.running

    @property
    def spawning(self) -> bool:
        """Whether a child is just being started."""
        return self._children.spawning

    @property
    def exits(self) -> Sequence[Exit]:
        """How its last children ended, oldest first."""
        return self._children.exits

    @property
    def files(self) -> tuple[str, ...]:
        """The source files of a node, where the run watches them."""
        return self._children.files

    @property
    def shows_readiness(self) -> bool:
        """Whether being ready says more than having been started."""
        return says_more_than_a_start(self.plan.ready)

    def reached(self, until: Until) -> bool:
        """Whether it has come as far as another process needs it."""
        if until == "started":
            return self._life.starts > 0
        if until == "completed":
            return self._life.phase is Phase.COMPLETED
        return self.ready

    def may_reach(self, until: Until) -> bool:
        """Whether it can still come so far without a command."""
        return self.reached(until) or not self.finished

    def owns(self, pid: int) -> bool:
        """Whether a process is the child, or was started by it: a debugger or a script in between."""
        return self._children.present is not None and self._children.present.owns(pid)

    def leads(self, pid: int) -> bool:
        """Whether a process of this machine is the child, or in its process group."""
        return self._children.present is not None and self._children.present.leads(pid)

    def status(self, robot: str, run: str, host: str) -> ProcessStatus:
        """Its present state in figures."""
        status = ProcessStatus(
            robot=robot,
            group=self.plan.group,
            node=self.plan.full_name,
            state=self.state,
            reason=self.reason,
            pid=None,
            restarts=self.restarts.count,
            uptime=None,
            cpu=None,
            memory=None,
            published={},
            received={},
            run=run,
            host=host,
            process=self.plan.process or "",
        )
        return self._children.present.measured(status) if self._children.present is not None else status

    def explain(self, status: ProcessStatus, unmet: list[str]) -> Explanation:
        """Why it is as it is."""
        now, pulse = self._clock(), self._children.present.pulse if self._children.present is not None else None
        return Explanation(
            process=status,
            exits=list(self.exits),
            unmet_needs=unmet,
            inputs=pulse.inputs(now) if pulse is not None and self.running else [],
            callback_errors=pulse.callback_errors if pulse is not None else 0,
            next_start=max(0.0, self.next_start - now) if self.next_start is not None else None,
            checks=pulse.checks if pulse is not None and self.running else [],
        )

    # -- commands --------------------------------------------------------------------------------

    async def start(self) -> None:
        """Start it, if it does not run; returns when the process is there, or waits for what it needs."""
        begun = self._life.starts
        if self.running or self.spawning:
            self._life.start_asked()
        else:  # one that has just died, and whose end is not noted yet, is to run too
            self._life.restart_asked(STARTING_AGAIN)
        await self._run.changes.until(lambda: self._life.phase in UP or self._has_started_since(begun))

    async def restart(self, why: str) -> None:
        """End it, if it runs, and start it again at once; returns when the new process is there, or waits."""
        begun = self._life.starts
        self._life.restart_asked(why)
        await self._run.changes.until(lambda: self._has_started_since(begun))

    async def stop(self) -> None:
        """Stop it and leave it so; returns when it has ended."""
        self._life.stop_asked()
        await self._run.changes.until(lambda: self.finished or self.wanted)

    def retire(self) -> None:
        """The run ends: it is not started any more; if it runs, it goes on until it is told to stop."""
        self._life.run_ends()

    def _has_started_since(self, begun: int) -> bool:
        waits = self._life.phase is Phase.WAITING and bool(self._run.unmet(self.plan))
        return self._life.starts != begun or not self.wanted or waits

    def send(self, number: signal.Signals) -> None:
        """Send a signal to the process and its group."""
        self._children.send(number)

    async def live(self) -> None:
        """Run the process again and again as its policy and its commands want, until cancelled."""
        await self._children.live()

    # -- what it is told -------------------------------------------------------------------------

    def notice_token(self, pid: int) -> None:
        """The node's liveliness token shows."""
        self._children.notice_token(pid)

    def notice_token_gone(self, pid: int) -> None:
        """The node's liveliness token shows no more."""
        self._children.notice_token_gone(pid)

    def check(self, now: float) -> None:
        """Look after a process that runs; called a few times a second."""
        self._children.check(now)

    def excuse_silence(self, now: float) -> None:
        """The supervisor itself has slept: nobody can be blamed for beats that it did not hear."""
        if self._children.present is not None:
            self._children.present.pulse.excuse_silence(now)

    def measure(self) -> None:
        """Begin to measure the processor time that it uses, if that has not begun."""
        if self._children.present is not None:
            self._children.present.measure()
