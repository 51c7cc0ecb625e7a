"""What a run can be asked and told: the verbs, and which of its processes a name means."""

import asyncio
from collections.abc import Callable, Collection, Coroutine, Iterable, Mapping, Sequence
from typing import Any, Protocol, TypeVar

import msgspec

from robo.errors import NodeNotFound, RunError
from robo.launch.plan import ProcessPlan
from robo.machine.log_files import SUPERVISOR, LogFilter
from robo.supervisor.process_life import STARTING_AGAIN
from robo.text.suggestions import suggest
from robo.wire import names
from robo.wire.reports import (
    Event,
    Explanation,
    Input,
    LogRecord,
    LogsRequest,
    Outcome,
    ProcessName,
    ProcessStatus,
    Request,
    RunReport,
    Site,
    SnapshotFile,
)

_FAREWELL = 0.05
"""How long the end of a run waits, s: the answer leaves before the network does."""


Verb = Callable[[LogsRequest], Coroutine[Any, Any, object]]
"""One that is not `logs` looks at the names alone."""


class Process(Protocol):
    """A process that can be asked and told."""

    label: str

    @property
    def plan(self) -> ProcessPlan:
        """How it is run."""

    @property
    def running(self) -> bool:
        """Whether a child of it runs."""

    def status(self, robot: str, run: str, host: str) -> ProcessStatus:
        """Its present state in figures."""

    def explain(self, status: ProcessStatus, unmet: list[str]) -> Explanation:
        """Why it is as it is."""

    async def stop(self) -> None:
        """Stop it and leave it so; returns when it has ended."""

    async def start(self) -> None:
        """Start it, if it does not run; returns when the process is there, or waits for what it needs."""

    async def restart(self, why: str) -> None:
        """End it, if it runs, and start it again at once; returns when the new process is there."""


class Journal(Protocol):
    """What has been told of the run."""

    @property
    def problem(self) -> str:
        """Why lines are in no file just now; empty where they are."""

    def say(self, text: str) -> None:
        """Tell what people may want to know."""

    def events(self, nodes: set[str] | None = None) -> list[Event]:
        """What has happened, in order: all of it, or what has to some nodes, by full name."""

    def lines(self, wanted: LogFilter, labels: set[str] | None = None, newest: int | None = None) -> list[LogRecord]:
        """What was printed, in order: by all, or by some processes; the newest of it, or all that is kept."""


class Tasks(Protocol):
    """What does things beside each other."""

    async def all(self, works: Iterable[Coroutine[Any, Any, object]]) -> None:
        """Do all of it; what has begun goes on where nobody waits for it any more."""


class Stopping(Protocol):
    """What ends the run."""

    def finish(self, exit_code: int | None) -> None:
        """End the run."""


class Sites(Protocol):
    """The sites that the robot was told to dial."""

    @property
    def all(self) -> Mapping[str, Site]:
        """By endpoint."""


class Address(msgspec.Struct, frozen=True):
    """Of what run it is that somebody asks."""

    robot: str
    run: str
    """The id."""
    host: str
    """The machine, or what the manifest calls it."""
    is_part: bool = False
    """Whether it runs only a host's part of a manifest: then others may know a name that it does not."""
    outside: frozenset[str] = frozenset()
    """The topics that come from outside of it, as the manifest says, by key."""


P = TypeVar("P", bound=Process)


