"""Processes of a run that are none, for tests of what surrounds them: they do at once, or when told, what is asked."""

import asyncio
import signal
from collections.abc import Mapping, Sequence
from typing import Any

import msgspec

from robo.launch.plan import LogPlan, ProcessPlan, ReadyPlan, RestartPlan, StopPlan, Until
from robo.supervisor.changes import Changes
from robo.supervisor.restart import Restarts
from robo.text.tree import Position
from robo.wire.reports import Event, Exit, Explanation, LogRecord, ProcessStatus, State
from tests.virtual_time import now

_NOWHERE = Position("m.yaml", 1, 1)
_PLAIN = ProcessPlan(
    name="base",
    namespace="r1",
    group="",
    hosts=(),
    service="pkg.module",
    run=(),
    prefix=(),
    args=(),
    cwd=None,
    settings={},
    remap={},
    env={},
    needs={},
    watchdog=0.0,
    required=False,
    restart=RestartPlan(),
    stop=StopPlan(),
    ready=ReadyPlan(),
    log=LogPlan(),
    priority=None,
    cpus=(),
    publishes={},
    subscribes={},
    sources={},
    source=_NOWHERE,
)


def process_plan(full_name: str, needs: Mapping[str, Until] | None = None, **changes: Any) -> ProcessPlan:
    """A plan of one process; what is not said is as in a manifest that says nothing."""
    namespace, _, name = full_name.strip("/").rpartition("/")
    return msgspec.structs.replace(_PLAIN, namespace=namespace, name=name, needs=dict(needs or {}), **changes)


def last_exit(reason: str, *last_lines: str, code: int = 1) -> Exit:
    """How a process ended."""
    return Exit(time=1, exit_code=code, reason=reason, uptime=1.0, last_lines=list(last_lines))


class FakeProcess:
    """A process that runs and is ready, unless it is told otherwise."""

    def __init__(self, plan: ProcessPlan, changes: Changes | None = None, *, stops_in: float = 0.0) -> None:
        """It takes `stops_in` seconds to end when it is told to, by the running loop; a kill ends it at once."""
        self.plan = plan
        self.label = plan.full_name.removeprefix("/r1/")
        self.state: State = "ready"
        self.reason = ""
        self.ready = self.running = self.wanted = self.shows_readiness = True
        self.spawning = self.finished = self.failed = self.down = False
        self.pid: int | None = 100
        self.restarts = Restarts(plan.restart)
        self.exits: Sequence[Exit] = []
        self.files: tuple[str, ...] = ()
        self.next_start: float | None = None
        self.started_at, self.ready_at = 1.0, 2.0
        self.family: set[int] = set()
        """Processes that it leads."""
        self.asked: list[str] = []
        """What it was asked to do, in order."""
        self.signals: list[signal.Signals] = []
        self.tokens: list[int] = []
        self.tokens_gone: list[int] = []
        self.told_to_stop: float | None = None
        self.ended: float | None = None
        self._changes = changes or Changes()
        self._stops_in = stops_in
        self._over = asyncio.Event()

    # -- what it has come to ---------------------------------------------------------------------

    def come_to(self, state: State, reason: str = "", **facts: Any) -> "FakeProcess":
        """Change its state, and what else is true of it."""
        self.state, self.reason = state, reason
        for name, fact in facts.items():
            assert hasattr(self, name)
            setattr(self, name, fact)
        return self

    def fail(self, reason: str = "ended with exit code 1") -> "FakeProcess":
        """It has ended and is not started again."""
        gone = {"running": False, "ready": False, "finished": True, "failed": True, "down": True}
        return self.come_to("failed", reason, **gone, exits=[last_exit(reason)])

    def complete(self) -> "FakeProcess":
        """It has done its work and ended well."""
        gone = {"running": False, "ready": False, "finished": True}
        return self.come_to("completed", "ended with exit code 0", **gone, exits=[last_exit("exit code 0", code=0)])

    def wait(self) -> "FakeProcess":
        """It has not been started so far."""
        return self.come_to("starting", "waits", running=False, ready=False)

    def healthy(self) -> bool:
        return self.ready or self.state == "completed"

    def reached(self, until: Until) -> bool:
        return {"started": self.running or bool(self.exits), "completed": self.state == "completed"}.get(
            until, self.ready
        )

    def may_reach(self, until: Until) -> bool:
        return self.reached(until) or not self.finished

    # -- what it is asked ------------------------------------------------------------------------

    def retire(self) -> None:
        self.wanted = False

    async def stop(self) -> None:
        self.asked.append("stop")
        self.wanted = False
        if not self.running:
            return
        self.told_to_stop = now()
        try:
            async with asyncio.timeout(self._stops_in):
                await self._over.wait()
        except TimeoutError:
            self._end()

    async def start(self) -> None:
        self.asked.append("start")
        self.running = self.wanted = True

    async def restart(self, why: str) -> None:
        self.asked.append(f"restart: {why}")
        self.running = self.wanted = True

    def send(self, number: signal.Signals) -> None:
        self.signals.append(number)
        if number == signal.SIGKILL and self.running:
            self._end()

    def come_up(self) -> None:
        """Its start is done."""
        self.spawning, self.running = False, True
        self._changes.notify()

    def _end(self) -> None:
        self.running = self.ready = False
        self.ended = now()
        self._over.set()
        self._changes.notify()

    # -- what it tells ---------------------------------------------------------------------------

    def owns(self, pid: int) -> bool:
        return pid in self.family or pid == self.pid

    def leads(self, pid: int) -> bool:
        return pid in self.family

    def notice_token(self, pid: int) -> None:
        self.tokens.append(pid)

    def notice_token_gone(self, pid: int) -> None:
        self.tokens_gone.append(pid)

    def status(self, robot: str, run: str, host: str) -> ProcessStatus:
        return ProcessStatus(
            robot=robot,
            group=self.plan.group,
            node=self.plan.full_name,
            state=self.state,
            reason=self.reason,
            pid=self.pid,
            restarts=self.restarts.count,
            uptime=None,
            cpu=None,
            memory=None,
            published={},
            received={},
            run=run,
            host=host,
        )

    def explain(self, status: ProcessStatus, unmet: list[str]) -> Explanation:
        return Explanation(
            process=status, exits=list(self.exits), unmet_needs=unmet, inputs=[], callback_errors=0, next_start=None
        )


class FakeJournal:
    """Remembers what it is told."""

    def __init__(self) -> None:
        self.said: list[str] = []
        self.warned: list[str] = []
        self.happened: list[tuple[str, str]] = []
        """Events: what, and to whom; empty for the run."""

    def say(self, text: str) -> None:
        self.said.append(text)

    def warn(self, text: str) -> None:
        self.warned.append(text)

    def event(self, what: str, reason: str = "", process: object = None) -> None:
        assert isinstance(reason, str)
        self.happened.append((what, process.label if isinstance(process, FakeProcess) else ""))


class FakeAudience:
    """Hears what is published."""

    def __init__(self) -> None:
        self.events: list[Event] = []
        self.lines: list[LogRecord] = []

    def publish(self, event: Event) -> None:
        self.events.append(event)

    def publish_line(self, line: LogRecord) -> None:
        self.lines.append(line)


class FakeStopping:
    """Remembers with what exit codes a run was to end."""

    def __init__(self) -> None:
        self.codes: list[int | None] = []

    def finish(self, exit_code: int | None) -> None:
        self.codes.append(exit_code)
