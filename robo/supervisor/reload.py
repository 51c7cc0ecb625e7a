"""`--watch`: which files a run depends on, which of them have changed, and what follows from that."""

import os
import sys
from collections.abc import Callable, Collection, Coroutine, Iterable, Mapping, Sequence
from functools import lru_cache
from importlib.machinery import PathFinder
from typing import Any, Protocol

import msgspec

from robo.launch.plan import Plan, ProcessPlan
from robo.text.tree import Position


class Process(Protocol):
    """A process whose files are watched."""

    plan: ProcessPlan
    """How it is run; another plan holds from its next start on."""

    @property
    def files(self) -> tuple[str, ...]:
        """The source files of a node, as far as it has told them."""

    @property
    def wanted(self) -> bool:
        """Whether it is to run."""

    async def restart(self, why: str) -> None:
        """Start it again; one that is being started again already is left alone."""


class Journal(Protocol):
    """Where mistakes are told."""

    def warn(self, text: str) -> None:
        """Tell what went wrong."""


class Tasks(Protocol):
    """What does things beside each other."""

    def do(self, work: Coroutine[Any, Any, object]) -> object:
        """Do something beside the rest."""


class Run(Protocol):
    """What processes come into, and leave."""

    async def add(self, plan: ProcessPlan) -> bool:
        """Begin to run a process that the run did not have; False where somebody else has its name."""

    async def remove(self, name: str) -> None:
        """Stop a process, and go on without it."""

    def renew(self, names: Collection[str]) -> None:
        """Those of these full names are about to be started anew: what they share with nobody else is new too."""


class Reload:
    """Goes on with another plan where files have changed: only what is different in it is touched."""

    def __init__(
        self,
        plan: Plan,
        read: Callable[[], Plan | str],
        processes: Mapping[str, Process],
        journal: Journal,
        tasks: Tasks,
        run: Run,
    ) -> None:
        """
        Args:
            plan: the present one.
            read: reads the manifest again, or tells its mistakes.
            processes: of the run, by full name.
            journal: is told of mistakes in a manifest.
            tasks: starts and stops processes beside each other.
            run: adds and removes them.
        """
        self._plan = plan
        self._wanted = {process.full_name: process for process in plan.processes}
        self._underway: set[str] = set()
        """Who is about to come or to go, by full name."""
        self._read = read
        self._processes = processes
        self._journal = journal
        self._tasks = tasks
        self._run = run
        self._watch = FileWatch()

    def look(self) -> None:
        """See which files have changed, and obey; to be called a few times a second."""
        touched = self._watch.changed(
            {"": files_of(self._plan)} | {name: (*p.files, *files_of(p.plan)) for name, p in self._processes.items()}
        )
        if "" in touched:
            plan = self._read()
            if isinstance(plan, str):
                for line in plan.splitlines():
                    self._journal.warn(line)
            else:
                self.take_over(plan)
        self._start_again({name: files for name, files in touched.items() if name in self._processes})

    def _start_again(self, touched: Mapping[str, set[str]]) -> None:
        """Start processes again whose files have changed, by full name, and with code all that share a process."""
        files = dict(touched)
        for name, process in self._processes.items():
            for other, changed in touched.items():
                shared = process.plan.process
                code = {file for file in changed if file.endswith(".py")}
                if code and shared is not None and shared == self._processes[other].plan.process:
                    files[name] = files.get(name, set()) | code
        again = {name: self._processes[name] for name in files if self._processes[name].wanted}
        if again:
            self._run.renew(again.keys())
        for name, process in again.items():
            self._tasks.do(process.restart(f"changed: {', '.join(sorted(files[name]))}"))

    def take_over(self, plan: Plan) -> None:
        """Go on with another plan: only what is different in it is started, stopped, or started again."""
        self._plan = plan
        self._wanted = {process.full_name: process for process in plan.processes}
        for name in self._wanted.keys() & self._processes.keys():
            self._update(name)
        for name in self._wanted.keys() ^ self._processes.keys():
            if name not in self._underway:
                self._tasks.do(self._come_or_go(name))

    def _update(self, name: str) -> None:
        """Go on with a process by its new plan; it is started again where that makes a difference."""
        process, new = self._processes[name], self._wanted[name]
        is_same = same(process.plan, new)
        process.plan = new
        if not is_same:
            self._tasks.do(process.restart("changed: its part of the manifest or of its parameter files"))

    async def _come_or_go(self, name: str) -> None:
        """Add or remove a process, until it is as the newest plan wants it: that may change meanwhile."""
        self._underway.add(name)
        try:
            while (name in self._wanted) != (name in self._processes):
                if name not in self._wanted:
                    await self._run.remove(name)
                elif not await self._run.add(self._wanted[name]):
                    return
            if name in self._wanted:
                self._update(name)
        finally:
            self._underway.discard(name)


class FileWatch:
    """Notices changed files by the time of their last change."""

    def __init__(self) -> None:
        self._times: dict[str, int | None] = {}

    def changed(self, files: Mapping[str, Iterable[str]]) -> dict[str, set[str]]:
        """Whose files have changed since the last call, and which; a file that is new here has not."""
        found: dict[str, set[str]] = {}
        seen: dict[str, int | None] = {}
        for owner, paths in files.items():
            for path in paths:
                if path not in seen:
                    seen[path] = _time_of(path)
                if path in self._times and seen[path] is not None and self._times[path] != seen[path]:
                    found.setdefault(owner, set()).add(path)
        # A file that is gone for a moment, while an editor replaces it, is not forgotten.
        self._times = {path: at if at is not None else self._times.get(path) for path, at in seen.items()}
        return found


def files_of(plan: Plan | ProcessPlan) -> list[str]:
    """The files that a plan was made of; for a process, its module, and what it is given in parameters or as words."""
    if isinstance(plan, Plan):
        return sorted(plan.files)
    given = [*plan.parameters.values(), *(plan.command() if plan.service is None else ())]
    folder = plan.cwd or os.getcwd()
    paths = {os.path.join(folder, text) for text in given if isinstance(text, str) and text}
    if plan.service is not None:
        paths |= {_module_file(plan.service.partition(":")[0]) or ""}
    return sorted(path for path in paths if os.path.isfile(path) and os.access(path, os.R_OK))


@lru_cache
def _module_file(name: str) -> str | None:
    """Where a module is, found without importing anything: one that cannot be imported is watched too."""
    places: Sequence[str] | None = [os.getcwd(), *sys.path]
    spec = None
    parts = name.split(".")
    for end in range(1, len(parts) + 1):
        spec = PathFinder.find_spec(".".join(parts[:end]), places) if places else None
        places = spec.submodule_search_locations if spec is not None else None
    return spec.origin if spec is not None and not str(spec.origin).startswith((sys.prefix, sys.base_prefix)) else None


def same(one: ProcessPlan, other: ProcessPlan) -> bool:
    """Whether two plans of a process do the same, wherever it is written."""
    return _essence(one) == _essence(other)


def _essence(plan: ProcessPlan) -> object:
    return msgspec.structs.replace(plan, source=Position("", 0, 0), sources={}, settings={}), plan.parameters


def _time_of(path: str) -> int | None:
    try:
        return os.stat(path).st_mtime_ns
    except OSError:
        return None
