"""One run of a plan: its router, its processes in order, their health, and the end of all of them.

The supervisor is one asyncio loop. Each process has a task of its own that lives its life (`Member`);
this module lets them know of each other, of the network and of commands.
"""

import asyncio
import graphlib
import os
import signal
import time
import traceback
from collections import deque
from collections.abc import Callable, Coroutine, Iterable, Mapping, Sequence, Set
from contextlib import suppress
from functools import partial

import msgspec
import zenoh

from robo.environment import LOG_LEVEL_VARIABLE, RUN_VARIABLE, WATCH_VARIABLE
from robo.errors import NetworkError, NodeNotFound, RunError
from robo.launch.plan import Plan, ProcessPlan, StopPlan, TopicPlan
from robo.machine import last_resort, log_space
from robo.machine.child import Child
from robo.machine.custody import Custody
from robo.machine.forks import Template
from robo.machine.log_files import SUPERVISOR, Filter, LogFiles, RunInfo, record
from robo.machine.log_writer import LogWriter
from robo.machine.memory_kills import MemoryKills
from robo.supervisor.console import Console
from robo.supervisor.control import Control
from robo.supervisor.early import HeadStart, base_environment
from robo.supervisor.member import Changes, Member
from robo.supervisor.reload import FileWatch, files_of, same
from robo.supervisor.router import Router
from robo.supervisor.run_environment import RunEnvironment
from robo.supervisor.sites import Sites
from robo.supervisor.timing import Started, timing_text
from robo.supervisor.topic_watch import Flow, TopicWatch
from robo.text.brief import shown
from robo.text.suggestions import suggest
from robo.wire import claims, discovery, keys, names
from robo.wire.keys import ClaimToken, NodeToken, SupervisorToken, parse_supervisor_token, supervisors_key
from robo.wire.network import Network
from robo.wire.reports import (
    Event,
    Explanation,
    LogRecord,
    LogsRequest,
    Outcome,
    ProcessName,
    ProcessStatus,
    Request,
    Site,
    State,
)
from robo.wire.run_id import new_run_id
from robo.wire.session import close_session, open_session

STOP_LIMIT = 2.0
"""How long the stop of a launch may take, s, before all that still run are killed, unless the manifest
gives single processes more."""

_HURRY = 0.5
"""How long processes have after a second Ctrl-C, s."""

_STARTING = 2.0
"""For how long nobody's processor time is measured, s: that would take a tenth of what a start takes."""

_LAST_RESORT = 15.0
"""How long all but the processes may take to end, s: the network, and what processes have left behind."""

_TICK = 0.25
_LONGEST_SHOWN = 120
"""How much is shown of a key that a stranger has made."""
MOST_LINKED = 30
"""More nodes than these do not link to each other; the router passes their messages on."""
_MOST_EVENTS = 1000
_MOST_LINES = 5000
"""Lines of output that are kept for those who ask over the network."""
_ONE_SCREEN = 24
"""Lines that whoever looks at the console has before his eyes: nobody needs to be told them again."""


class Options(msgspec.Struct, frozen=True, kw_only=True):
    """How a run differs from a plain one."""

    log_level: str | None = None
    """Of every node; by default ROBO_LOG_LEVEL or info."""
    timing: bool = False
    """Print where the time of the start went."""
    reload: Callable[[], Plan | str] | None = None
    """Reads the manifest again, or tells its mistakes; with it changed files restart what they touch."""
    notify: Callable[[str], None] | None = None
    """Is told `up`, `ready` and `down`: for whoever waits for a run in the background."""
    begun: HeadStart | None = None
    """What of the run has begun already."""


