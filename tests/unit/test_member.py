"""A member and its children, with children that are no processes."""

import asyncio
import signal
from collections import deque
from collections.abc import Callable, Coroutine, Mapping, Sequence
from typing import Any

import msgspec
import pytest

from robo.launch.plan import ProcessPlan, ReadyPlan, RestartPlan, StopPlan
from robo.machine.child import Spawned
from robo.machine.forks import Fork, Template
from robo.machine.limit_groups import LimitGroups
from robo.machine.limits import Limiter
from robo.machine.orphans import Left
from robo.supervisor.changes import Changes
from robo.supervisor.member import Member
from robo.supervisor.topic_watch import Flow
from robo.wire.reports import Beat, NodeStatus, State
from tests import virtual_time
from tests.plans import node_plan

SOON = RestartPlan(policy="on-failure", delay=0.01, jitter=0.0)
PID = 4_000_000
"""Beyond the ids that a kernel gives."""


class FakeChild:
    """A child that starts when its run lets it, and ends when it is told to, or by the first signal that it obeys."""

    def __init__(
        self,
        run: "FakeRun",
        on_line: Callable[[str, str], None],
        on_beat: Callable[[bytes], None] | None,
        period: float,
    ) -> None:
        self.last_lines: deque[str] = deque(["last words"])
        self.left: Sequence[Left] = ()
        self.pid: int | None = None
        self.line = on_line
        self.beat = on_beat
        self.period = period
        self.command: Sequence[str] = ()
        self.sent: list[signal.Signals] = []
        self._run = run
        self._code: asyncio.Future[int] = asyncio.get_running_loop().create_future()

    @property
    def running(self) -> bool:
        return self.pid is not None and not self._code.done()

    async def start(
        self, command: Sequence[str], environment: Mapping[str, str], *, cwd: str | None, fork: Fork | None
    ) -> None:
        assert environment == {"HERE": "yes"}
        assert fork is None
        assert cwd == self._run.cwd
        self.command = command
        await self._run.may_spawn.wait()
        if self._run.defect is not None:
            raise self._run.defect
        if self._run.missing is not None:
            raise FileNotFoundError(2, "No such file or directory", self._run.missing)
        self.pid = PID + len(self._run.made)

    async def wait(self) -> int:
        code = await self._code
        await self._run.drained.wait()
        return code

    def send(self, number: signal.Signals) -> None:
        if number != signal.SIGCONT and self.running:
            self.sent.append(number)
            if number in self._run.obeyed:
                self.end(-number)

    def end(self, code: int) -> None:
        self._code.set_result(code)


class FakeRun:
    """The run around one member."""

    def __init__(self, **plan: object) -> None:
        self.changes = Changes()
        self.spawned = Spawned(1, lambda _pid, _running: None)
        self.template: Template | None = None
        self.limiter = Limiter(LimitGroups("run", None, 1, {}))
        self.may_spawn = asyncio.Event()
        self.may_spawn.set()
        self.drained = asyncio.Event()
        """Whether the output of a child that has ended is complete."""
        self.drained.set()
        self.defect: Exception | None = None
        """A mistake of robo's own in a start."""
        self.obeyed = {signal.SIGINT, signal.SIGKILL}
        self.missing: str | None = None
        self.waits_for: list[str] = []
        self.made: list[FakeChild] = []
        self.lines: list[str] = []
        self.states: list[State] = []
        self.hints = 0
        made = node_plan(**{"ready": ReadyPlan(when="started"), **plan})
        self.cwd = made.cwd
        self.member = Member(made, "node", self, self._make, virtual_time.now)
        self.life = asyncio.create_task(self.member.live())

    def _make(
        self,
        _: Spawned,
        on_line: Callable[[str, str], None],
        on_beat: Callable[[bytes], None] | None,
        period: float,
    ) -> FakeChild:
        self.made.append(FakeChild(self, on_line, on_beat, period))
        return self.made[-1]

    def environment(self, plan: ProcessPlan) -> dict[str, str]:
        assert plan is self.member.plan
        return {"HERE": "yes"}

    def unmet(self, _: ProcessPlan) -> list[str]:
        return self.waits_for

    def flow(self, _: str) -> Flow | None:
        return None

    def sigkill_hint(self) -> str:
        self.hints += 1
        return ", by somebody"

    def left_behind(self, left: Left) -> None:
        self.lines.append(left.sentence(left.node))

    def output(self, member: Member, stream: str, text: str) -> None:
        assert member is self.member
        self.lines.append(f"{stream} {text}")

    def changed(self, member: Member, before: State) -> None:
        assert before == (self.states[-1] if self.states else "starting")
        if member.state != before:
            self.states.append(member.state)
        self.changes.notify()

    async def until(self, condition: Callable[[], bool]) -> None:
        await self.changes.until(condition)

    async def until_state(self, state: State) -> None:
        await self.until(lambda: self.member.state == state)

    @property
    def child(self) -> FakeChild:
        return self.made[-1]


