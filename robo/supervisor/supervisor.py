"""One run of a plan: its router, its processes in order, their health, and the end of all of them.

The supervisor is one asyncio loop. Each process has a task of its own that lives its life (`Member`);
this module puts the parts of a run together, and lets them know of each other.
"""

import asyncio
import os
import time
from collections.abc import Callable, Collection, Coroutine, Mapping
from typing import Any

import msgspec

from robo.environment import LOG_LEVEL_VARIABLE, RUN_VARIABLE, WATCH_VARIABLE
from robo.errors import NetworkError
from robo.launch.plan import Plan, ProcessPlan
from robo.machine import log_space
from robo.machine.child import Child, Spawned
from robo.machine.custody import Custody
from robo.machine.forks import Template
from robo.machine.log_files import SUPERVISOR, LogFiles, RunInfo
from robo.machine.log_writer import LogWriter
from robo.machine.memory_kills import MemoryKills
from robo.machine.orphans import Left
from robo.process.router import TOLD
from robo.supervisor import about, consequences, instance, needs
from robo.supervisor.attendance import Attendance
from robo.supervisor.changes import Changes
from robo.supervisor.commands import Address, Commands
from robo.supervisor.console import Console
from robo.supervisor.control import Control
from robo.supervisor.early import HeadStart, base_environment
from robo.supervisor.journal import Journal
from robo.supervisor.member import Member
from robo.supervisor.news import News
from robo.supervisor.presence import Presence
from robo.supervisor.reload import Reload
from robo.supervisor.router import Router
from robo.supervisor.run_environment import RunEnvironment
from robo.supervisor.sharing import Houses, Lodger
from robo.supervisor.sites import Sites
from robo.supervisor.snapshots import Snapshots
from robo.supervisor.stopping import LAST_RESORT, Stopping, end_within_limits, take_signals
from robo.supervisor.tasks import Tasks
from robo.supervisor.topic_watch import Flow, TopicWatch, promises
from robo.text.folders import log_base
from robo.wire import claims, discovery, listeners, names
from robo.wire.network import FOR_YOURS, Network
from robo.wire.reports import State
from robo.wire.run_id import new_run_id

MOST_LINKED = 30
"""More nodes than these do not link to each other; the router passes their messages on."""

_STARTING = 2.0
"""For how long nobody's processor time is measured, s: that would take a tenth of what a start takes."""
_TICK = 0.25
"""How often it is looked after all that runs, s."""


class RunOptions(msgspec.Struct, frozen=True, kw_only=True):
    """How a run differs from a plain one."""

    log_level: str | None = None
    """Of every node; by default ROBO_LOG_LEVEL or info."""
    timing: bool = False
    """Print where the time of the start went."""
    reload: Callable[[], Plan | str] | None = None
    """Reads the manifest again, or tells its mistakes; with it changed files restart what they touch."""
    notify: Callable[[str], None] | None = None
    """Is told `up`, `ready` and `down`: for whoever waits for a run in the background."""
    unread: Callable[[], bool] | None = None
    """Whether nobody reads the console any more, as it is in the background; None for a run in the foreground."""
    begun: HeadStart | None = None
    """What of the run has begun already."""