class Supervisor:
    """One run of a plan."""

    def __init__(
        self,
        plan: Plan,
        router: Network,
        console: Console,
        environment: Mapping[str, str],
        options: Options,
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
        self._plan = plan
        self._console = console
        self._options = options
        self._custody = custody
        self._run_id = custody.run
        self.spawned = custody.spawned
        started = options.begun.template if options.begun is not None else None
        self.template = Template(*started) if started is not None else None
        self._socket = f"unixsock-stream/{custody.folder}/router.sock"
        base = {**environment, RUN_VARIABLE: self._run_id}
        if options.reload is not None:
            base[WATCH_VARIABLE] = "1"
        self._environment = RunEnvironment(
            base, custody.folder, self._socket, self._shows_token, direct=_may_link(plan)
        )
        self._log_limit = log_space.limit()
        self._log_files = LogFiles(
            RunInfo(
                run=self._run_id,
                robot=plan.robot,
                manifest=plan.manifest,
                begin=time.time_ns(),
                pid=os.getpid(),
                nodes=[p.full_name for p in plan.processes],
                groups=[p.group for p in plan.processes],
                endpoints=list(router.listen),
            )
        )
        self._memory_kills = MemoryKills(time.monotonic())
        self._log_writer = LogWriter(self._log_files, self._on_log_trouble)
        self.changes = Changes()
        self._members = {p.full_name: Member(p, label_of(plan, p), self) for p in plan.processes}
        self._elsewhere: dict[str, set[NodeToken]] = {}
        """The tokens of nodes that others run, by full name, as long as they are ready."""
        self._unreadable = 0
        """Tokens that spell nothing."""
        self._recent: deque[LogRecord] = deque(maxlen=_MOST_LINES)
        self._lives: dict[str, asyncio.Task[None]] = {}
        self._chores: set[asyncio.Task[None]] = set()
        self._tended: list[asyncio.Task[None]] = []
        self._claim = claims.Claim(router, plan.robot, [p.full_name for p in plan.processes], self._run_id)
        sites = [endpoint for endpoint in router.connect if endpoint not in router.listen]
        self._sites = Sites(plan.robot, sites, self.warn, self._say)
        self._claimed: dict[str, zenoh.LivelinessToken] = {}
        """By full name, what keeps others from running a node of that name."""
        self._settled = False
        """Whether others see these."""
        self._session: zenoh.Session | None = None
        self._router = Router(
            Child(custody.spawned, lambda _, line: console.line(SUPERVISOR, f"router: {line}")),
            msgspec.structs.replace(router, name=plan.robot, listen=(self._socket, *router.listen)),
            base,
            self.template,
            self,
        )
        self._topics: TopicWatch | None = None
        self._control: Control | None = None
        self._files = FileWatch()
        self._events: list[Event] = []
        self._stop = asyncio.Event()
        self._exit_code: int | None = None
        self._failed: list[Member] = []
        self._stop_requests = 0
        self._announced = False
        self._phases: list[tuple[str, float]] = []

    async def run(self) -> int:
        """Start everything, wait for the end, stop everything.

        Returns:
            The exit code: 0 all went well, 1 a process failed, 130 interrupted.
        """
        self._begin = time.monotonic()
        self._phase("Python, manifest and node classes")
        if self.template is not None:
            self.spawned.add(self.template.process.pid)
            self.template.listen()
        loop = asyncio.get_running_loop()
        self._take_signals(loop)
        try:
            ended = await self._custody.end_leftovers()
            if ended:
                self.warn(f"ended {len(ended)} processes that an earlier run had left behind: {ended}")
            refusal = await asyncio.to_thread(self._refusal)
            if refusal is not None:
                for line in refusal.splitlines():
                    self.warn(line)
                self._finish(1)
                return 1
            self._log_writer.begin()  # a run that is refused leaves no files
            self._sites.note(self._claim.unreached)
            await self._router.start()
            self._tend(self._router.keep(), "the router")
            self._phase("router started")
            for name in self._members:
                self._begin_life(name)
            if await self._join(loop):
                self._event("up", "")
                self._tell_of_the_failed()
                self._tend(self._settle(), "the claim of names")
                self._tend(self._watch_sites(), "the links to sites")
                self._tend(self._look_after(), "the run")
            await self._supervise()
        except Exception as error:
            self._warn_of(error)
            self._finish(1)
        finally:
            last_resort.end_within(self._stop_limit() + _LAST_RESORT)
            await self._end()
        if self._options.notify is not None:
            self._options.notify("down")
        return self._result()

    async def _end(self) -> None:
        """Leave nothing behind. What goes wrong with one thing keeps no other from its end."""

        def stop_tending() -> None:
            for task in (*self._lives.values(), *self._tended, *self._chores):
                task.cancel()

        async def sweep() -> None:
            for pid in await self._custody.sweep():
                self.warn(f"ended process {pid}, which a node had left behind")

        steps: list[Callable[[], Coroutine[object, object, object] | None]] = [
            self._claim.close,
            self._stop_all,
            lambda: self._event("down", ""),
            stop_tending,
            self._router.stop,
            lambda: self.template.close() if self.template is not None else None,
            lambda: asyncio.to_thread(close_session, self._session) if self._session is not None else None,
            sweep,
            self._custody.release,
            self._custody.remove_folder,
            self._summarize,
            self._log_writer.close,
        ]
        for step in steps:
            try:
                work = step()
                if work is not None:
                    await work
            except Exception as error:
                self._warn_of(error)

    def _warn_of(self, error: Exception) -> None:
        """Tell of a mistake of robo's own."""
        self.warn(f"the supervisor has failed: {type(error).__name__}: {error}")
        for line in "".join(traceback.format_exception(error)).splitlines():
            self.warn(f"  {line}")

    # -- start -----------------------------------------------------------------------------------

    def _refusal(self) -> str | None:
        """Why this run may not start, where others have its names or its port, in words; else they are its own."""
        try:
            taken = self._claim.take()
        except NetworkError as error:
            return str(error)
        replies = (
            reply
            for session in self._claim.sessions
            for reply in session.liveliness().get(supervisors_key(self._plan.robot), timeout=claims.ANSWERS_WITHIN)
        )
        tokens = (parse_supervisor_token(str(reply.ok.key_expr)) for reply in replies if reply.ok is not None)
        # Another host's part of the robot may run beside this one.
        mine = self._plan.host
        same = [one for one in tokens if one is not None and not (one.part and mine and one.part != mine)]
        if same:
            runs = f"{self._plan.robot} runs already (process {same[0].pid} on {same[0].machine})"
        elif taken:
            runs = claims.told(taken)
        else:
            return None
        return f"{runs}; stop it with `robo down` or choose another --robot-name"

    async def _settle(self) -> None:
        """Hold the names until others see the tokens of this run's own session."""
        await asyncio.to_thread(self._claim.settle, self._is_seen)
        self._settled = True

    async def _watch_sites(self) -> None:
        if self._session is not None:
            await self._sites.watch(self._session)

    def _is_seen(self, session: zenoh.Session) -> bool:
        replies = session.liveliness().get(self._token_key, timeout=claims.ANSWERS_WITHIN)
        return any(reply.ok is not None for reply in replies)

    def _tend(self, work: Coroutine[object, object, None], name: str) -> None:
        """Do something for as long as the run lasts."""
        task: asyncio.Task[None] = asyncio.create_task(work, name=name)
        task.add_done_callback(self._on_life_over)
        self._tended.append(task)

    def _begin_life(self, name: str) -> None:
        life = asyncio.create_task(self._members[name].live(), name=name)
        life.add_done_callback(self._on_life_over)
        self._lives[name] = life

    def _on_life_over(self, life: "asyncio.Task[None]") -> None:
        if not life.cancelled() and life.exception() is not None:
            self.warn(f"{life.get_name()} is not looked after any more: {life.exception()!r}")
            self._finish(1)

    async def _join(self, loop: asyncio.AbstractEventLoop) -> bool:
        """Learn from liveliness tokens which nodes are ready, and answer commands.

        Returns:
            Whether the robot's router could be reached.
        """
        try:
            session = self._session = await asyncio.to_thread(
                open_session, Network(mode="client", connect=(self._socket,))
            )
        except NetworkError as error:
            self.warn(f"the robot's router cannot be reached: {error}")
            self._finish(1)
            return False

        def notice(sample: zenoh.Sample) -> None:
            key = str(sample.key_expr)
            token = keys.parse_token(key)
            if isinstance(token, NodeToken):
                work = self._on_token if sample.kind == zenoh.SampleKind.PUT else self._on_token_gone
                loop.call_soon_threadsafe(work, token)
            elif isinstance(token, ClaimToken) and sample.kind == zenoh.SampleKind.PUT:
                loop.call_soon_threadsafe(self._on_claim, token)
            elif token is None and parse_supervisor_token(key) is None and sample.kind == zenoh.SampleKind.PUT:
                loop.call_soon_threadsafe(self._on_unreadable, key)

        self._claimed = dict(zip(self._members, claims.declare(session, self._claim.tokens), strict=True))
        session.liveliness().declare_subscriber(keys.ALL_TOKENS, notice, history=True)
        self._topics = TopicWatch(session, self._promises())
        verbs = {
            "ps": self._ps,
            "why": self._why,
            "events": self._past_events,
            "logs": self._past_output,
            "sites": self._tell_sites,
            "stop": self._stop_some,
            "start": self._start_some,
            "restart": self._restart_some,
            "down": self._down,
        }
        self._control = Control(session, self._plan.robot, verbs, loop)
        host, user = discovery.hostname(), discovery.user()
        token = SupervisorToken(self._plan.robot, os.getpid(), host, self._plan.host, str(session.zid()), user)
        self._token_key = token.key()
        self._token = session.liveliness().declare_token(self._token_key)
        return True

    def _promises(self) -> list[TopicPlan]:
        """The topics whose messages are counted: something is promised of them, or somebody waits for them."""
        found = {
            t.key: t for t in self._plan.topics if not t.external and (t.min_rate is not None or t.max_age is not None)
        }
        for member in self._members.values():
            for key in member.plan.ready.topics:
                plain = TopicPlan(key=key, source=member.plan.source)
                found.setdefault(key, plain)
        return list(found.values())

    def _on_token(self, token: NodeToken) -> None:
        member = self._members.get(token.full_name)
        if member is None:
            self._elsewhere.setdefault(token.full_name, set()).add(token)
            self.changes.notify()
        elif self._is_of(member, token):
            member.notice_token(token.pid)
        elif not self._yields(token):
            self.warn(f"another {token.full_name} has come up (process {token.pid} on {token.host})")

    def _on_claim(self, token: ClaimToken) -> None:
        if token.full_name in self._members and token.run != self._run_id:
            self._yields(token)

    def _yields(self, token: NodeToken | ClaimToken) -> bool:
        """Give way to another that has a node's name, where both have begun at once and it did so earlier.

        One that began later has seen the claims of this run, and gives way itself.
        """
        if self._settled or token.run > self._run_id:
            return False
        self.warn(f"{claims.told([token])}; stop it with `robo down` or choose another --robot-name")
        self._finish(1)
        return True

    def _is_of(self, member: Member, token: NodeToken) -> bool:
        """Whether a token is that of a member's process, which may not even be known to have started."""
        here = token.host == discovery.hostname()
        if token.run == self._run_id:
            return not (
                here and any(other is not member and other.leads(token.pid) for other in self._members.values())
            )
        # What empties its environment, as sudo does, has lost the run's id.
        return not token.run and here and member.owns(token.pid)

    def _on_token_gone(self, token: NodeToken) -> None:
        same = self._elsewhere.get(token.full_name, set())
        same.discard(token)
        if not same:  # strangers make up names without end
            self._elsewhere.pop(token.full_name, None)

    def _on_unreadable(self, key: str) -> None:
        self._unreadable += 1
        if self._unreadable == 1:
            what = shown(key, _LONGEST_SHOWN)
            self.warn(f"ignoring a liveliness token that means nothing here, and others like it: {what}")

    # -- what members ask --------------------------------------------------------------------------

    def environment(self, plan: ProcessPlan) -> dict[str, str]:
        """The environment of a process; each start has its own."""
        return self._environment.of(plan)

    def unmet(self, plan: ProcessPlan) -> list[str]:
        """What a process still waits for, in words."""
        found = []
        for name, until in plan.needs.items():
            need = self._members.get(name)
            if need is None and not self._elsewhere.get(name):
                found.append(f"{names.within(self._plan.robot, name)} {until}, on another host")
            if need is not None and not need.reached(until):
                hopeless = "" if need.may_reach(until) else f", which is {need.state}"
                found.append(f"{need.label} {until}{hopeless}")
        return found

    def flow(self, key: str) -> Flow | None:
        """What comes on a topic that is watched."""
        return self._topics.flows.get(key) if self._topics is not None else None

    def sigkill_hint(self) -> str:
        """What is to be said of a process that has just been ended by a SIGKILL that nobody here has sent."""
        return self._memory_kills.hint()

    def output(self, member: Member, stream: str, text: str) -> None:
        """A line that a process has printed."""
        where = member.plan.log.output
        if where != "file":
            self._console.line(member.label, text)
        if where != "screen":
            self._log(record(member.label, stream, text))

    def changed(self, member: Member, before: State) -> None:
        """A process has come to another state, or to another reason for it."""
        state, reason = member.state, member.reason
        self.changes.notify()
        if state == before:
            return
        self._event(state, reason, member)
        closing = self._stop.is_set()
        if state in ("failed", "restarting"):
            self.warn(f"{member.label} {reason or state}")
        elif state == "degraded":
            self.warn(f"{member.label} is degraded: {reason}")
        elif state == "completed" or (state == "stopped" and not closing):
            self._say(f"{member.label} {reason}" if state == "completed" else f"{member.label} is stopped")
        elif state == "ready" and (self._announced or member.restarts.count) and member.shows_readiness:
            self._say(f"{member.label} is ready" + (" again" if member.restarts.count else ""))
        if closing:
            return
        self._tell_of_the_failed()
        if member.finished:
            for other in self._members.values():
                until = other.plan.needs.get(member.plan.full_name)
                if until is not None and not other.exits and not other.running and not member.may_reach(until):
                    self.warn(f"{other.label} is not started: it needs {member.label} {until}")
        if state == "restarting" and member.plan.restart.propagate:
            self._restart_dependents(member)
        if member.plan.required and (member.down or state == "completed"):
            self._finish(0 if state == "completed" else 1)

    def _tell_of_the_failed(self) -> None:
        """Let whoever waits for this run in the background know that it will not be ready all by itself."""
        if self._announced or self._control is None or self._options.notify is None:
            return  # who is told too early finds nobody to ask
        for member in self._members.values():
            if member.down:
                self._options.notify(f"{member.label} {member.reason}")

    def _restart_dependents(self, member: Member) -> None:
        """Those that need it, and those that need these, start again after it."""
        names = {member.plan.full_name}
        while more := {n for n, m in self._members.items() if n not in names and m.plan.needs.keys() & names}:
            names |= more
        for name in names - {member.plan.full_name}:
            other = self._members[name]
            if other.running and other.wanted:
                self._do(other.restart(f"starting again with {member.label}, which it needs"))

    # -- while it runs -----------------------------------------------------------------------------

    async def _supervise(self) -> None:
        """Wait until the launch is to end."""

        def over() -> bool:
            self._announce()
            if not self._can_go_on():
                self._finish(None)
            return self._stop.is_set()

        await self.changes.until(over)

    def _can_go_on(self) -> bool:
        """Whether anything runs, will run, or has been stopped by a command that another may undo."""
        waiting: set[str] = set()
        for name, member in self._members.items():
            if member.running or member.next_start is not None or not member.wanted:
                return True
            if not member.finished:
                waiting.add(name)
        # What waits can go on if what it waits for can.
        while True:
            blocked = {
                name
                for name in waiting
                for need, until in self._members[name].plan.needs.items()
                if need in self._members and need not in waiting and not self._members[need].may_reach(until)
            }
            if not blocked:
                return bool(waiting)
            waiting -= blocked

    async def _look_after(self) -> None:
        """See a few times a second whether all are healthy."""
        last = time.monotonic()
        while True:
            await asyncio.sleep(_TICK)
            now = time.monotonic()
            flows = self._topics.flows.values() if self._topics is not None else ()
            for flow in flows:
                flow.mark(now)
            for member in self._members.values():
                if now - last > 4 * _TICK:
                    member.excuse_silence(now)
                if now - self._begin > _STARTING:
                    member.measure()
                why = member.check(now)
                if why is not None:
                    self._on_hang(member, why)
            last = now
            self._custody.reap()
            self._memory_kills.look(now)
            self._log_writer.look()
            if self._log_writer.wants_room():
                own = self._log_files.folder
                self._do(asyncio.to_thread(log_space.make_room, own.parent.parent, self._log_limit, own))
            if self._options.reload is not None:
                self._look_for_changed_files()

    def _on_hang(self, member: Member, why: str) -> None:
        if member.plan.restart.policy == "never" and not member.plan.required:
            member.stays_hung(why)
        else:
            self._do(member.end_because(why, ask_where=True))

    def _announce(self) -> None:
        # What has done its work and ended well is as good as ready.
        if self._announced or not all(m.healthy() for m in self._members.values()):
            return
        self._announced = True
        seconds = time.monotonic() - self._begin
        where = ", ".join(e for e in self._router.network.listen if not e.startswith("unixsock"))
        count = len(self._members)
        nodes = "1 node" if count == 1 else f"{count} nodes"
        self._say(f"{self._plan.robot} is ready: {nodes} in {seconds:.2f} s, at {where}; Ctrl-C stops")
        if self._options.timing:
            for line in self._timing():
                self._say(line)
        self._event("ready", "")

    def _timing(self) -> list[str]:
        import psutil  # which takes a tenth of a start, and this one is done

        born = psutil.Process().create_time()
        shift = time.time() - time.monotonic() - born
        started = {
            name: Started(m.label, list(m.plan.needs), m.started_at + shift, m.ready_at + shift)
            for name, m in self._members.items()
            if m.ready
        }
        return timing_text([(what, at - born) for what, at in self._phases], started)

    def _phase(self, what: str) -> None:
        self._phases.append((what, time.time()))

    # -- changed files -------------------------------------------------------------------------------

    def _look_for_changed_files(self) -> None:
        touched = self._files.changed(
            {"": files_of(self._plan)} | {name: (*m.files, *files_of(m.plan)) for name, m in self._members.items()}
        )
        if not touched:
            return
        if "" in touched:
            assert self._options.reload is not None
            plan = self._options.reload()
            if isinstance(plan, str):
                for line in plan.splitlines():
                    self.warn(line)
            else:
                self._take_over(plan)
        for name in touched.keys() - {""}:
            member = self._members.get(name)
            if member is not None and member.wanted and not member.reason.startswith("changed"):
                self._do(member.restart(f"changed: {', '.join(sorted(touched[name]))}"))

    def _take_over(self, plan: Plan) -> None:
        """Go on with another plan: only what is different in it is started, stopped, or started again."""
        self._plan = plan
        wanted = {p.full_name: p for p in plan.processes}
        for name, new in wanted.items():
            member = self._members.get(name)
            if member is None:
                self._members[name] = Member(new, label_of(plan, new), self)
                self._claim_name(name)
                self._begin_life(name)
            elif not same(member.plan, new):
                member.take_over(new)
                self._do(member.restart("changed: its part of the manifest or of its parameter files"))
            else:
                member.plan = new
        for name in self._members.keys() - wanted.keys():
            self._do(self._remove(name))

    def _claim_name(self, name: str) -> None:
        if self._session is not None:
            (self._claimed[name],) = claims.declare(self._session, [self._claim.token_of(name)])

    async def _remove(self, name: str) -> None:
        await self._members[name].stop()
        del self._members[name]
        self._lives.pop(name).cancel()
        if name in self._claimed:
            self._claimed.pop(name).undeclare()
        self.changes.notify()

    # -- commands ------------------------------------------------------------------------------------

    async def _ps(self, request: Request) -> list[ProcessStatus]:
        return [self._status(member) for member in self._chosen(request)]

    async def _why(self, request: Request) -> list[Explanation]:
        return [m.explain(self._status(m), self.unmet(m.plan)) for m in self._chosen(request)]

    async def _past_events(self, request: Request) -> list[Event]:
        chosen = {m.plan.full_name for m in self._chosen(request)} if request.names else None
        return [event for event in self._events if chosen is None or event.node in chosen]

    async def _past_output(self, request: LogsRequest) -> list[LogRecord]:
        labels = {member.label for name in request.names for member in self._meant(name).values()}
        labels |= {SUPERVISOR} & {*request.names}
        wanted = Filter(since=request.since, least=request.level)
        found = [one for one in self._recent if (not request.names or one.node in labels) and wanted.wants(one)]
        return found if request.lines is None else found[-request.lines :] if request.lines else []

    async def _tell_sites(self, _: Request) -> list[Site]:
        return [*self._sites.all.values()]

    async def _stop_some(self, request: Request) -> Outcome:
        chosen = self._chosen(request)
        await self._all(member.stop() for member in chosen)
        return self._done(chosen, request)

    async def _start_some(self, request: Request) -> Outcome:
        chosen = [member for member in self._chosen(request) if not member.running]
        await self._all(member.restart("as asked") for member in chosen)
        return self._done(chosen, request)

    async def _restart_some(self, request: Request) -> Outcome:
        chosen = self._chosen(request)
        await self._all(member.restart("as asked") for member in chosen)
        return self._done(chosen, request)

    def _done(self, members: Sequence[Member], request: Request) -> Outcome:
        return Outcome([m.plan.full_name for m in members], [name for name in request.names if not self._meant(name)])

    async def _down(self, request: Request) -> Outcome:
        if request.names:
            raise RunError("down ends the whole run and takes no names; stop ends nodes and groups")
        self._say("stopping, as robo down asks")
        asyncio.get_running_loop().call_later(0.05, self._finish, 0)  # the answer leaves before the network does
        return Outcome([*self._members])

    def _chosen(self, request: Request) -> list[Member]:
        """The members that names mean: full names, names as the output has them, names of groups or their parts."""
        if not request.names:
            return list(self._members.values())
        found: dict[str, Member] = {}
        for name in request.names:
            means = self._meant(name)
            if not means and not self._plan.host:  # another host's supervisor may know it
                known = [m.label for m in self._members.values()] + [m.plan.group for m in self._members.values()]
                instead = suggest(name, known, "it has")
                raise NodeNotFound(f"robot {self._plan.robot} has no node or group {name!r}; {instead}")
            found |= means
        return list(found.values())

    def _meant(self, name: str) -> dict[str, Member]:
        robot = self._plan.robot
        return {full: m for full, m in self._members.items() if ProcessName(robot, full, m.plan.group).is_meant(name)}

    def _status(self, member: Member) -> ProcessStatus:
        status = member.status(self._plan.robot, self._run_id, self._plan.host or discovery.hostname())
        return msgspec.structs.replace(status, log_problem=self._log_writer.problem)

    # -- stop ----------------------------------------------------------------------------------------

    def _take_signals(self, loop: asyncio.AbstractEventLoop) -> None:
        """End when told to, even where the loop does not come to it: its output may be blocked, for example."""

        def handle(number: int, _: object) -> None:
            last_resort.end_within(self._stop_limit() + _LAST_RESORT)
            with suppress(RuntimeError):  # the loop is closed
                loop.call_soon_threadsafe(self._on_signal, signal.Signals(number))

        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, handle)

    def _on_signal(self, number: signal.Signals) -> None:
        self._stop_requests += 1
        if self._stop_requests == 1:
            self._say("stopping; Ctrl-C again to hurry, a third time to kill")
            self._finish(128 + signal.SIGINT if number == signal.SIGINT else 0)
        elif self._stop_requests == 2:
            for member in self._members.values():
                member.send(signal.SIGTERM)
            asyncio.get_running_loop().call_later(_HURRY, self._kill_all)
        else:
            self._kill_all()

    def _finish(self, exit_code: int | None) -> None:
        """End the launch; the first one to say so decides the exit code."""
        if not self._stop.is_set():
            self._failed = [m for m in self._members.values() if m.failed]
            self._exit_code = exit_code
            self._stop.set()
            self.changes.notify()

    async def _stop_all(self) -> None:
        """Stop processes, each after those that need it; all at once where nothing needs another."""
        self._stop.set()
        for member in self._members.values():
            member.wanted = False
        limit = asyncio.get_running_loop().call_later(self._stop_limit(), self._kill_all)
        stopping: dict[str, asyncio.Task[None]] = {}
        while alive := {n: m for n, m in self._members.items() if m.running or m.spawning}:
            needed = {need for member in alive.values() for need in member.plan.needs}
            for name, member in alive.items():
                if name not in stopping and name not in needed and member.running:
                    stopping[name] = asyncio.create_task(member.stop())
            self.changes.notify()
            await self.changes.until(partial(self._has_got_on, alive.keys(), stopping.keys() | needed))
        await asyncio.gather(*stopping.values())
        limit.cancel()

    def _has_got_on(self, alive: Set[str], settled: Set[str]) -> bool:
        """Whether one of those that were alive has ended, or one that was being started can be stopped now."""
        members = self._members
        return any(not (members[n].running or members[n].spawning) for n in alive) or any(
            members[n].running for n in alive - settled
        )

    def _stop_limit(self) -> float:
        """All that the manifest grants to those that stop one after the other."""
        plans = {name: m.plan for name, m in self._members.items()}
        if all(plan.stop.timeout <= StopPlan().timeout for plan in plans.values()):
            return STOP_LIMIT
        spans: dict[str, float] = {}
        for name in graphlib.TopologicalSorter({n: p.needs for n, p in plans.items()}).static_order():
            if name in plans:
                longest = max((spans.get(need, 0.0) for need in plans[name].needs), default=0.0)
                spans[name] = 1.5 * plans[name].stop.timeout + longest
        return max(STOP_LIMIT, *spans.values())

    def _kill_all(self) -> None:
        for member in self._members.values():
            if member.running:
                self.warn(f"{member.label} does not end; killing it")
                member.send(signal.SIGKILL)

    # -- what is said ----------------------------------------------------------------------------------

    def _event(self, what: str, reason: str, member: Member | None = None) -> None:
        event = Event(
            time=time.time_ns(),
            robot=self._plan.robot,
            node=member.plan.full_name if member is not None else "",
            event=what,
            reason=reason,
            pid=member.pid if member is not None else os.getpid(),
            restarts=member.restarts.count if member is not None else 0,
        )
        self._events.append(event)
        del self._events[:-_MOST_EVENTS]
        if self._control is not None:
            self._control.publish(event)
        if member is None and self._options.notify is not None and what != "down":
            self._options.notify(what)

    def _say(self, text: str) -> None:
        self._console.say(text)
        self._log(LogRecord(time=time.time_ns(), node=SUPERVISOR, message=text, level="INFO"))

    def warn(self, text: str) -> None:
        """Tell what went wrong."""
        self._console.warn(text)
        self._log(LogRecord(time=time.time_ns(), node=SUPERVISOR, message=text, level="WARN"))

    def _log(self, line: LogRecord) -> None:
        self._keep(line)
        self._log_writer.write(line)

    def _keep(self, line: LogRecord) -> None:
        """Keep a line for those who ask over the network, and tell those who follow."""
        self._recent.append(line)
        if self._control is not None:
            self._control.publish_line(line)

    def _on_log_trouble(self, line: LogRecord) -> None:
        self._console.warn(line.message)
        self._keep(line)

    def _summarize(self) -> None:
        """Repeat why processes failed: their own last words, where these may have scrolled away."""
        for member in self._failed:
            if not member.exits:
                continue
            last = member.exits[-1]
            self.warn(f"{member.label} failed: {last.reason}")
            lines = last.last_lines[-8:]
            if member.plan.log.output != "file":
                on_screen = {one.message for one in list(self._recent)[-_ONE_SCREEN:] if one.node == member.label}
                if all(line in on_screen or line[6:] in on_screen for line in lines):  # without its level
                    lines = lines[-1:]
            for line in lines:
                self.warn(f"  {line}")

    def _result(self) -> int:
        if self._exit_code is not None:
            return self._exit_code
        unstarted = any(not m.exits and not m.finished for m in self._members.values())
        return 1 if self._failed or unstarted else 0

    # -- inside ----------------------------------------------------------------------------------------

    def _shows_token(self, name: str) -> bool:
        # What another host runs is waited for by this supervisor, not by the node itself.
        return name in self._members and self._members[name].plan.ready.when == "node"

    async def _all(self, works: Iterable[Coroutine[object, object, None]]) -> None:
        """Do all of it. Whoever waits may give up; what has begun goes on, for a stop may be half done."""
        await asyncio.gather(*(asyncio.shield(self._do(work)) for work in works))

    def _do(self, work: Coroutine[object, object, None]) -> "asyncio.Task[None]":
        chore: asyncio.Task[None] = asyncio.create_task(work)
        self._chores.add(chore)
        chore.add_done_callback(self._chores.discard)
        return chore


