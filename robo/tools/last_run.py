"""What this machine has of a robot's last run when nobody can be asked any more: logs, and flight recorders' files."""

from collections.abc import Sequence
from pathlib import Path

import msgspec

from robo.errors import RunError
from robo.machine.log_files import SUPERVISOR
from robo.recording.flight.shelf import reasons_of, words_of
from robo.tools import logs
from robo.wire.reports import LogRecord
from robo.wire.run_id import supervisor_lives

_LINES = 8
"""Of the supervisor, and of each node that is asked for: the last ones."""


class FlightFile(msgspec.Struct, frozen=True):
    """A file that a flight recorder has written."""

    path: Path
    time: int
    """Of what came first, ns since the epoch."""
    reasons: list[str]
    """As it says them: `died: /r1/base was killed by SIGKILL`."""
    nodes: list[str]
    """That it concerns, by full name."""


class LastRun(msgspec.Struct, frozen=True):
    """A run that is over."""

    run: logs.LoggedRun
    end: list[LogRecord]
    """What its supervisor said last."""
    files: list[FlightFile]
    """The oldest first."""
    words: dict[str, list[LogRecord]]
    """What nodes that are asked for have printed last, by label."""


def last_run(
    robot: str | None, endpoints: Sequence[str], words: Sequence[str], base: Path | None = None
) -> LastRun | None:
    """The last run of a robot, or of any, on this machine; None where there was none, or it is not over.

    Args:
        robot: the name of the robot; None for any.
        endpoints: where it was looked for; a run that was elsewhere is not meant. Empty for anywhere.
        words: nodes or groups that are asked for; their files alone are told, and what they printed last.
        base: of all logs.

    Raises:
        NodeNotFound: the run had no such node.
    """
    try:
        run = logs.find_run(robot, None, base)
    except RunError:
        return None
    meant = not endpoints or any(one in run.info.endpoints for one in endpoints)
    if not meant or supervisor_lives(run.info.run, unknown=False):  # of another container: it does not answer
        return None
    part = (robot or "") if run.info.robot != robot else ""
    labels = logs.labels_meant(words, run.processes, part) if words or part else set()
    nodes = {one.node for one in run.processes if one.label in labels}
    files = [one for one in _files(run) if not labels or nodes & set(one.nodes)]
    said = {label: list(logs.newest(logs.read(run, {label}), _LINES)) for label in sorted(labels)}
    return LastRun(run, list(logs.newest(logs.read(run, {SUPERVISOR}), _LINES)), files, said if words else {})


def _files(run: logs.LoggedRun) -> list[FlightFile]:
    """Those of a run, where flight recorders put them unless they are told another folder."""
    found = []
    robots = {one.node.rpartition("/")[0].strip("/") for one in run.processes} | {run.info.robot}
    for robot in robots:
        for path in run.folder.parent.with_name(robot.replace("/", ".") or "robot").glob("flight/*.mcap"):
            words = words_of(path)
            reasons = reasons_of(words)
            if words.get("run") == run.info.run and reasons:
                texts = [text for _, text in reasons]
                found.append(FlightFile(path, reasons[0][0], texts, words.get("nodes", "").split()))
    return sorted(found, key=lambda one: one.time)