def play(scene: Callable[[], Coroutine[Any, Any, None]]) -> None:
    """Run a scene, in a time that jumps; what waits for ever is found."""
    virtual_time.run(scene())


def beat(**changes: object) -> bytes:
    status = NodeStatus(node="/r1/node", published={}, received={}, malformed={}, dropped={}, callback_errors=0)
    return msgspec.msgpack.encode(Beat(msgspec.structs.replace(status, **changes), files=["node.py"]))


def test_what_a_child_has_left_behind_is_told_with_its_node() -> None:
    async def scene() -> None:
        run = FakeRun(restart=RestartPlan(policy="never"))
        await run.until_state("ready")
        run.child.left = [Left(7, "", "sleep 600")]
        run.child.end(1)
        await run.until_state("failed")
        assert run.lines == ["ended process 7, which /r1/node had left behind: sleep 600"]
        assert Left.read(run.lines[0]) == Left(7, "/r1/node", "sleep 600")

    play(scene)


def test_a_process_is_started_once_what_it_needs_is_there() -> None:
    async def scene() -> None:
        run = FakeRun(needs={"/r1/base": "ready"})
        run.waits_for = ["base ready"]
        await run.until(lambda: run.member.reason == "waits for base ready")
        assert not run.made
        assert not run.member.reached("started")
        run.waits_for = []
        run.changes.notify()
        await run.until_state("ready")
        assert run.child.command[-2:] == ("package.module", "/r1/node")
        assert run.member.reached("started")
        assert run.member.reached("ready")
        assert not run.member.reached("completed")
        assert run.member.pid == run.child.pid == PID + 1
        assert run.member.owns(PID + 1)
        assert not run.member.leads(1)

    play(scene)


def test_a_node_is_ready_by_its_token_but_not_by_that_of_a_child_that_has_ended() -> None:
    async def scene() -> None:
        run = FakeRun(ready=ReadyPlan(), restart=SOON)
        await run.until(lambda: run.member.running)
        run.member.notice_token(PID + 1)
        await run.until_state("ready")
        run.child.end(1)
        await run.until(lambda: len(run.made) == 2 and run.member.running)
        run.member.notice_token(PID + 1)
        for _ in range(5):
            await asyncio.sleep(0)
        assert run.member.state == "starting"
        run.member.notice_token(PID + 2)
        await run.until_state("ready")
        assert run.states == ["ready", "restarting", "starting", "ready"]

    play(scene)


def test_a_line_tells_of_readiness_and_is_handed_on() -> None:
    async def scene() -> None:
        run = FakeRun(ready=ReadyPlan(when="started", log="up"))
        await run.until(lambda: run.member.running)
        run.child.line("stdout", "coming up")
        await run.until_state("ready")
        assert run.lines == ["stdout coming up"]
        assert run.member.shows_readiness

    play(scene)


def test_what_is_not_ready_in_time_is_ended() -> None:
    async def scene() -> None:
        run = FakeRun(ready=ReadyPlan(timeout=0.01))
        await run.until_state("failed")
        assert run.child.sent == [signal.SIGINT]
        assert run.member.reason == "not ready within 0.01 s: its liveliness token does not show"
        assert run.member.exits[-1].reason == run.member.reason
        assert run.hints == 0
        assert run.member.down
        assert run.member.failed

    play(scene)


def test_a_killed_process_is_told_and_started_again() -> None:
    async def scene() -> None:
        run = FakeRun(restart=SOON)
        await run.until_state("ready")
        run.child.end(-9)
        await run.until_state("restarting")
        assert run.member.reason == "was killed by SIGKILL, by somebody; starting it again in 0.01 s"
        assert run.member.failed
        assert not run.member.down
        assert run.member.next_start is not None
        assert run.member.may_reach("ready")
        why = run.member.explain(run.member.status("r1", "id", "here"), ["base ready"])
        assert why.next_start is not None
        assert 0.0 <= why.next_start <= 0.01
        assert why.unmet_needs == ["base ready"]
        (end,) = why.exits
        assert (end.exit_code, end.reason, end.last_lines) == (-9, "killed by SIGKILL, by somebody", ["last words"])
        await run.until_state("ready")
        assert run.member.restarts.count == 1
        assert run.member.next_start is None

    play(scene)


def test_a_program_that_is_not_there() -> None:
    async def scene() -> None:
        run = FakeRun(run=("lidar", "-v"), service=None, cwd="/there")
        run.missing = "lidar"
        await run.until_state("failed")
        assert run.member.reason == "cannot be started in /there: No such file or directory: lidar"
        assert run.member.exits[-1].exit_code == 127
        assert not run.member.spawning
        assert not run.member.owns(1)

    play(scene)