def run(plan: Plan, router: Network, options: Options | None = None) -> int:
    """Run a plan in the foreground until it ends or is interrupted.

    Args:
        plan: what to start.
        router: how the robot's router joins the network.
        options: how this run differs from a plain one.

    Returns:
        The exit code for the command.
    """
    options = options or Options()
    console = Console(sorted({label_of(plan, p) for p in plan.processes}))
    environment = base_environment()
    if options.log_level is not None:
        environment[LOG_LEVEL_VARIABLE] = options.log_level
    return asyncio.run(_run(plan, router, console, environment, options))


async def _run(plan: Plan, router: Network, console: Console, environment: Mapping[str, str], options: Options) -> int:
    custody = Custody.begin(options.begun.run_id if options.begun is not None else new_run_id())
    return await Supervisor(plan, router, console, environment, options, custody).run()


def _may_link(plan: Plan) -> bool:
    """Whether the nodes of a plan link to each other: those of one robot, as long as they are few.

    Links grow with the square of the nodes, and nobody needs them between robots.
    """
    robots = {process.namespace.partition("/")[0] for process in plan.processes}
    return len(robots) <= 1 and len(plan.processes) <= MOST_LINKED


def label_of(plan: Plan, process: ProcessPlan) -> str:
    """What a process is called in the output: its name, and its namespace where that is not the robot's."""
    return names.within(plan.robot, process.full_name)
