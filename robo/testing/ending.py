"""The end of a robot of a test: what has died meanwhile, whether it ends as it should, what its nodes have left."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import zenoh

from robo.errors import RunError
from robo.machine import orphans
from robo.testing.leaks import Leak
from robo.testing.parents import end_parents
from robo.testing.run import LaunchFailed, Run
from robo.tools import runs
from robo.wire.reports import Exit, ProcessStatus


class NodeDied(AssertionError):
    """A process of a robot ended, or hung, and the test has not brought that about."""


def died(run: Run, session: zenoh.Session, is_expected: Callable[[ProcessStatus], bool]) -> Iterator[AssertionError]:
    """What has died by itself, with its last words."""
    if run.was_awaited:
        return
    if run.is_over():
        yield NodeDied(f"{run.manifest}: the run has ended by itself\n{run.printed()}")
        return
    found = []
    for one in runs.explain(session, runs.Target(run.robot), []):
        bad = [end for end in one.exits if end.exit_code]
        if bad and not is_expected(one.process):
            found.append(_death(one.process, bad[-1]))
    if found:
        yield NodeDied("\n".join([*found, "if that is meant: launch(…, may_die=[NODE])"]))


def ended(
    run: Run, session: zenoh.Session, run_id: str, is_expected: Callable[[ProcessStatus], bool]
) -> Iterator[AssertionError]:
    """End a run, and tell what was wrong with that.

    Args:
        run: which one.
        session: on its network.
        run_id: its id; empty where it never was ready.
        is_expected: whether it is no fault of a process if it dies: then it could not end what it had started.
    """
    try:
        there = runs.processes(session, run.robot)
    except RunError:  # it has ended
        there = []
    end_parents(session, run.robot, there)
    late = run.end()
    if late:
        yield LaunchFailed(f"{run.manifest}: {late}\n{run.printed()}")
    excused = {one.name.label for one in there if is_expected(one)}
    left = [one for one in run.left_behind() if one.node not in excused]
    left += orphans.sweep(run_id) if run_id else []
    if left:
        told = (f"  {one.node or 'a node'}: the process {one.pid}: {one.command}" for one in left)
        yield Leak("\n".join([f"{run.manifest}: nodes have left behind", *told]))


def state_of(one: ProcessStatus) -> str:
    """How a process is, in words."""
    hangs = f", {one.running} has been running for {one.running_for:.1f} s" if one.running else ""
    return f"{one.name.label} is {one.state}{f', {one.reason}' if one.reason else ''}{hangs}"


def _death(process: ProcessStatus, end: Exit) -> str:
    return "\n".join([f"{process.name.label} has died: {end.reason}", *(f"  {line}" for line in end.last_lines)])
