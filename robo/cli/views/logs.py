"""`robo logs`: printing what processes have printed."""

import os
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import msgspec
import zenoh

from robo.cli.connection import connect_to_supervisors, join_robot
from robo.cli.link import watched
from robo.cli.printing import note, print_json, print_table
from robo.cli.reach import Reach
from robo.environment import CONNECT_VARIABLE
from robo.errors import RoboError, RunError
from robo.machine.log_files import LogFilter
from robo.supervisor.console import Console
from robo.text.folders import log_base
from robo.tools import logs, nodes, runs, unsupervised
from robo.wire.keys import NodeToken
from robo.wire.names import label
from robo.wire.reports import LogRecord, LogsRequest, ProcessName
from robo.wire.run_id import supervisor_lives

_ASK_TIMEOUT = 5.0
"""How long a supervisor of this machine that lives may take to say whether it writes its files, s."""


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

    def filter(self) -> LogFilter:
        """What decides.

        Raises:
            UsageError: a time or a level makes no sense.
        """
        return LogFilter(since=self.begin(), least=self.level)

    def begin(self) -> int:
        """The earliest time, ns since the epoch."""
        return logs.begin_of(self.since) if self.since is not None else 0


def print_logs(wanted: Wanted, reach: Reach, run: str | None) -> None:
    """Print records of a run: from its files, where it runs or ran on this machine; else from its supervisors.

    Raises:
        RoboError: there is no such run or node, or a word makes no sense.
    """
    kept_here = logs.list_runs(reach.robot)
    if run is None and (reach.connect or os.environ.get(CONNECT_VARIABLE) or not kept_here):
        _print_from_network(wanted, reach)
    else:
        chosen = logs.find_run(reach.robot, run)
        _print_from_files(wanted, chosen, reach.namespace if chosen.info.robot != reach.robot else "")


def _print_from_files(wanted: Wanted, chosen: logs.LoggedRun, part: str) -> None:
    wants = wanted.filter().wants
    labels = logs.labels_meant(wanted.nodes, chosen.processes, part)
    printer = _Printer(wanted, sorted(labels) or chosen.labels)
    follower = logs.Follower(chosen, labels)  # made first: what comes meanwhile is not lost
    problem, session = _where_files_lack(chosen)
    if session is None:
        printer.show_past(filter(wants, logs.read(chosen, labels)))
        if wanted.follow:
            printer.show_coming(filter(wants, follower.records()))
        return
    with session:
        note(f"{chosen.info.robot}: {problem}; the newest of them come from its supervisor, which keeps 5,000")
        stream = runs.OutputStream(session, chosen.info.robot)
        asked = LogsRequest(sorted(labels), wanted.begin(), wanted.level)
        printer.show_past(_and_after(filter(wants, logs.read(chosen, labels)), session, chosen.info.robot, asked))
        if wanted.follow:
            printer.show_coming(one for one in stream.coming() if (not labels or one.node in labels) and wants(one))


def _where_files_lack(chosen: logs.LoggedRun) -> tuple[str, zenoh.Session | None]:
    """Why a run that goes on cannot write its files just now, and a session with it; else an empty text and None."""
    if not supervisor_lives(chosen.info.run, unknown=False):
        return "", None
    try:
        session = join_robot(Reach(tuple(chosen.info.endpoints[:1]), chosen.info.robot, _ASK_TIMEOUT))
    except RoboError:
        _tell_of_silence(chosen)
        return "", None
    try:
        found = runs.processes(session, chosen.info.robot, _ASK_TIMEOUT)
    except RoboError:
        _tell_of_silence(chosen)
        found = []
    problem = next((one.log_problem for one in found if one.run == chosen.info.run and one.log_problem), "")
    if problem:
        return problem, session
    session.close()
    return "", None


def _tell_of_silence(chosen: logs.LoggedRun) -> None:
    if supervisor_lives(chosen.info.run, unknown=False):  # it may just have ended
        note(f"{chosen.info.robot}: its supervisor does not answer; this is what its files have")


def _and_after(
    written: Iterable[LogRecord], session: zenoh.Session, robot: str, asked: LogsRequest
) -> Iterator[LogRecord]:
    """The records of files, and those that a supervisor keeps from after them."""
    last = 0
    for record in written:
        last = max(last, record.time)
        yield record
    yield from (record for record in runs.output(session, robot, asked) if record.time > last)


def _print_from_network(wanted: Wanted, reach: Reach) -> None:
    wants = wanted.filter().wants
    with connect_to_supervisors(reach) as session, watched(session, reach):
        try:
            robot, part = runs.target_of(session, reach.robot, wanted.nodes)
        except RunError:
            there = [node for node in nodes.list_nodes(session) if not node.run]
            if not unsupervised.of_robot(there, reach.robot or ""):
                raise
            _print_of_nodes(wanted, session, there, reach.robot or "")
            return
        labels = logs.labels_meant(wanted.nodes, [status.name for status in runs.processes(session, robot)], part)
        stream = runs.OutputStream(session, robot)
        asked = LogsRequest(sorted(labels), wanted.begin(), wanted.level, wanted.lines)
        found = runs.output(session, robot, asked)
        printer = _Printer(wanted, sorted(labels) or sorted({record.node for record in found}))
        printer.show_past(found)
        if wanted.follow:
            printer.show_coming(one for one in stream.coming() if (not labels or one.node in labels) and wants(one))


def _print_of_nodes(wanted: Wanted, session: zenoh.Session, there: Sequence[NodeToken], robot: str) -> None:
    """Print what nodes that no supervisor runs keep themselves."""
    names = [ProcessName(robot, node.full_name, "") for node in unsupervised.of_robot(there, robot)]
    labels = logs.labels_meant(wanted.nodes, names)
    wants = wanted.filter().wants
    lines = unsupervised.Lines(session, robot)

    def wanted_of(found: Iterable[LogRecord]) -> Iterator[LogRecord]:
        for one in found:
            named = msgspec.structs.replace(one, node=label(robot, one.node))
            if (not labels or named.node in labels) and wants(named):
                yield named

    printer = _Printer(wanted, sorted(labels) or [name.label for name in names])
    printer.show_past(wanted_of(lines.new()))
    if wanted.follow:
        printer.show(wanted_of(lines.coming()))


class _Printer:
    def __init__(self, wanted: Wanted, labels: Sequence[str]) -> None:
        self._wanted = wanted
        self._console = Console(labels)
        self._last = 0

    def show_past(self, records: Iterable[LogRecord]) -> None:
        """Print what has been printed so far, or the newest of it."""
        for record in logs.newest(records, self._wanted.lines):
            self._last = max(self._last, record.time)
            show(record, self._console, json=self._wanted.json)

    def show_coming(self, records: Iterable[LogRecord]) -> None:
        """Print what comes, but for what was shown before."""
        self.show(record for record in records if record.time > self._last)

    def show(self, records: Iterable[LogRecord]) -> None:
        """Print records."""
        for record in records:
            show(record, self._console, json=self._wanted.json)


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


def _info(run: logs.LoggedRun) -> dict[str, object]:
    info = run.info
    begin = time.strftime("%Y-%m-%dT%H:%M:%S%z", time.localtime(info.begin / 1e9))
    return {"robot": info.robot, "manifest": info.manifest, "begin": begin, "pid": info.pid, "nodes": info.nodes}
