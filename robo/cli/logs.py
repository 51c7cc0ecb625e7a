"""`robo logs`: printing what processes have printed."""

import os
import sys
import time
from collections.abc import Sequence
from typing import NamedTuple

from robo.cli.connection import print_json, print_table
from robo.cli.reach import Reach
from robo.supervisor.console import Console
from robo.supervisor.log_files import Filter, LogRecord, log_base
from robo.supervisor.status import Asked
from robo.tools import logs, runs


def print_runs(*, robot: str | None, json: bool) -> None:
    """Print the runs that are kept."""
    found = logs.list_runs(robot)
    if json:
        for run in found:
            print_json({"run": run.folder.name, "folder": str(run.folder), **_info(run)})
        return
    if not found:
        print(f"no runs are kept in {log_base()}", file=sys.stderr)
        return
    head = ("RUN", "ROBOT", "MANIFEST", "NODES")
    print_table([head, *((r.folder.name, r.info.robot, r.info.manifest, str(len(r.info.nodes))) for r in found)])


class Wanted(NamedTuple):
    """Which lines are printed, and how."""

    nodes: Sequence[str] = ()
    follow: bool = False
    lines: int | None = None
    since: str | None = None
    level: str | None = None
    json: bool = False

    def filter(self) -> Filter:
        """What decides.

        Raises:
            UsageError: a time or a level makes no sense.
        """
        return Filter(since=self.begin(), least=self.level)

    def begin(self) -> int:
        """The earliest time, ns since the epoch."""
        return logs.begin_of(self.since) if self.since is not None else 0


def print_logs(wanted: Wanted, reach: Reach, run: str | None) -> None:
    """Print records of a run: from its files, where it runs or ran on this machine; else from its supervisors.

    Raises:
        RoboError: there is no such run or node, or a word makes no sense.
    """
    kept_here = logs.list_runs(reach.robot)
    if run is None and (reach.connect or os.environ.get("ROBO_CONNECT") or not kept_here):
        _print_from_network(wanted, reach)
    else:
        _print_from_files(wanted, logs.find_run(reach.robot, run))


def _print_from_files(wanted: Wanted, chosen: logs.Run) -> None:
    wants = wanted.filter().wants
    labels = logs.labels_meant(wanted.nodes, chosen.processes)
    console = Console(sorted(labels) or chosen.labels)
    follower = logs.Follower(chosen, labels)  # made first: what comes meanwhile is not lost
    last = 0
    for record in logs.newest(filter(wants, logs.read(chosen, labels)), wanted.lines):
        show(record, console, json=wanted.json)
        last = max(last, record.time)
    if wanted.follow:
        for record in filter(wants, follower.records()):
            if record.time > last:
                show(record, console, json=wanted.json)


def _print_from_network(wanted: Wanted, reach: Reach) -> None:
    from robo.cli.connection import connect_to_robot

    wants = wanted.filter().wants
    with connect_to_robot(reach) as session:
        robot = runs.robot_of(session, reach.robot, wanted.nodes)
        labels = logs.labels_meant(wanted.nodes, [status.name for status in runs.processes(session, robot)])
        stream = runs.OutputStream(session, robot)
        asked = Asked(sorted(labels), wanted.begin(), wanted.level, wanted.lines)
        found = runs.output(session, robot, asked)
        console = Console(sorted(labels) or sorted({record.node for record in found}))
        last = 0
        for record in found:
            show(record, console, json=wanted.json)
            last = max(last, record.time)
        for record in stream.coming() if wanted.follow else ():
            if (not labels or record.node in labels) and wants(record) and record.time > last:
                show(record, console, json=wanted.json)


def show(record: LogRecord, console: Console, *, json: bool) -> None:
    """Print one record."""
    if json:
        print_json(
            {
                "time": record.time,
                "node": record.node,
                "level": record.level,
                "stream": record.stream,
                "message": record.message,
            }
        )
    else:
        text = f"{record.level:5} {record.message}" if record.level is not None else record.message
        console.line(record.node, text, at=record.time / 1e9)


def _info(run: logs.Run) -> dict[str, object]:
    info = run.info
    begin = time.strftime("%Y-%m-%dT%H:%M:%S%z", time.localtime(info.begin / 1e9))
    return {"robot": info.robot, "manifest": info.manifest, "begin": begin, "pid": info.pid, "nodes": info.nodes}
