"""One process of a plan and its life: waiting for what it needs, starting, ready, ended, started again."""

import asyncio
import math
import os
import re
import shlex
import signal
import time
from collections import deque
from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Protocol

import msgspec

from robo.launch.plan import ProcessPlan, Until
from robo.machine.child import Child, Spawned, describe_exit
from robo.machine.forks import Template
from robo.supervisor.changes import Changes
from robo.supervisor.restart import Restarts
from robo.supervisor.topic_watch import Flow
from robo.text.unreadable import UNREADABLE
from robo.wire.reports import Beat, Exit, Explanation, Input, ProcessStatus, State

if TYPE_CHECKING:
    import psutil  # which a start does without

CANNOT_START = 127
"""The exit code of a process that could not even be started, as shells have it."""

BEAT_PERIOD = 1.0
"""How often nodes give a sign of life, s; more often where the watchdog is shorter than a few of these."""

_PROBE_PERIOD = 0.2
_LEAST_MEASURED = 0.5
"""Over how long the processor time of a process is measured at least, s."""
_LAST_WORDS = 1.0
"""How long a node that hangs is given to say where, s."""


class Run(Protocol):
    """What a member needs of the run that it is part of."""

    changes: Changes
    spawned: Spawned
    template: Template | None

    def environment(self, plan: ProcessPlan) -> dict[str, str]:
        """The environment of a process; each start has its own."""

    def unmet(self, plan: ProcessPlan) -> list[str]:
        """What a process still waits for, in words."""

    def flow(self, key: str) -> Flow | None:
        """What comes on a topic that is watched."""

    def sigkill_hint(self) -> str:
        """What is to be said of a process that has just been ended by a SIGKILL that nobody here has sent."""

    def output(self, member: "Member", stream: str, text: str) -> None:
        """A line that a process has printed."""

    def changed(self, member: "Member", before: State) -> None:
        """A process has come to another state, or to another reason for it."""