def test_what_cannot_be_started_for_a_mistake_of_robo_itself_holds_up_no_end() -> None:
    async def scene() -> None:
        run = FakeRun()
        run.defect = RuntimeError("a mistake")
        with pytest.raises(RuntimeError, match="a mistake"):
            await run.life
        assert not run.member.spawning
        run.member.retire()
        await run.member.stop()

    play(scene)


def test_a_stop_returns_when_the_process_has_ended() -> None:
    async def scene() -> None:
        run = FakeRun(stop=StopPlan(signal="TERM", timeout=0.02))
        await run.until_state("ready")
        await run.member.stop()
        assert run.child.sent == [signal.SIGTERM, signal.SIGTERM, signal.SIGKILL]
        assert run.states == ["ready", "stopping", "stopped"]
        assert run.hints == 0, "it is known who has sent it"
        assert run.member.finished
        assert not run.member.may_reach("ready")

    play(scene)


def test_a_stop_reaches_a_child_that_is_just_being_started() -> None:
    async def scene() -> None:
        run = FakeRun()
        run.may_spawn.clear()
        await run.until(lambda: run.member.spawning)
        stop = asyncio.create_task(run.member.stop())
        await run.until_state("stopping")
        assert run.member.spawning
        run.may_spawn.set()
        await stop
        assert run.child.sent == [signal.SIGINT]
        assert run.member.state == "stopped"

    play(scene)


def test_a_stop_that_is_taken_back_ends_too() -> None:
    async def scene() -> None:
        run = FakeRun()
        run.obeyed = set()
        await run.until_state("ready")
        stop = asyncio.create_task(run.member.stop())
        await run.until_state("stopping")
        restart = asyncio.create_task(run.member.restart("as asked"))
        await stop
        run.child.end(0)
        await restart
        assert len(run.made) == 2

    play(scene)


def test_a_restart_returns_when_the_new_process_is_there_or_waits() -> None:
    async def scene() -> None:
        run = FakeRun()
        await run.until_state("ready")
        await run.member.restart("as asked")
        assert [child.running for child in run.made] == [False, True]
        assert run.member.restarts.count == 1
        run.waits_for = ["base ready"]
        await run.member.restart("starting again with base, which it needs")
        await run.until(lambda: run.member.reason == "waits for base ready")
        await run.member.start()
        assert len(run.made) == 2

    play(scene)


def test_what_was_stopped_is_started_by_a_command() -> None:
    async def scene() -> None:
        run = FakeRun()
        await run.until_state("ready")
        await run.member.stop()
        wishes = [run.member.wanted]
        await run.member.start()
        await run.until_state("ready")
        assert [*wishes, run.member.wanted] == [False, True]
        await run.member.start()
        assert len(run.made) == 2, "it runs already"

    play(scene)


def test_what_has_just_died_is_started_by_a_command() -> None:
    async def scene() -> None:
        run = FakeRun()
        await run.until_state("ready")
        run.drained.clear()
        run.child.end(1)
        start = asyncio.create_task(run.member.start())
        await asyncio.sleep(0.1)
        run.drained.set()
        await start
        assert run.member.running
        assert len(run.made) == 2

    play(scene)


def test_a_restart_does_not_return_before_the_old_process_has_ended() -> None:
    async def scene() -> None:
        run = FakeRun()
        run.obeyed = set()
        await run.until_state("ready")
        run.waits_for = ["base ready"]
        restart = asyncio.create_task(run.member.restart("as asked"))
        await asyncio.sleep(0.1)
        assert not restart.done()
        run.child.end(0)
        await restart
        assert not run.member.running

    play(scene)


def test_nothing_starts_once_the_run_ends_and_what_runs_goes_on() -> None:
    async def scene() -> None:
        run = FakeRun(restart=SOON)
        await run.until_state("ready")
        run.member.retire()
        assert run.member.running
        run.child.end(1)
        await run.until_state("stopped")
        await run.member.restart("changed: a.py")
        assert len(run.made) == 1

    play(scene)


def test_what_hangs_is_asked_where_it_is() -> None:
    async def scene() -> None:
        run = FakeRun(watchdog=2.0, required=True, restart=SOON)
        run.obeyed = {signal.SIGABRT}
        await run.until_state("ready")
        assert run.child.period == 0.5
        assert run.child.beat is not None
        run.child.beat(beat(published={"odom": 1}))
        now = run.member.ready_at
        run.member.check(now + 1.0)
        assert run.member.state == "ready"
        run.member.excuse_silence(now + 100.0)
        run.member.check(now + 101.0)
        assert run.member.state == "ready"
        run.member.check(now + 103.0)
        await run.until_state("restarting")
        assert run.child.sent == [signal.SIGABRT]
        assert run.member.exits[-1].reason == "hangs: no sign of life for 3.0 s"
        await run.until_state("ready")
        assert run.member.files == ("node.py",), "the new one has not told its own yet"

    play(scene)


