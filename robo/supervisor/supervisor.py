"""Starts the processes of a plan in order, watches them, and stops them in reverse order.

The supervisor is one asyncio loop. Processes are ready when their liveliness token shows; tokens come
from the robot's own router, to which the supervisor is a client.
"""

import asyncio
import graphlib
import os
import secrets
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Mapping
from functools import partial
from pathlib import Path

import msgspec
import zenoh

from robo import discovery, names
from robo.codec import jsonable
from robo.discovery import NodeToken
from robo.errors import NetworkError
from robo.launch.plan import Plan, ProcessPlan, StopPlan
from robo.parameter_server import Said
from robo.router import LINGER, NETWORK_VARIABLE
from robo.runner import SPEC_VARIABLE, NodeSpec
from robo.session import Network, close_session, open_session
from robo.supervisor.console import Console
from robo.supervisor.log_files import LogFiles, log_folder
from robo.supervisor.member import Member
from robo.supervisor.process import Child, describe_exit
from robo.supervisor.watchdog import RUN_VARIABLE, Watchdog, sweep

STOP_LIMIT = 2.0
"""How long the stop of a launch may take, s, before all that still run are killed, unless the manifest
gives single processes more."""


class Supervisor:
    """One run of a plan."""

    def __init__(self, plan: Plan, router: Network, console: Console, environment: Mapping[str, str]) -> None:
        """
        Args:
            plan: what to start.
            router: how the robot's router joins the network; its unix socket is added.
            console: where output goes.
            environment: of every process.
        """
        self._plan = plan
        self._console = console
        self._run_id = secrets.token_hex(8)
        self._environment = {**environment, RUN_VARIABLE: self._run_id}
        self._folder = Path(tempfile.mkdtemp(prefix="robo-"))
        self._socket = f"unixsock-stream/{self._folder}/router.sock"
        self._router_network = msgspec.structs.replace(router, listen=(self._socket, *router.listen))
        self._log_files = LogFiles(log_folder(plan.robot))
        self._members: dict[str, Member] = {}
        for process in plan.processes:
            member = Member(process, label_of(plan, process), partial(self._show, process.log.output))
            member.on_ready = self._notice_change
            self._members[process.full_name] = member
        self._starts = 0
        self._router = Child("router", lambda line: console.line("robo", f"router: {line}"))
        self._stop = asyncio.Event()
        self._changed = asyncio.Event()
        self._restarts: set[asyncio.Task[None]] = set()
        self._exit_code: int | None = None
        self._stop_requests = 0
        self._announced = False

    async def run(self) -> int:
        """Start everything, wait for the end, stop everything.

        Returns:
            The exit code: 0 all went well, 1 a process failed, 130 interrupted.
        """
        self._begin = time.monotonic()
        watchdog = Watchdog(self._run_id, self._folder)
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            loop.add_signal_handler(number, self._on_signal, number)
        watcher: zenoh.Session | None = None
        router: asyncio.Task[None] | None = None
        try:
            await self._start_router()
            router = asyncio.create_task(self._keep_router())
            await self._start_those_that_can()
            watcher = await self._watch_tokens(loop)
            await self._supervise()
        finally:
            await self._stop_all()
            if router is not None:
                router.cancel()
            await self._stop_router()
            if watcher is not None:
                await asyncio.to_thread(close_session, watcher)
            for pid in await asyncio.to_thread(sweep, self._run_id):
                self._console.warn(f"ended process {pid}, which a node had left behind")
            watchdog.dismiss()
            shutil.rmtree(self._folder, ignore_errors=True)
            self._log_files.close()
        self._summarize()
        return self._result()

    # -- start -----------------------------------------------------------------------------------

    async def _start_router(self) -> None:
        variables = {NETWORK_VARIABLE: msgspec.json.encode(self._router_network).decode()}
        await self._router.start([sys.executable, "-m", "robo.router"], self._environment | variables)

    async def _keep_router(self) -> None:
        """Start the router again when it dies; nodes and tools find it again by themselves."""
        while True:
            code = await self._router.wait()
            self._console.warn(f"the router ended with {describe_exit(code)}; starting it again")
            await asyncio.sleep(0.1)
            await self._start_router()

    async def _start_those_that_can(self) -> None:
        """Start every process whose needs are met."""
        for member in self._members.values():
            if member.waiting and all(self._members[n].reached(until) for n, until in member.plan.needs.items()):
                await self._start(member)

    async def _start(self, member: Member) -> None:
        problem = await member.start(self._variables(member.plan))
        if problem is not None:
            self._console.warn(problem)
        assert member.ended is not None
        member.ended.add_done_callback(lambda _: self._changed.set())

    def _variables(self, plan: ProcessPlan) -> dict[str, str]:
        """The environment of a process. A command learns its name and its network there, in any language."""
        self._starts += 1
        spec = NodeSpec(
            service=plan.service or "",
            name=plan.name,
            namespace=plan.namespace,
            parameters={name: said.value for name, said in plan.parameters.items()},
            sources={
                name: [Said(one.value, one.source) for one in (*said.over, said)]
                for name, said in plan.parameters.items()
            },
            remappings=plan.remap,
            needs=tuple(name for name, until in plan.needs.items() if until == "ready" and self._shows_token(name)),
            mode="peer",
            connect=(self._socket,),
            # A name of its own for each start: what was killed leaves its socket behind.
            listen=(f"unixsock-stream/{self._folder}/{self._starts}.sock",),
        )
        variables = {
            SPEC_VARIABLE: msgspec.json.encode(jsonable(msgspec.to_builtins(spec))).decode(),
            "ROBO_SUPERVISED": "1",
        }
        if plan.service is None:
            variables |= {"ROBO_NAMESPACE": plan.namespace, "ROBO_CONNECT": self._socket}
        if plan.log.level is not None:
            variables["ROBO_LOG_LEVEL"] = plan.log.level
        return self._environment | variables | plan.env

    def _shows_token(self, name: str) -> bool:
        return self._members[name].plan.ready.when == "node"

    def _notice_change(self) -> None:
        self._changed.set()

    def _show(self, output: str, label: str, text: str) -> None:
        """One line of a process's output, to where the manifest wants it."""
        if output != "file":
            self._console.line(label, text)
        if output != "screen":
            try:
                self._log_files.line(label, text)
            except OSError as error:
                self._console.warn(f"log file of {label}: {error}")

    async def _watch_tokens(self, loop: asyncio.AbstractEventLoop) -> zenoh.Session | None:
        """Learn from liveliness tokens which nodes are ready."""
        try:
            session = await asyncio.to_thread(open_session, Network(mode="client", connect=(self._socket,)))
        except NetworkError as error:
            self._console.warn(f"the robot's router cannot be reached: {error}")
            self._finish(1)
            return None

        def notice(sample: zenoh.Sample) -> None:
            if sample.kind == zenoh.SampleKind.PUT:
                token = discovery.parse_token(str(sample.key_expr))
                if isinstance(token, NodeToken):
                    loop.call_soon_threadsafe(self._on_token, token)

        session.liveliness().declare_subscriber(discovery.ALL_TOKENS, notice, history=True)
        return session

    def _on_token(self, token: NodeToken) -> None:
        member = self._members.get(token.full_name)
        if member is None:
            return
        if token.host == discovery.hostname() and member.owns(token.pid):
            member.notice_token()
        elif self._announced:
            self._console.warn(f"another {token.full_name} has come up (process {token.pid} on {token.host})")
        else:  # the newcomer gives way
            self._console.warn(
                f"{token.full_name} runs already (process {token.pid}); stop it or choose another --robot-name"
            )
            self._finish(1)

    # -- while it runs -----------------------------------------------------------------------------

    async def _supervise(self) -> None:
        """React to what happens until the launch is to end."""
        seen: set[asyncio.Task[int]] = set()
        while not self._stop.is_set():
            self._changed.clear()
            for member in self._members.values():
                if member.ended is not None and member.ended.done() and member.ended not in seen:
                    seen.add(member.ended)
                    self._on_exit(member, member.ended.result())
            await self._start_those_that_can()
            self._announce()
            going = any(m.running or m.restarting for m in self._members.values())
            if not going and not self._can_start_more():
                self._finish(None)
            if not self._stop.is_set():
                await self._changed.wait()

    def _on_exit(self, member: Member, code: int) -> None:
        member.exit_code = code
        text = f"{member.label} ended with {describe_exit(code)}"
        if member.wants_restart():
            delay = member.plan.restart.delay
            self._console.warn(
                f"{text}; starting it again in {delay:g} s ({member.restarts} of {member.plan.restart.max})"
            )
            member.restarting = True
            task = asyncio.create_task(self._restart(member, delay))
            self._restarts.add(task)
            task.add_done_callback(self._restarts.discard)
            return
        (self._console.warn if code else self._console.say)(text)
        if member.restarts and member.restarts >= member.plan.restart.max:
            self._console.warn(
                f"{member.label} stays down: {member.restarts} restarts in {member.plan.restart.window:g} s"
            )
        for other in self._members.values():
            until = other.plan.needs.get(member.plan.full_name)
            if other.waiting and until is not None and not member.reached(until):
                self._console.warn(f"{other.label} is not started: it needs {member.label} {until}")
        if member.plan.required:
            self._finish(1 if code else 0)

    async def _restart(self, member: Member, delay: float) -> None:
        await asyncio.sleep(delay)
        if not self._stop.is_set():
            await self._start(member)
            self._changed.set()

    def _can_start_more(self) -> bool:
        """Whether any process that waits can still be started."""
        able = {name for name, member in self._members.items() if member.waiting}
        while True:
            blocked = {
                name
                for name in able
                for need, until in self._members[name].plan.needs.items()
                if need not in able and not self._members[need].may_reach(until)
            }
            if not blocked:
                return bool(able)
            able -= blocked

    def _announce(self) -> None:
        # What has done its work and ended well is as good as ready.
        if self._announced or not all(m.ready or m.reached("completed") for m in self._members.values()):
            return
        self._announced = True
        seconds = time.monotonic() - self._begin
        where = ", ".join(e for e in self._router_network.listen if not e.startswith("unixsock"))
        count = len(self._members)
        nodes = "1 node" if count == 1 else f"{count} nodes"
        self._console.say(f"{self._plan.robot} is ready: {nodes} in {seconds:.2f} s, at {where}; Ctrl-C stops")
        if any(m.plan.log.output != "screen" for m in self._members.values()):
            self._console.say(f"log files are in {self._log_files.folder}")

    # -- stop ----------------------------------------------------------------------------------------

    def _on_signal(self, number: signal.Signals) -> None:
        self._stop_requests += 1
        if self._stop_requests == 1:
            self._console.say("stopping; once more to kill")
            self._finish(128 + signal.SIGINT if number == signal.SIGINT else 0)
        else:
            self._kill_all()

    def _finish(self, exit_code: int | None) -> None:
        """End the launch; the first one to say so decides the exit code."""
        if not self._stop.is_set():
            self._exit_code = exit_code
            self._stop.set()
            self._changed.set()

    async def _stop_all(self) -> None:
        """Stop processes, each after those that need it; all at once where nothing needs another."""
        for restart in list(self._restarts):
            restart.cancel()
        limit = asyncio.get_running_loop().call_later(self._stop_limit(), self._kill_all)
        stopping: dict[str, asyncio.Task[None]] = {}
        while running := {n: m for n, m in self._members.items() if m.running}:
            needed = {need for member in running.values() for need in member.plan.needs}
            for name, member in running.items():
                if name not in stopping and name not in needed:
                    assert member.ended is not None
                    assert member.child is not None
                    member.asked_to_stop = True
                    stop = member.child.stop(
                        member.ended,
                        patience=member.plan.stop.timeout,
                        first=signal.Signals[f"SIG{member.plan.stop.signal}"],
                    )
                    stopping[name] = asyncio.create_task(stop)
            await asyncio.wait([m.ended for m in running.values() if m.ended], return_when=asyncio.FIRST_COMPLETED)
        await asyncio.gather(*stopping.values())
        limit.cancel()

    def _stop_limit(self) -> float:
        """All that the manifest grants to those that stop one after the other."""
        if all(m.plan.stop.timeout <= StopPlan().timeout for m in self._members.values()):
            return STOP_LIMIT
        spans: dict[str, float] = {}
        needs = {name: member.plan.needs for name, member in self._members.items()}
        for name in graphlib.TopologicalSorter(needs).static_order():
            longest = max((spans[need] for need in needs[name]), default=0.0)
            spans[name] = 1.5 * self._members[name].plan.stop.timeout + longest
        return max(STOP_LIMIT, *spans.values())

    def _kill_all(self) -> None:
        for member in self._members.values():
            if member.running:
                assert member.child is not None
                self._console.warn(f"{member.label} does not end; killing it")
                member.asked_to_stop = True
                member.child.send(signal.SIGKILL)

    async def _stop_router(self) -> None:
        if self._router.running:
            ended = asyncio.create_task(self._router.wait())
            await self._router.stop(ended, patience=LINGER + 0.5)

    # -- afterwards ------------------------------------------------------------------------------------

    def _summarize(self) -> None:
        """Repeat why processes failed: their own last words may have scrolled away."""
        for member in self._members.values():
            if member.failed and member.exit_code is not None and member.child is not None:
                self._console.warn(f"{member.label} failed: {describe_exit(member.exit_code)}")
                for line in list(member.child.last_lines)[-5:]:
                    self._console.warn(f"  {line}")

    def _result(self) -> int:
        if self._exit_code is not None:
            return self._exit_code
        return 1 if any(m.failed or m.waiting for m in self._members.values()) else 0


def run(plan: Plan, router: Network, *, log_level: str | None = None) -> int:
    """Run a plan in the foreground until it ends or is interrupted.

    Args:
        plan: what to start.
        router: how the robot's router joins the network.
        log_level: of every node; by default ROBO_LOG_LEVEL or info.

    Returns:
        The exit code for the command.
    """
    console = Console(sorted({label_of(plan, p) for p in plan.processes}))
    environment = dict(os.environ) | {"PYTHONUNBUFFERED": "1", "PATH": search_path()}
    if log_level is not None:
        environment["ROBO_LOG_LEVEL"] = log_level
    return asyncio.run(_run(plan, router, console, environment))


async def _run(plan: Plan, router: Network, console: Console, environment: Mapping[str, str]) -> int:
    return await Supervisor(plan, router, console, environment).run()


def search_path() -> str:
    """Where the programs of a launch are looked for: `python` and `robo` are those that run here."""
    return os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", os.defpath)])


def label_of(plan: Plan, process: ProcessPlan) -> str:
    """What a process is called in the output: its name, and its namespace where that is not the robot's."""
    inner = process.namespace.removeprefix(plan.robot).strip("/")
    return names.join(inner, process.name)
