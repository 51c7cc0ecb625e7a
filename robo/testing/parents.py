"""Nodes of a robot that have processes of their own, at the end of a test: whether they end them."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Sequence
from contextlib import suppress

import psutil
import zenoh

from robo.errors import RunError
from robo.tools import nodes, runs
from robo.wire.reports import Exit, ProcessStatus

PATIENCE = 5.0
"""How long such nodes may take to end, s: of one that takes longer nothing is known."""

_LOOK = 0.05
"""How often it is looked whether they have, s."""


def end_parents(session: zenoh.Session, robot: str, processes: Sequence[ProcessStatus]) -> None:
    """Tell each node that has processes of its own to end, and only the node.

    What ends a robot tells the whole process group of each node to end, and so what the node has started ends as well,
    whether the node cares for it or not. Told alone, the node ends it, or its supervisor tells what it had to end.

    Args:
        session: on the robot's network.
        robot: what it is called.
        processes: those of the robot.
    """
    parents = [one for one in processes if one.pid is not None and _has_children(one.pid)]
    if not parents:
        return
    alone = {token.pid for token in nodes.list_nodes(session)}  # a shell or a debugger stands before its node
    told = {one.node for one in parents if one.pid in alone}
    before = _exits(session, robot)
    for one in parents:
        if one.node in told and one.pid is not None:
            with suppress(ProcessLookupError):
                os.kill(one.pid, signal.SIGINT)
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        now = _exits(session, robot)
        if all(now.get(node) != before.get(node) for node in told):
            return
        time.sleep(_LOOK)


def _has_children(pid: int) -> bool:
    with suppress(psutil.Error):
        return any(child.status() != psutil.STATUS_ZOMBIE for child in psutil.Process(pid).children())
    return False


def _exits(session: zenoh.Session, robot: str) -> dict[str, Sequence[Exit]]:
    """How processes have ended so far, by full name; nothing where the run has."""
    with suppress(RunError):
        return {one.process.node: one.exits for one in runs.explain(session, runs.Target(robot), [])}
    return {}