def test_its_figures_are_those_of_the_child_that_runs() -> None:
    async def scene() -> None:
        run = FakeRun(restart=RestartPlan(policy="always", delay=60.0))
        await run.until_state("ready")
        assert run.child.beat is not None
        run.child.beat(beat(received={"scan": 3}, callback_errors=2))
        status = run.member.status("r1", "id", "here")
        assert (status.robot, status.group, status.node, status.state) == ("r1", "g", "/r1/node", "ready")
        assert (status.pid, status.run, status.host) == (PID + 1, "id", "here")
        assert status.uptime is not None
        assert status.cpu is None, "there is no such process"
        why = run.member.explain(status, [])
        assert [(one.topic, one.received) for one in why.inputs] == [("scan", 3)]
        assert why.callback_errors == 2
        run.child.end(0)
        await run.until_state("restarting")
        ended = run.member.status("r1", "id", "here")
        assert (ended.pid, ended.uptime, ended.restarts) == (None, None, 1)
        assert run.member.explain(ended, []).inputs == []

    play(scene)


def test_another_plan_holds_from_the_next_start_on() -> None:
    async def scene() -> None:
        run = FakeRun()
        await run.until_state("ready")
        other = node_plan(ready=ReadyPlan(when="started"), restart=SOON)
        run.member.plan = msgspec.structs.replace(other, name="other")
        assert run.child.command[-1] == "/r1/node"
        await run.member.restart("changed: its part of the manifest")
        assert run.child.command[-1] == "/r1/other"
        run.child.end(1)
        await run.until_state("restarting")

    play(scene)


def test_a_life_that_is_cut_short_leaves_no_alarm() -> None:
    async def scene() -> None:
        run = FakeRun(restart=SOON)
        await run.until_state("ready")
        run.child.end(1)
        await run.until_state("restarting")
        run.life.cancel()
        await asyncio.gather(run.life, return_exceptions=True)
        await asyncio.sleep(0.03)
        assert run.member.state == "restarting"
        assert run.member.next_start is not None

    play(scene)


def said(lifecycle: str) -> bytes:
    return msgspec.msgpack.encode(Beat(NodeStatus("/r1/node", {}, {}, {}, {}, 0, lifecycle=lifecycle)))


def test_a_managed_node_is_ready_while_it_is_active() -> None:
    async def scene() -> None:
        run = FakeRun(ready=ReadyPlan(), autostart=False)
        await run.until(lambda: run.member.running)
        assert run.child.beat is not None
        run.child.beat(said("unconfigured"))
        assert (run.member.state, run.member.reason) == ("standby", "unconfigured")
        assert run.member.healthy(), "its manifest wants it so"
        assert not run.member.ready, "who needs it waits"
        run.child.beat(said("active"))
        assert run.member.state == "standby", "its token does not show yet"
        run.member.notice_token(PID + 1)
        await run.until_state("ready")
        run.child.beat(said("deactivating"))
        run.member.notice_token_gone(PID + 1)
        run.child.beat(said("inactive"))
        assert (run.member.state, run.member.reason) == ("standby", "inactive")
        run.child.beat(said("active"))
        for _ in range(5):
            await asyncio.sleep(0)
        assert run.member.state == "standby"
        run.member.notice_token(PID + 1)
        await run.until_state("ready")

    play(scene)


def test_it_does_not_matter_whether_a_token_or_a_beat_comes_first() -> None:
    async def scene() -> None:
        run = FakeRun(ready=ReadyPlan())
        await run.until(lambda: run.member.running)
        run.member.notice_token(PID + 1)
        await run.until_state("ready")
        assert run.child.beat is not None
        # Deactivated and activated at once: the tokens have come before the beats.
        run.member.notice_token_gone(PID + 1)
        run.member.notice_token(PID + 1)
        for state in ("deactivating", "inactive", "activating", "active"):
            run.child.beat(said(state))
        await run.until_state("ready")
        assert not run.member.finished

    play(scene)


def test_a_managed_node_that_somebody_has_deactivated_is_not_as_its_manifest_wants_it() -> None:
    async def scene() -> None:
        run = FakeRun(ready=ReadyPlan())
        await run.until(lambda: run.member.running)
        run.member.notice_token(PID + 1)
        await run.until_state("ready")
        assert run.child.beat is not None
        run.child.beat(said("inactive"))
        assert not run.member.healthy()
        await run.member.stop()
        assert run.states == ["ready", "standby", "stopping", "stopped"]

    play(scene)
