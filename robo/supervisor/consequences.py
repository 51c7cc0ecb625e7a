"""What follows for a run from the state that one of its processes has come to."""

from collections.abc import Coroutine, Mapping
from typing import Any, Protocol

from robo.supervisor import needs


class Process(needs.Process, Protocol):
    """What of a process has consequences."""

    @property
    def down(self) -> bool:
        """Whether it has failed for good, or is in a storm and tried slowly."""

    async def restart(self, why: str) -> None:
        """End it, if it runs, and start it again at once."""


class Tasks(Protocol):
    """What does things beside each other."""

    def do(self, work: Coroutine[Any, Any, object]) -> object:
        """Do something beside the rest."""


class Stopping(Protocol):
    """What ends the run."""

    def finish(self, exit_code: int | None) -> None:
        """End the run."""


def draw(changed: Process, processes: Mapping[str, Process], tasks: Tasks, stopping: Stopping) -> None:
    """Those that need it start again with it, where it says so; and the run ends with what it cannot do without.

    Args:
        changed: the process that has come to another state.
        processes: of the run, by full name.
        tasks: starts others again.
        stopping: ends the run.
    """
    plan, state = changed.plan, changed.state
    if state == "restarting" and plan.restart.propagate:
        for name in needs.dependents(processes, plan.full_name):
            other = processes[name]
            if other.running and other.wanted:
                tasks.do(other.restart(f"starting again with {changed.label}, which it needs"))
    if plan.required and (changed.down or state == "completed"):
        stopping.finish(0 if state == "completed" else 1)