class Member:
    """A process of the plan: its child, which a restart replaces, and how far it has come."""

    def __init__(self, plan: ProcessPlan, label: str, run: Run) -> None:
        self.plan = plan
        self.label = label
        """What it is called in the output."""
        self.state: State = "starting"
        self.reason = ""
        self.ready = False
        self.wanted = True
        """Whether it is to run; false once somebody has asked it to stop."""
        self.spawning = False
        """Whether a child is just being started."""
        self.finished = False
        """Whether it has ended and nothing starts it again but a command."""
        self.restarts = Restarts(plan.restart)
        self.exits: deque[Exit] = deque(maxlen=20)
        self.files: tuple[str, ...] = ()
        """The source files of a node, where the run watches them."""
        self.started_at = self.ready_at = 0.0
        """When the present child was started and became ready, by the monotonic clock."""
        self.next_start: float | None = None
        """When it is started again, by the monotonic clock."""
        self._run = run
        self._child: Child | None = None
        self._ended: asyncio.Task[int] | None = None
        self._again = False
        self._killed_because = ""
        self._end_in_words = ""
        self._ended_pids: deque[int] = deque(maxlen=20)
        """Of the last children that have ended: their tokens may still be on the way."""
        self._token_seen = asyncio.Event()
        self._line_seen = asyncio.Event()
        self._pattern = re.compile(plan.ready.log) if plan.ready.log is not None else None
        self._beat: Beat | None = None
        self._beat_at = 0.0
        self._late: Beat | None = None
        """What it says while a callback holds its beat back."""
        self._rates: tuple[dict[str, float], dict[str, float]] = {}, {}
        self._input_seen: dict[str, tuple[int, float]] = {}
        self._usage: psutil.Process | None = None
        self._used: tuple[float | None, int | None] = None, None
        self._measured_at = -math.inf

    # -- what others ask -------------------------------------------------------------------------

    @property
    def pid(self) -> int | None:
        """The process id while it runs."""
        return self._child.pid if self._child is not None and self._child.running else None

    @property
    def running(self) -> bool:
        """Whether a child of it runs."""
        return self._child is not None and self._child.running

    @property
    def down(self) -> bool:
        """Whether it has failed for good, or is in a storm and tried slowly."""
        return self.state == "failed" or (self.state == "degraded" and not self.running)

    @property
    def failed(self) -> bool:
        """Whether it has ended badly, and not because it was asked to."""
        return self.down or (self.state == "restarting" and not self.running)

    def reached(self, until: Until) -> bool:
        """Whether it has come as far as another process needs it."""
        if until == "started":
            return self._child is not None
        if until == "completed":
            return self.state == "completed"
        return self.ready

    def may_reach(self, until: Until) -> bool:
        """Whether it can still come so far without a command."""
        return self.reached(until) or not self.finished

    def owns(self, pid: int) -> bool:
        """Whether a process is the child, or was started by it: a debugger or a script in between."""
        own = self._child.pid if self._child is not None else None
        if own is None or pid == own or self.leads(pid):
            return own is not None
        import psutil

        try:
            return any(p.pid == own for p in psutil.Process(pid).parents())
        except psutil.Error:
            return False

    def leads(self, pid: int) -> bool:
        """Whether a process of this machine is the child, or in its process group."""
        own = self.pid
        try:
            return own is not None and os.getpgid(pid) == own
        except OSError:
            return False

    @property
    def shows_readiness(self) -> bool:
        """Whether being ready says more than having been started."""
        ready = self.plan.ready
        return ready.when == "node" or bool(ready.log or ready.port or ready.probe or ready.topics)

    def healthy(self) -> bool:
        """Whether nothing is wrong with it."""
        return self.ready or self.state == "completed"

    # -- its life --------------------------------------------------------------------------------

    async def live(self) -> None:
        """Run the process again and again as its policy and its commands want, until cancelled."""
        while True:
            await self._wait_for_needs()
            code = await self._run_once()
            delay: float | None = None
            if self._again:
                delay = 0.0
            elif self.wanted:
                delay = self.restarts.after_end(time.monotonic(), failed=code != 0)
            self.finished = delay is None
            if not self.wanted:
                self._become("stopped", "as asked")
            elif not self._again:
                self._settle(code, delay)
            self._again = False
            await self._wait_for_restart(delay)

    async def _wait_for_needs(self) -> None:
        def free() -> bool:
            waits_for = self._run.unmet(self.plan)
            if waits_for and self.wanted:
                self._become("starting", f"waits for {', '.join(waits_for)}")
            return self.wanted and not waits_for

        await self._run.changes.until(free)
        self.finished = False

    async def _wait_for_restart(self, delay: float | None) -> None:
        """Wait until the delay is over or somebody wants it to start now."""
        self.next_start = time.monotonic() + delay if delay is not None else None
        self._run.changes.notify()
        with suppress(TimeoutError):
            async with asyncio.timeout(delay):
                await self._run.changes.until(lambda: self._again or (delay is not None and not self.wanted))
        self.next_start = None
        if not self.wanted:  # asked to stop before it was started again
            self.finished = True
            self._become("stopped", "as asked")
            await self._run.changes.until(lambda: self._again)
        self._again = self.finished = False

    async def _run_once(self) -> int:
        """Start a child, bring it to readiness, and wait for its end.

        Returns:
            Its exit code.
        """
        plan = self.plan
        command = plan.command()
        template = self._run.template if plan.plain else None
        beats = plan.service is not None or plan.ready.when == "node"
        period = min(BEAT_PERIOD, plan.watchdog / 4) if plan.watchdog else BEAT_PERIOD
        self._child = Child(self._run.spawned, self._on_line, self._on_beat if beats else None, period)
        self._token_seen.clear()
        self._line_seen.clear()
        self._beat, self._late, self._input_seen, self._usage = None, None, {}, None
        self._rates = {}, {}
        self._killed_because = ""
        self.started_at = time.monotonic()
        self._become("starting", "")
        self.spawning = True
        fork = template.module(plan.module) if template is not None else None
        try:
            await self._child.start(command, self._run.environment(plan), cwd=plan.cwd, fork=fork)
        except OSError as error:
            place = f" in {plan.cwd}" if plan.cwd else ""
            self._killed_because = f"cannot be started{place}: {error.strerror}: {error.filename or command[0]}"
            return self._note_end(CANNOT_START)
        finally:
            self.spawning = False
            self._run.changes.notify()
        self._give_priority()
        self._ended = asyncio.create_task(self._child.wait())
        readiness = asyncio.create_task(self._become_ready())
        self._run.changes.notify()
        code = await self._ended
        readiness.cancel()
        return self._note_end(code)

    def _note_end(self, code: int) -> int:
        self.ready = False
        nobody_here = self.wanted and not self._again and not self._killed_because
        hint = self._run.sigkill_hint() if code == -signal.SIGKILL and nobody_here else ""
        self._end_in_words = describe_exit(code) + hint
        if self._child is not None and self._child.pid is not None:
            self._ended_pids.append(self._child.pid)
        self.exits.append(
            Exit(
                time=time.time_ns(),
                exit_code=code,
                reason=self._killed_because or self._end_in_words,
                uptime=time.monotonic() - self.started_at,
                last_lines=list(self._child.last_lines) if self._child is not None else [],
            )
        )
        return code

    def _settle(self, code: int, delay: float | None) -> None:
        """It has ended by itself: come to the state that follows."""
        end = self._end_in_words
        why = self._killed_because or (f"was {end}" if code < 0 else f"ended with {end}")
        if delay is None:
            self._become("failed" if code else "completed", why)
        elif self.restarts.storm:
            plan = self.plan.restart
            self._become(
                "degraded",
                f"{why}, more than {plan.max} times in {plan.window:g} s; next try in {delay:.1f} s",
            )
        else:
            self._become("restarting", f"{why}; starting it again in {delay:.2g} s")

    def _give_priority(self) -> None:
        """Give the new process its priority and its processors, before it has a second thread."""
        plan, pid = self.plan, self.pid
        if pid is None or (plan.priority is None and not plan.cpus):
            return
        try:
            if plan.priority is not None:
                os.setpriority(os.PRIO_PROCESS, pid, plan.priority)
            if plan.cpus:
                os.sched_setaffinity(pid, plan.cpus)
        except ProcessLookupError:
            return  # it has ended already
        except (OSError, ValueError, AttributeError) as error:
            # macOS has no affinity, and a lower nice value needs rights that most users lack.
            wish = f"priority {plan.priority}" if plan.priority is not None else ""
            wish += f" cpus {list(plan.cpus)}" if plan.cpus else ""
            self._run.output(self, "robo", f"WARN  runs without {wish.strip()}: {error}")

    # -- readiness -------------------------------------------------------------------------------

    async def _become_ready(self) -> None:
        """Wait for all that tells of readiness; what takes too long has failed."""
        ready = self.plan.ready
        missing = ""
        try:
            async with asyncio.timeout(ready.timeout or None):
                if ready.when == "node":
                    missing = "its liveliness token does not show"
                    await self._token_seen.wait()
                if ready.log is not None:
                    missing = f"no line of its output holds {ready.log!r}"
                    await self._line_seen.wait()
                if ready.port is not None:
                    missing = f"nothing listens at {ready.port}"
                    await _until(lambda: listens(str(ready.port)))
                if ready.probe:
                    missing = f"`{shlex.join(ready.probe)}` does not succeed"
                    await _until(self._probe)
                for key in ready.topics:
                    missing = f"{key} does not come as promised"
                    flow = self._run.flow(key)
                    while flow is not None and not flow.flows(time.monotonic()):
                        await asyncio.sleep(_PROBE_PERIOD / 2)
        except TimeoutError:
            await self.end_because(f"not ready within {ready.timeout:g} s: {missing}")
            return
        self.ready = True
        self.ready_at = self._beat_at = time.monotonic()
        if self.restarts.storm:
            self._become("degraded", f"back, but not yet for {self.plan.restart.reset_after:g} s")
        else:
            self._become("ready", "")
        self._run.changes.notify()

    async def _probe(self) -> bool:
        """Whether the probe command succeeds."""
        environment = self._run.environment(self.plan)
        try:
            probe = await asyncio.create_subprocess_exec(
                *self.plan.ready.probe,
                env=environment,
                cwd=self.plan.cwd,
                stdin=asyncio.subprocess.DEVNULL,
                stdout=asyncio.subprocess.DEVNULL,
                stderr=asyncio.subprocess.DEVNULL,
                process_group=0,
            )
        except OSError:
            return False
        self._run.spawned.add(probe.pid)
        try:
            return await probe.wait() == 0
        finally:
            self._run.spawned.discard(probe.pid)
            if probe.returncode is None:
                with suppress(ProcessLookupError):
                    os.killpg(probe.pid, signal.SIGKILL)

    def notice_token(self, pid: int) -> None:
        """The node's liveliness token shows, if it is not that of a child that has ended."""
        if pid not in self._ended_pids:
            self._token_seen.set()

    # -- health ----------------------------------------------------------------------------------

    def check(self, now: float) -> str | None:
        """Look after a process that is ready; called a few times a second.

        Returns:
            Why it hangs, where it does.
        """
        if not self.ready or not self.running:
            return None
        plan = self.plan
        silent = now - self._beat_at
        if plan.watchdog and self._beat is not None and silent > plan.watchdog:
            held = f"; {self._late.status.running} does not return" if self._late and self._late.status.running else ""
            return f"hangs: no sign of life for {silent:.1f} s{held}"
        problem = self._broken_promise(now)
        healthy = now - self.ready_at >= plan.restart.reset_after
        if self.restarts.storm and not healthy:
            return None
        if healthy:
            self.restarts.healthy()
        if problem is None:
            self._become("ready", "")
            return None
        self._become("degraded", problem)
        return self._gone_silent(now)

    def _flows(self) -> list[Flow]:
        keys = (self._beat.status.published if self._beat is not None else {}) or self.plan.publishes
        return [flow for key in keys if (flow := self._run.flow(key)) is not None]

    def _broken_promise(self, now: float) -> str | None:
        if now - self.ready_at < 2 * BEAT_PERIOD:
            return None  # its topics have to come first
        return next((problem for flow in self._flows() if (problem := flow.problem(now)) is not None), None)

    def _gone_silent(self, now: float) -> str | None:
        """Why a topic contract means that it hangs: all is silent for as long as the watchdog allows."""
        limit = self.plan.watchdog
        for flow in self._flows():
            silent = flow.silent(now)
            since = min(silent or 0.0, now - self.ready_at)
            if limit and since > limit:
                return f"hangs: nothing on {flow.promise.key} for {since:.1f} s"
        return None

    def stays_hung(self, why: str) -> None:
        """It hangs, and its policy does not start it again: it is left alone, and shown."""
        self._become("degraded", why)

    async def end_because(self, why: str, *, ask_where: bool = False) -> None:
        """End a process that does not do its work, so that its policy takes over."""
        child, ended = self._child, self._ended
        if child is None or ended is None or self._killed_because:
            return
        self._killed_because = why
        self.ready = False
        self._become("degraded", why)
        if ask_where:
            # A Python process writes the stacks of all its threads to stderr and ends.
            child.send(signal.SIGABRT)
            child.send(signal.SIGCONT)
            await asyncio.wait([ended], timeout=_LAST_WORDS)
            child.send(signal.SIGKILL)
        else:
            await child.stop(ended, patience=self.plan.stop.timeout)

    # -- commands --------------------------------------------------------------------------------

    async def stop(self) -> None:
        """Stop it and leave it so; returns when it has ended."""
        self.wanted = self._again = False
        await self._end("stopping", "")
        if not self.running and not self.spawning and self.state == "starting":  # it waits for what it needs
            self.finished = True
            self._become("stopped", "as asked")
        self._run.changes.notify()
        await self._run.changes.until(lambda: self.state in ("stopped", "completed", "failed"))

    def retire(self) -> None:
        """The run ends: it is not started any more; if it runs, it goes on until it is told to stop."""
        self.wanted = False

    async def restart(self, why: str) -> None:
        """End it, if it runs, and start it again at once; returns when the new process is there."""
        begun = self.started_at
        if self.wanted and self.running:
            self.restarts.count += 1
        self.wanted = self._again = True
        await self._end("restarting", why)
        self._run.changes.notify()
        await self._run.changes.until(
            lambda: self.started_at != begun or not self.wanted or bool(self._run.unmet(self.plan))
        )

    def take_over(self, plan: ProcessPlan) -> None:
        """Go on by another plan from the next start on."""
        self.plan = plan
        self.restarts.plan = plan.restart
        self._pattern = re.compile(plan.ready.log) if plan.ready.log is not None else None

    async def _end(self, state: State, why: str) -> None:
        """Ask the child to end, then insist."""
        if self.running and self._child is not None and self._ended is not None:
            self.ready = False
            self._become(state, why)
            first = signal.Signals[f"SIG{self.plan.stop.signal}"]
            await self._child.stop(self._ended, patience=self.plan.stop.timeout, first=first)

    def send(self, number: signal.Signals) -> None:
        """Send a signal to the process and its group."""
        if self._child is not None:
            self._child.send(number)

    # -- what it tells -----------------------------------------------------------------------------

    def status(self, robot: str, run: str, host: str) -> ProcessStatus:
        """Its present state in figures."""
        cpu, memory = self._measure()
        running = self.running
        published, received = self._rates if self._fresh() else ({}, {})
        held = self._late.status if self._late is not None and running else None
        return ProcessStatus(
            robot=robot,
            group=self.plan.group,
            node=self.plan.full_name,
            state=self.state,
            reason=self.reason,
            pid=self.pid,
            restarts=self.restarts.count,
            uptime=round(time.monotonic() - self.started_at, 3) if running else None,
            cpu=cpu,
            memory=memory,
            published=published,
            received=received,
            run=run,
            host=host,
            running=held.running if held is not None else "",
            running_for=held.running_for if held is not None else 0.0,
        )

    def explain(self, status: ProcessStatus, unmet: list[str]) -> Explanation:
        """Why it is as it is."""
        now = time.monotonic()
        seen = self._beat.status if self._beat is not None else None
        inputs: list[Input] = []
        if seen is not None and self.running:
            inputs = [
                Input(
                    topic=topic,
                    received=count,
                    age=round(now - (self._input_seen[topic][1] if count else self.started_at), 3),
                    malformed=seen.malformed.get(topic, 0),
                    dropped=seen.dropped.get(topic, 0),
                )
                for topic, count in seen.received.items()
            ]
        return Explanation(
            process=status,
            exits=list(self.exits),
            unmet_needs=unmet,
            inputs=inputs,
            callback_errors=seen.callback_errors if seen is not None else 0,
            next_start=max(0.0, self.next_start - now) if self.next_start is not None else None,
        )

    def measure(self) -> None:
        """Begin to measure the processor time that it uses, if that has not begun."""
        if self._usage is None:
            self._measure()

    def _measure(self) -> tuple[float | None, int | None]:
        if not self.running:
            return None, None
        import psutil

        try:
            if self._usage is None:
                self._usage = psutil.Process(self.pid)
                self._measured_at = -math.inf
            # Over a shorter time, as several tools may ask for it, the figure would be noise.
            if time.monotonic() - self._measured_at >= _LEAST_MEASURED:
                with self._usage.oneshot():
                    self._used = self._usage.cpu_percent(), self._usage.memory_info().rss
                self._measured_at = time.monotonic()
            return self._used
        except psutil.Error:
            return None, None

    # -- inside ------------------------------------------------------------------------------------

    def _fresh(self) -> bool:
        return self.running and time.monotonic() - self._beat_at < 3 * BEAT_PERIOD

    def excuse_silence(self, now: float) -> None:
        """The supervisor itself has slept: nobody can be blamed for beats that it did not hear."""
        self._beat_at = now

    def _become(self, state: State, reason: str) -> None:
        if (state, reason) != (self.state, self.reason):
            before = self.state
            self.state, self.reason = state, reason
            self._run.changed(self, before)

    def _on_line(self, stream: str, text: str) -> None:
        self._run.output(self, stream, text)
        if self._pattern is not None and self._pattern.search(text):
            self._line_seen.set()

    def _on_beat(self, data: bytes) -> None:
        try:
            beat = msgspec.msgpack.decode(data, type=Beat)
        except UNREADABLE:
            return  # a command that writes something else there has no heart
        now = time.monotonic()
        self._late = beat if beat.late else None
        if beat.late:
            return
        old, span = self._beat, now - self._beat_at
        if old is not None and span > 0:
            self._rates = (
                _rates(old.status.published, beat.status.published, span),
                _rates(old.status.received, beat.status.received, span),
            )
        for topic, count in beat.status.received.items():
            if self._input_seen.get(topic, (-1, 0.0))[0] != count:
                self._input_seen[topic] = (count, now)
        if beat.files:
            self.files = tuple(beat.files)
        self._beat, self._beat_at = beat, now


def _rates(old: Mapping[str, int], new: Mapping[str, int], span: float) -> dict[str, float]:
    return {topic: round((count - old.get(topic, 0)) / span, 1) for topic, count in new.items()}


async def _until(condition: Callable[[], Awaitable[bool]]) -> None:
    while not await condition():
        await asyncio.sleep(_PROBE_PERIOD)


async def listens(address: str) -> bool:
    """Whether something accepts connections at `host:port`."""
    host, _, port = address.rpartition(":")
    try:
        _, writer = await asyncio.open_connection(host, int(port))
    except OSError:
        return False
    writer.close()
    return True
