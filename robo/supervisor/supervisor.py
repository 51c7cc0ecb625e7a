"""Starts the processes of a plan in order, watches them, and stops them in reverse order.

The supervisor is one asyncio loop. Processes are ready when their liveliness token shows; tokens come
from the robot's own router, to which the supervisor is a client.
"""

import asyncio
import os
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
from robo.discovery import NodeToken
from robo.errors import NetworkError
from robo.launch.plan import Plan, ProcessPlan
from robo.router import LINGER, NETWORK_VARIABLE
from robo.runner import SPEC_VARIABLE, NodeSpec
from robo.session import Network, close_session, open_session
from robo.supervisor.console import Console
from robo.supervisor.process import Child, describe_exit

PATIENCE = 1.0
"""How long a process may take to end when asked, s, before it is told again and then killed."""

STOP_LIMIT = 2.0
"""How long the stop of a whole launch may take, s, before all that still run are killed."""


class Member:
    """A process of the plan and what has become of it."""

    def __init__(self, plan: ProcessPlan, child: Child) -> None:
        self.plan = plan
        self.child = child
        self.ready = False
        self.ended: asyncio.Task[int] | None = None
        self.asked_to_stop = False

    @property
    def waiting(self) -> bool:
        """Whether it has not been started."""
        return self.ended is None

    @property
    def failed(self) -> bool:
        """Whether it ended by itself and badly."""
        code = self.child.returncode
        return code is not None and code != 0 and not self.asked_to_stop


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
        self._environment = dict(environment)
        self._folder = Path(tempfile.mkdtemp(prefix="robo-"))
        self._socket = f"unixsock-stream/{self._folder}/router.sock"
        self._router_network = msgspec.structs.replace(router, listen=(self._socket, *router.listen))
        self._members: dict[str, Member] = {}
        for process in plan.processes:
            label = label_of(plan, process)
            self._members[process.full_name] = Member(process, Child(label, partial(console.line, label)))
        self._router = Child("router", lambda line: console.line("robo", f"router: {line}"))
        self._stop = asyncio.Event()
        self._changed = asyncio.Event()
        self._exit_code: int | None = None
        self._stop_requests = 0
        self._announced = False

    async def run(self) -> int:
        """Start everything, wait for the end, stop everything.

        Returns:
            The exit code: 0 all went well, 1 a process failed, 130 interrupted.
        """
        self._begin = time.monotonic()
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
            shutil.rmtree(self._folder, ignore_errors=True)
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
        """Start every process whose needs are ready."""
        for index, member in enumerate(self._members.values()):
            if member.waiting and all(self._members[need].ready for need in member.plan.needs):
                await member.child.start(*self._command(member.plan, index))
                member.ended = asyncio.create_task(member.child.wait())
                member.ended.add_done_callback(lambda _: self._changed.set())

    def _command(self, plan: ProcessPlan, index: int) -> tuple[list[str], dict[str, str]]:
        spec = NodeSpec(
            service=plan.service,
            name=plan.name,
            namespace=plan.namespace,
            parameters={name: said.value for name, said in plan.parameters.items()},
            remappings=plan.remap,
            needs=plan.needs,
            mode="peer",
            connect=(self._socket,),
            listen=(f"unixsock-stream/{self._folder}/{index}.sock",),
        )
        variables = {SPEC_VARIABLE: msgspec.json.encode(spec).decode(), "ROBO_SUPERVISED": "1"}
        command = [sys.executable, "-m", "robo.node_process", plan.service, plan.full_name]
        return command, self._environment | variables | plan.env

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
        if token.pid == member.child.pid and token.host == discovery.hostname():
            member.ready = True
            self._changed.set()
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
        reported: set[str] = set()
        while not self._stop.is_set():
            self._changed.clear()
            for name, member in self._members.items():
                if member.ended is not None and member.ended.done() and name not in reported:
                    reported.add(name)
                    self._on_exit(member)
            await self._start_those_that_can()
            self._announce()
            running = [m for m in self._members.values() if m.child.running]
            if not running and not any(self._may_start(m) for m in self._members.values()):
                self._finish(None)
            if not self._stop.is_set():
                await self._changed.wait()

    def _on_exit(self, member: Member) -> None:
        code = member.child.returncode
        assert code is not None
        text = f"{member.child.name} ended with {describe_exit(code)}"
        (self._console.warn if code else self._console.say)(text)
        for other in self._members.values():
            if other.waiting and member.plan.full_name in other.plan.needs and not member.ready:
                self._console.warn(f"{other.child.name} is not started: it needs {member.child.name}")
        if member.plan.required:
            self._finish(1 if code else 0)

    def _may_start(self, member: Member) -> bool:
        """Whether a process that waits can still be started."""
        return member.waiting and all(
            self._members[need].ready or self._members[need].child.running or self._may_start(self._members[need])
            for need in member.plan.needs
        )

    def _announce(self) -> None:
        if self._announced or not all(m.ready for m in self._members.values()):
            return
        self._announced = True
        seconds = time.monotonic() - self._begin
        where = ", ".join(e for e in self._router_network.listen if not e.startswith("unixsock"))
        count = len(self._members)
        nodes = "1 node" if count == 1 else f"{count} nodes"
        self._console.say(f"{self._plan.robot} is ready: {nodes} in {seconds:.2f} s, at {where}; Ctrl-C stops")

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
        limit = asyncio.get_running_loop().call_later(STOP_LIMIT, self._kill_all)
        stopping: dict[str, asyncio.Task[None]] = {}
        while running := {n: m for n, m in self._members.items() if m.child.running}:
            needed = {need for member in running.values() for need in member.plan.needs}
            for name, member in running.items():
                if name not in stopping and (name not in needed):
                    assert member.ended is not None
                    member.asked_to_stop = True
                    stopping[name] = asyncio.create_task(member.child.stop(member.ended, patience=PATIENCE))
            await asyncio.wait([m.ended for m in running.values() if m.ended], return_when=asyncio.FIRST_COMPLETED)
        await asyncio.gather(*stopping.values())
        limit.cancel()

    def _kill_all(self) -> None:
        for member in self._members.values():
            if member.child.running:
                self._console.warn(f"{member.child.name} does not end; killing it")
                member.asked_to_stop = True
                member.child.signal(signal.SIGKILL)

    async def _stop_router(self) -> None:
        if self._router.running:
            ended = asyncio.create_task(self._router.wait())
            await self._router.stop(ended, patience=LINGER + 0.5)

    # -- afterwards ------------------------------------------------------------------------------------

    def _summarize(self) -> None:
        """Repeat why processes failed: their own last words may have scrolled away."""
        for member in self._members.values():
            code = member.child.returncode
            if member.failed and code is not None:
                self._console.warn(f"{member.child.name} failed: {describe_exit(code)}")
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
    environment = dict(os.environ) | {"PYTHONUNBUFFERED": "1"}
    if log_level is not None:
        environment["ROBO_LOG_LEVEL"] = log_level
    return asyncio.run(_run(plan, router, console, environment))


async def _run(plan: Plan, router: Network, console: Console, environment: Mapping[str, str]) -> int:
    return await Supervisor(plan, router, console, environment).run()


def label_of(plan: Plan, process: ProcessPlan) -> str:
    """What a process is called in the output: its name, and its namespace where that is not the robot's."""
    inner = process.namespace.removeprefix(plan.robot).strip("/")
    return names.join(inner, process.name)
