"""`robo logs`: printing what processes have printed."""

import sys
import time
from collections.abc import Sequence

from robo.cli.connection import print_json, print_table
from robo.supervisor.console import Console
from robo.supervisor.log_files import LogRecord, log_base
from robo.tools import logs


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


def print_logs(
    nodes: Sequence[str],
    *,
    robot: str | None,
    run: str | None,
    follow: bool,
    lines: int | None,
    since: str | None,
    level: str | None,
    json: bool,
) -> None:
    """Print records of a run.

    Raises:
        RoboError: there is no such run or node, or a word makes no sense.
    """
    wanted = logs.Filter(since=logs.begin_of(since) if since is not None else 0, least=level)
    chosen = logs.find_run(robot, run)
    labels = logs.check_nodes(chosen, nodes)
    console = Console(sorted(labels) or chosen.labels)
    follower = logs.Follower(chosen, labels)  # made first: what comes meanwhile is not lost
    last = 0
    for record in logs.newest(filter(wanted.wants, logs.read(chosen, labels)), lines):
        show(record, console, json=json)
        last = max(last, record.time)
    if follow:
        for record in filter(wanted.wants, follower.records()):
            if record.time > last:
                show(record, console, json=json)


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
