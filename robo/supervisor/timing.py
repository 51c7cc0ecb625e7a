"""Where the time of a start goes: the chain of events that the last process to become ready waited for."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple


class Started(NamedTuple):
    """How one process came up; times in s from the command on."""

    name: str
    needs: Sequence[str]
    """What had to come before it."""
    started: float
    ready: float


def critical_path(processes: Mapping[str, Started]) -> list[Started]:
    """The processes that had to be ready one after the other before the last one was, in order."""
    path: list[Started] = []
    last = max(processes.values(), key=lambda p: p.ready, default=None)
    while last is not None and last not in path:
        path.insert(0, last)
        before = [processes[need] for need in last.needs if need in processes]
        last = max(before, key=lambda p: p.ready, default=None)
    return path


def timing_text(phases: Sequence[tuple[str, float]], processes: Mapping[str, Started]) -> list[str]:
    """The phases, each with the time at its end, then the critical path."""
    lines: list[str] = []
    before = 0.0
    for what, at in phases:
        lines.append(f"{at:7.3f} s  +{at - before:.3f}  {what}")
        before = at
    for process in critical_path(processes):
        lines.append(f"{process.started:7.3f} s  +{max(0.0, process.started - before):.3f}  {process.name} started")
        lines.append(f"{process.ready:7.3f} s  +{process.ready - process.started:.3f}  {process.name} ready")
        before = process.ready
    return lines