class Supervisor:
    """One run of a plan: its parts, put together."""

    def __init__(
        self,
        plan: Plan,
        router: Network,
        console: Console,
        environment: Mapping[str, str],
        options: RunOptions,
        custody: Custody,
    ) -> None:
        """
        Args:
            plan: what to start.
            router: how the robot's router joins the network; its unix socket is added.
            console: where output goes.
            environment: of every process.
            options: how this run differs from a plain one.
            custody: the run's processes and its folder.
        """
        self._robot = robot = plan.robot
        self._custody = custody
        self._timing = options.timing
        self._console = console
        self._unread = options.unread
        begun = options.begun
        self.template = Template(*begun.template) if begun is not None and begun.template is not None else None
        self.spawned = custody.spawned
        self.limiter = custody.limiter
        self.changes = Changes()
        self._members: dict[str, Member] = {}
        self._lives: dict[str, asyncio.Task[object]] = {}
        self._memory_kills = MemoryKills(time.monotonic())
        files = _log_files(plan, router, custody.run)
        self._log_room = files.folder.parent.parent, log_space.limit(files.folder.parent.parent), files.folder
        self._log_writer = LogWriter(files, lambda line: self._journal.note_trouble(line))
        self._journal = journal = Journal(robot, console, self._log_writer)
        self._news = News(self._members, journal, options.notify)
        self._stopping = stopping = Stopping(self._members, self.changes, journal)
        self._tasks = tasks = Tasks(self._on_task_failed)
        self._endpoint = endpoint = f"unixsock-stream/{custody.folder}/router.sock"
        self._environment = RunEnvironment(
            environment, custody.folder, endpoint, self._shows_token, direct=_may_link(plan)
        )
        process = Child(custody.spawned, lambda _, line: self._router_says(line))
        network = msgspec.structs.replace(router, name=robot, listen=(endpoint, *router.listen))
        self._router = Router(process, network, environment, self.template, journal)
        self._where: str | None = None  # others find the robot, in words, once it is known who has the door
        self._houses = Houses(custody.spawned, journal.shared_output, journal.left_behind)
        self._sites = Sites(robot, [e for e in router.connect if e not in router.listen], journal, router.security)
        self._claim = claim = claims.Claim(router, robot, [p.full_name for p in plan.processes], custody.run)
        self._presence = Presence(robot, plan.host, claim, self._members, self.changes, journal, self._stopping)
        outside = frozenset(topic.key for topic in plan.topics if topic.external)
        address = Address(robot, custody.run, plan.host or discovery.hostname(), bool(plan.host), outside)
        self._snapshots = Snapshots({process.namespace for process in plan.processes})
        self._commands = Commands(
            address,
            about.report(plan, custody.run),
            self._members,
            journal,
            self._sites,
            tasks,
            stopping,
            self.unmet,
            self.renew,
            self._snapshots.of,
        )
        read = options.reload
        self._reload = Reload(plan, read, self._members, journal, tasks, self) if read is not None else None
        self._topics = TopicWatch(promises(plan.topics, plan.processes))
        manager = begun.manager if begun is not None else None
        self._attendance = (
            Attendance(manager, self._members, stopping, self.unmet, LAST_RESORT) if manager is not None else None
        )
        for one in plan.processes:
            self._make(one)

    async def run(self) -> int:
        """Start everything, wait for the end, stop everything.

        Returns:
            The exit code: 0 all went well, 1 a process failed, 130 interrupted.
        """
        self._news.phase_over("Python, manifest and node classes")
        if self.template is not None:
            self._custody.take_in(self.template.process.pid)
            self.template.listen()
        take_signals(asyncio.get_running_loop(), self._stopping)
        attending = asyncio.create_task(self._attendance.attend()) if self._attendance is not None else None
        try:
            if await self._may_start():
                await self._start()
                await self._supervise()
        except Exception as error:
            self._journal.warn_of(error)
            self._stopping.finish(1)
        finally:
            end_within_limits(self._stopping)
            await self._end()
            if attending is not None:
                attending.cancel()
        self._news.down()
        return self._stopping.result

    # -- start -----------------------------------------------------------------------------------

    async def _may_start(self) -> bool:
        """Make room: end what is left of earlier runs, and see that nobody runs the same."""
        ended = await self._custody.end_leftovers()
        if ended:
            self._journal.warn(f"ended {len(ended)} processes that an earlier run had left behind: {ended}")
        return await self._presence.may_start()

    async def _start(self) -> None:
        self._log_writer.begin()  # a run that is refused leaves no files
        self._sites.note(self._claim.unreached)
        held = [door for door in self._router.network.doors if listeners.holder(door) is not None]
        await self._router.start()
        self._tasks.tend(self._router.keep(), "the router")
        self._tasks.tend(self._ask_at(held), "the door for others")
        if self._router.network.shared and self._claim.sessions:
            self._journal.warn(
                f"others come by the door of what runs here already, which does not share {self._robot};"
                " --listen tcp/127.0.0.1:7448 makes another"
            )
        self._news.phase_over("router started")
        for name in self._members:
            self._begin_life(name)
        try:
            session = await self._presence.join(self._endpoint)
        except NetworkError as error:
            self._journal.warn(f"the robot's router cannot be reached: {error}")
            self._stopping.finish(1)
            return
        self._topics.begin(session)
        self._snapshots.begin(session)
        tells, acts = self._commands.tells, self._commands.acts
        self._journal.audience = Control(session, self._robot, tells, acts, asyncio.get_running_loop())
        self._presence.show()
        self._news.up()
        self._tell_starter()
        self._tasks.tend(self._presence.settle(), "the claim of names")
        self._tasks.tend(self._sites.watch(session), "the links to sites")
        self._tasks.tend(self._look_after(), "the run")

    async def _ask_at(self, held: list[str]) -> None:
        """Find out whether others find the robot at its doors, of which some were held before its router came."""
        there = await asyncio.to_thread(listeners.in_the_way, held, claims.PATIENCE) if held else []
        for holder in there:
            self._news.heed(f"{holder}: {self._robot} does not dial it, and others cannot look at {self._robot}")
        self._where = FOR_YOURS if there else self._router.reached_at
        self.changes.notify()

    def _router_says(self, line: str) -> None:
        if line.startswith(TOLD):
            self._journal.warn(f"the router: {line.removeprefix(TOLD)}")
        else:
            self._console.line(SUPERVISOR, f"router: {line}")

    def _make(self, plan: ProcessPlan) -> None:
        label = names.label(self._robot, plan.full_name)
        self._members[plan.full_name] = member = Member(
            plan, label, self, lambda *hears: _child(self._houses, member, *hears)
        )

    def _begin_life(self, name: str) -> None:
        self._lives[name] = self._tasks.tend(self._members[name].live(), name)

    def _on_task_failed(self, name: str, error: BaseException) -> None:
        told = str(error) if isinstance(error, NetworkError) else f"{name} is not looked after any more: {error!r}"
        self._journal.warn(told)
        self._stopping.finish(1)

    # -- what members ask and tell -----------------------------------------------------------------

    def environment(self, plan: ProcessPlan) -> dict[str, str]:
        """The environment of a process; each start has its own."""
        return self._environment.of(plan)

    def unmet(self, plan: ProcessPlan) -> list[str]:
        """What a process still waits for, in words."""
        return needs.unmet(plan, self._members, self._presence.elsewhere, self._robot)

    def flow(self, key: str) -> Flow | None:
        """What comes on a topic that is watched."""
        return self._topics.flows.get(key)

    def sigkill_hint(self) -> str:
        """What is to be said of a process that has just been ended by a SIGKILL that nobody here has sent."""
        return self._memory_kills.hint()

    def left_behind(self, left: Left) -> None:
        """A process was still there when the one that had started it was gone; it has been ended."""
        self._journal.left_behind(left)

    def output(self, member: Member, stream: str, text: str) -> None:
        """A line that a process has printed."""
        self._journal.output(member, stream, text)

    def changed(self, member: Member, before: State) -> None:
        """A process has come to another state, or to another reason for it."""
        self.changes.notify()
        if member.state == before:
            return
        self._news.changed(member, closing=self._stopping.begun)
        if not self._stopping.begun:
            consequences.draw(member, self._members, self._tasks, self._stopping)
            self._tell_starter()

    def _tell_starter(self) -> None:
        self._news.tell_starter(ends=self._stopping.begun or not needs.can_go_on(self._members))

    def _shows_token(self, name: str) -> bool:
        # What another host runs is waited for by this supervisor, not by the node itself.
        return name in self._members and self._members[name].plan.ready.when == "node"

    # -- what comes and goes with the manifest -------------------------------------------------------

    async def add(self, plan: ProcessPlan) -> bool:
        """Begin to run a process that the run did not have, unless somebody else has its name."""
        taken = await self._presence.claim(plan.full_name)
        if taken is None:
            self._make(plan)
            self._begin_life(plan.full_name)
        else:
            self._journal.warn(f"{names.label(self._robot, plan.full_name)} is not started: {taken}")
        return taken is None

    async def remove(self, name: str) -> None:
        """Stop a process, and go on without it."""
        await self._members[name].stop()
        del self._members[name]
        self._lives.pop(name).cancel()
        self._presence.release(name)
        self.changes.notify()

    def renew(self, names: Collection[str]) -> None:
        """Nodes are about to be started anew, by full name: a process that they share with nobody else is new too."""
        staying = [one.plan.process for name, one in self._members.items() if one.running and name not in names]
        self._houses.renew({self._members[name].plan.process for name in names}.difference(staying))

    # -- while it runs -----------------------------------------------------------------------------

    async def _supervise(self) -> None:
        """Wait until the run is to end."""

        def over() -> bool:
            if self._where is not None:
                self._news.look(self._robot, self._where, with_timing=self._timing)
            if self._attendance is not None:
                self._attendance.look()
            if not needs.can_go_on(self._members):
                self._stopping.finish(None)
            return self._stopping.begun

        await self.changes.until(over)

    async def _look_after(self) -> None:
        """See a few times a second whether all are healthy."""
        last = time.monotonic()
        while True:
            await asyncio.sleep(_TICK)
            now = time.monotonic()
            self._topics.mark(now)
            for member in self._members.values():
                if now - last > 4 * _TICK:
                    member.excuse_silence(now)
                if now - self._news.begin > _STARTING:
                    member.measure()
                member.check(now)
            last = now
            self._custody.reap()
            if self._unread is not None and self._unread():
                self._unread = None
                self._console.close()
            self._memory_kills.look(now)
            self._log_writer.look()
            if self._log_writer.wants_room():
                self._tasks.do(asyncio.to_thread(log_space.make_room, *self._log_room))
            if self._reload is not None and not self._stopping.begun:
                self._reload.look()

    async def _end(self) -> None:
        """Leave nothing behind. What goes wrong with one thing keeps no other from its end."""
        steps: list[Callable[[], Coroutine[Any, Any, object] | None]] = [
            self._claim.close,
            self._stopping.stop_all,
            self._houses.close,
            lambda: self._journal.event("down"),
            self._tasks.cancel,
            self._router.stop,
            lambda: self.template.close() if self.template is not None else None,
            self._presence.leave,
            lambda: self._custody.sweep(self._journal.left_behind),
            self._custody.release,
            self._custody.remove_folder,
            lambda: self._journal.summarize(self._stopping.failed),
            self._log_writer.close,
        ]
        for step in steps:
            try:
                work = step()
                if work is not None:
                    await work
            except Exception as error:
                self._journal.warn_of(error)


