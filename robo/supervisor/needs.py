"""Who needs whom: what a process waits for, whom its end concerns, and whether anything can still happen."""

import graphlib
from collections.abc import Collection, Mapping, Sequence
from typing import Protocol, TypeVar

from robo.launch.plan import ProcessPlan, StopPlan, Until
from robo.wire import names
from robo.wire.reports import Exit, State

STOP_LIMIT = 2.0
"""How long the stop of a run may take, s, before all that still run are killed, unless the manifest gives single
processes more."""


class Process(Protocol):
    """What of a process matters to others."""

    label: str

    @property
    def plan(self) -> ProcessPlan:
        """How it is run, and what it needs."""

    @property
    def state(self) -> State:
        """How it is shown."""

    @property
    def running(self) -> bool:
        """Whether a child of it runs."""

    @property
    def wanted(self) -> bool:
        """Whether it is to run; false once somebody has asked it to stop."""

    @property
    def finished(self) -> bool:
        """Whether it has ended and nothing starts it again but a command."""

    @property
    def exits(self) -> Sequence[Exit]:
        """How it has ended, oldest first."""

    @property
    def next_start(self) -> float | None:
        """When it is started again."""

    def reached(self, until: Until) -> bool:
        """Whether it has come as far as another process needs it."""

    def may_reach(self, until: Until) -> bool:
        """Whether it can still come so far without a command."""


P = TypeVar("P", bound=Process)


def unmet(plan: ProcessPlan, processes: Mapping[str, Process], elsewhere: Collection[str], robot: str) -> list[str]:
    """What a process still waits for, in words.

    Args:
        plan: of the process.
        processes: of this run, by full name.
        elsewhere: the full names of the nodes that others run and that are ready.
        robot: what the run is called.
    """
    found = []
    for name, until in plan.needs.items():
        need = processes.get(name)
        if need is None and name not in elsewhere:
            found.append(f"{names.label(robot, name)} {until}, on another host")
        if need is not None and not need.reached(until):
            hopeless = "" if need.may_reach(until) else f", which is {need.state}"
            found.append(f"{need.label} {until}{hopeless}")
    return found


def can_go_on(processes: Mapping[str, Process]) -> bool:
    """Whether anything runs, will run, or has been stopped by a command that another may undo."""
    waiting: set[str] = set()
    for name, process in processes.items():
        if process.running or process.next_start is not None or not process.wanted:
            return True
        if not process.finished:
            waiting.add(name)
    # What waits can go on if what it waits for can, and what that waits for.
    in_vain: set[str] = set()
    while True:
        more = {
            name
            for name in waiting
            for need, until in processes[name].plan.needs.items()
            if need in processes and not _will_reach(processes[need], until, in_vain)
        }
        if not more:
            return bool(waiting)
        in_vain |= more
        waiting -= more


def _will_reach(process: Process, until: Until, in_vain: Collection[str]) -> bool:
    """Whether a process has come so far or still may, where those `in_vain` never start."""
    return process.reached(until) or (process.may_reach(until) and process.plan.full_name not in in_vain)


def dependents(processes: Mapping[str, Process], name: str) -> set[str]:
    """The full names of those that need a process, and of those that need these."""
    found = {name}
    while more := {n for n, p in processes.items() if n not in found and p.plan.needs.keys() & found}:
        found |= more
    return found - {name}


def in_vain(processes: Mapping[str, P], ended: Process) -> list[tuple[P, Until]]:
    """Who has never run and waits for a process that has ended, and how far that ought to have come: it will not."""
    found = []
    for other in processes.values():
        until = other.plan.needs.get(ended.plan.full_name)
        if until is not None and not other.exits and not other.running and not ended.may_reach(until):
            found.append((other, until))
    return found


def stop_limit(plans: Mapping[str, ProcessPlan]) -> float:
    """How long the ordered stop may take, s: all that the manifest grants to those that stop one after the other."""
    if all(plan.stop.timeout <= StopPlan().timeout for plan in plans.values()):
        return STOP_LIMIT
    spans: dict[str, float] = {}
    for name in graphlib.TopologicalSorter({n: p.needs for n, p in plans.items()}).static_order():
        if name in plans:
            longest = max((spans.get(need, 0.0) for need in plans[name].needs), default=0.0)
            spans[name] = 1.5 * plans[name].stop.timeout + longest
    return max(STOP_LIMIT, *spans.values())