class Commands:
    """Answers each verb. What is wrong with a request is a RoboError."""

    def __init__(
        self,
        address: Address,
        about: RunReport,
        processes: Mapping[str, Process],
        journal: Journal,
        sites: Sites,
        tasks: Tasks,
        stopping: Stopping,
        unmet: Callable[[ProcessPlan], list[str]],
        renew: Callable[[Collection[str]], None],
        snapshots: Callable[[str], list[SnapshotFile]] = lambda _: [],
    ) -> None:
        """
        Args:
            address: which run it is.
            about: what is told of it as a whole.
            processes: of the run, by full name.
            journal: what has been told of the run.
            sites: that the robot was told to dial.
            tasks: stops and starts several processes beside each other.
            stopping: ends the run.
            unmet: what a process still waits for, in words.
            renew: is told who is started anew, by full name, before it is.
            snapshots: what flight recorders have written on a node's account, by its full name.
        """
        self._address = address
        self._about = about
        self._processes = processes
        self._journal = journal
        self._tasks = tasks
        self._stopping = stopping
        self._sites = sites
        self._unmet = unmet
        self._renew = renew
        self._snapshots = snapshots

    @property
    def tells(self) -> dict[str, Verb]:
        """What only tells, by verb."""
        return {
            "about": self.about,
            "ps": self.ps,
            "why": self.why,
            "events": self.events,
            "logs": self.logs,
            "sites": self.sites,
        }

    @property
    def acts(self) -> dict[str, Verb]:
        """What does something, by verb."""
        return {"stop": self.stop, "start": self.start, "restart": self.restart, "down": self.down}

    # -- what only tells -------------------------------------------------------------------------

    async def about(self, _: Request) -> RunReport:
        """Which run it is, of which version of robo and of which manifest."""
        return self._about

    async def ps(self, request: Request) -> list[ProcessStatus]:
        """The state of processes in figures."""
        return [self._status(one) for one in self._chosen(request)]

    async def why(self, request: Request) -> list[Explanation]:
        """Why processes are in their states."""
        found = [one.explain(self._status(one), self._unmet(one.plan)) for one in self._chosen(request)]
        return [
            msgspec.structs.replace(
                one,
                inputs=[self._told(entry) for entry in one.inputs],
                snapshots=self._snapshots(one.process.node),
            )
            for one in found
        ]

    def _told(self, entry: Input) -> Input:
        return msgspec.structs.replace(entry, external=entry.topic in self._address.outside)

    async def events(self, request: Request) -> list[Event]:
        """What has happened."""
        chosen = {one.plan.full_name for one in self._chosen(request)} if request.names else None
        return self._journal.events(chosen)

    async def logs(self, request: LogsRequest) -> list[LogRecord]:
        """What was printed; the supervisor's own lines are `robo`'s."""
        meant = [(name, one) for name in request.names for one in self._meant(name)]
        labels = {one.label for _, one in meant}
        # What a process prints that nodes share is told with all of them, or with each: it may be anybody's.
        labels |= {names.label(self._address.robot, one.plan.process) for _, one in meant if one.plan.process}
        labels |= {SUPERVISOR} & {*request.names}
        wanted = LogFilter(since=request.since, least=request.level)
        return self._journal.lines(wanted, labels if request.names else None, request.lines)

    async def sites(self, _: Request) -> list[Site]:
        """The sites that the robot was told to dial."""
        return [*self._sites.all.values()]

    # -- what is done ----------------------------------------------------------------------------

    async def stop(self, request: Request) -> Outcome:
        """Stop processes; done when they have ended."""
        chosen = self._chosen(request)
        await self._tasks.all(one.stop() for one in chosen)
        return self._outcome(chosen, request)

    async def start(self, request: Request) -> Outcome:
        """Start those that do not run; done when they are there, or wait for what they need."""
        chosen = [one for one in self._chosen(request) if not one.running]
        await self._tasks.all(one.start() for one in chosen)
        return self._outcome(chosen, request)

    async def restart(self, request: Request) -> Outcome:
        """Start processes again; done when the new ones are there, or wait for what they need."""
        chosen = self._chosen(request)
        self._renew([one.plan.full_name for one in chosen])
        await self._tasks.all(one.restart(STARTING_AGAIN) for one in chosen)
        return self._outcome(chosen, request)

    async def down(self, request: Request) -> Outcome:
        """End the run; the answer comes before the end."""
        if request.names:
            raise RunError("down ends the whole run and takes no names; stop ends nodes and groups")
        self._journal.say("stopping, as robo down asks")
        asyncio.get_running_loop().call_later(_FAREWELL, self._stopping.finish, 0)
        return Outcome([*self._processes])

    # -- inside ----------------------------------------------------------------------------------

    def _chosen(self, request: Request) -> list[Process]:
        """The processes that names mean, each once; all where none is named."""
        if not request.names:
            return list(self._processes.values())
        found: dict[str, Process] = {}
        for name in request.names:
            means = self._meant(name)
            if not means and not self._address.is_part:  # else another host's supervisor may know it
                raise self._not_found(name)
            found |= {one.plan.full_name: one for one in means}
        return list(found.values())

    def _meant(self, name: str) -> list[Process]:
        return meant(name, self._address.robot, self._processes.values())

    def _not_found(self, name: str) -> NodeNotFound:
        processes = self._processes.values()
        known = [one.label for one in processes] + [one.plan.group for one in processes]
        instead = suggest(name, known, "it has")
        return NodeNotFound(f"robot {self._address.robot} has no node or group {name!r}; {instead}")

    def _outcome(self, done: Sequence[Process], request: Request) -> Outcome:
        return Outcome([one.plan.full_name for one in done], [name for name in request.names if not self._meant(name)])

    def _status(self, one: Process) -> ProcessStatus:
        status = one.status(self._address.robot, self._address.run, self._address.host)
        return msgspec.structs.replace(status, log_problem=self._journal.problem)


def meant(name: str, robot: str, processes: Iterable[P]) -> list[P]:
    """The processes that a name means: a full name, one as the output has it, the name of a group or a part of it."""
    return [one for one in processes if _name(robot, one.plan).is_meant(name)]


def _name(robot: str, plan: ProcessPlan) -> ProcessName:
    return ProcessName(robot, plan.full_name, plan.group, plan.process or "")