def run(plan: Plan, router: Network, options: RunOptions | None = None) -> int:
    """Run a plan in the foreground until it ends or is interrupted.

    Args:
        plan: what to start.
        router: how the robot's router joins the network.
        options: how this run differs from a plain one.

    Returns:
        The exit code for the command.
    """
    options = options or RunOptions()
    named = {name for p in plan.processes for name in (p.full_name, p.process) if name is not None}
    console = Console(sorted({names.label(plan.robot, name) for name in named}))
    return asyncio.run(_run(plan, router, console, options))


async def _run(plan: Plan, router: Network, console: Console, options: RunOptions) -> int:
    custody = Custody.begin(options.begun.run_id if options.begun is not None else new_run_id())
    environment = {**base_environment(), RUN_VARIABLE: custody.run}
    if options.log_level is not None:
        environment[LOG_LEVEL_VARIABLE] = options.log_level
    if options.reload is not None:
        environment[WATCH_VARIABLE] = "1"
    return await Supervisor(plan, router, console, environment, options, custody).run()


def _child(houses: Houses, member: Member, spawned: Spawned, *hears: Any) -> instance.Child:
    """A process of its own, or a place in one that it shares."""
    process = member.plan.process
    return Lodger(houses, process, member.label, *hears) if process else Child(spawned, *hears)


def _may_link(plan: Plan) -> bool:
    """Whether the nodes of a plan link to each other: those of one robot, as long as they are few.

    Links grow with the square of the nodes, and nobody needs them between robots.
    """
    robots = {process.namespace.partition("/")[0] for process in plan.processes}
    return len(robots) <= 1 and len({one.process or one.full_name for one in plan.processes}) <= MOST_LINKED


def _log_files(plan: Plan, router: Network, run: str) -> LogFiles:
    """The log files of a run that begins now."""
    info = RunInfo(
        run=run,
        robot=plan.robot,
        manifest=plan.manifest,
        begin=time.time_ns(),
        pid=os.getpid(),
        nodes=[p.full_name for p in plan.processes],
        groups=[p.group for p in plan.processes],
        processes=[p.process or "" for p in plan.processes],
        endpoints=list(router.listen),
    )
    count = len({*info.nodes, *info.processes} - {""}) + 1  # and its own
    most = log_space.run_limit(log_space.limit(log_base()))
    return LogFiles(info, largest=log_space.file_limit(most, count))
