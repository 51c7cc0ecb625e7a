"""Reading the log files of runs on this machine, those that are over included."""

import heapq
import os
import re
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from datetime import datetime
from itertools import chain, repeat
from pathlib import Path
from typing import BinaryIO

import msgspec

from robo.errors import NodeNotFound, RunError, UsageError
from robo.machine.log_files import SUPERVISOR, RunInfo
from robo.text.folders import log_base
from robo.text.readable import readable
from robo.text.suggestions import suggest
from robo.text.unreadable import UNREADABLE
from robo.wire import names
from robo.wire.reports import LogRecord, ProcessName
from robo.wire.run_id import supervisor_lives

_SPAN = re.compile(r"(\d+(?:\.\d+)?)\s*(s|m|h|d)")
_UNITS = {"s": 1.0, "m": 60.0, "h": 3600.0, "d": 86400.0}
_PERIOD = 0.1
"""How often files are looked at for more, s."""


class LoggedRun(msgspec.Struct, frozen=True):
    """A run whose logs are kept."""

    folder: Path
    info: RunInfo

    @property
    def processes(self) -> list[ProcessName]:
        """What its processes are called."""
        groups, shared = (chain(found, repeat("")) for found in (self.info.groups, self.info.processes))
        return [ProcessName(self.info.robot, *one) for one in zip(self.info.nodes, groups, shared, strict=False)]

    @property
    def labels(self) -> list[str]:
        """What its nodes are called in the output."""
        return [process.label for process in self.processes]


def list_runs(robot: str | None = None, base: Path | None = None) -> list[LoggedRun]:
    """The runs that are kept, oldest first: all, or those of a robot and those that have it as a part."""
    found = []
    for file in (base or log_base()).glob("*/*/run.json"):
        try:
            info = msgspec.json.decode(file.read_bytes(), type=readable(RunInfo))
        except (OSError, *UNREADABLE):
            continue  # cut short, or being removed
        run = LoggedRun(file.parent, info)
        if robot is None or info.robot == robot or any(one.is_within(robot) for one in run.processes):
            found.append(run)
    return sorted(found, key=lambda run: run.info.begin)


def live_runs(base: Path | None = None) -> list[LoggedRun]:
    """The runs of this user on this machine that are not over."""
    return [run for run in list_runs(base=base) if supervisor_lives(run.info.run)]


def find_run(robot: str | None, name: str | None, base: Path | None = None) -> LoggedRun:
    """The run that somebody means: by the name of its folder or its id, else the latest of those that go on, or of all.

    Raises:
        RunError: there is none.
    """
    runs = list_runs(robot, base)
    chosen = [run for run in runs if name is None or name in (run.folder.name, run.info.run)]
    if chosen:
        # What has failed at once, beside a robot that runs, is not what anybody looks for.
        alive = [run for run in chosen if supervisor_lives(run.info.run, unknown=False)]
        return (alive or chosen)[-1]
    whose = f" of robot {robot}" if robot is not None else ""
    if name is not None and runs:
        raise RunError(f"there is no run {name}{whose}; `robo logs --list` shows those that are kept")
    raise RunError(f"no logs{whose} are kept in {base or log_base()}; `robo up` writes them")


def labels_meant(words: Sequence[str], processes: Sequence[ProcessName], part: str = "") -> set[str]:
    """The labels of the output that words mean: those of nodes, of groups, or the supervisor's own; none mean all.

    Args:
        words: what somebody has typed.
        processes: those of the run.
        part: the namespace of the robot that is meant, where it is only a part of the run.

    Raises:
        NodeNotFound: one of them means nothing.
    """
    if part:
        processes = [process for process in processes if process.is_within(part)]
        words = words or [part]
    found: set[str] = set()
    for word in words:
        named = [process for process in processes if process.is_meant(word)]
        # What a process prints that nodes share is told with each of them: it may be anybody's.
        shared = {names.label(process.robot, process.process) for process in named if process.process}
        meant = {process.label for process in named} | shared
        if word == SUPERVISOR:
            meant.add(SUPERVISOR)
        if not meant:
            there = [*(process.label for process in processes), SUPERVISOR]
            raise NodeNotFound(f"there is no node or group {word}; {suggest(word.strip('/'), there)}")
        found |= meant
    return found


def begin_of(text: str, now: Callable[[], float] = time.time) -> int:
    """When `--since` begins, ns since the epoch: a time span ago (`10m`) or a local time (`2026-11-21T18:30`).

    Raises:
        UsageError: it is neither.
    """
    match = _SPAN.fullmatch(text.strip())
    if match is not None:
        return int((now() - float(match[1]) * _UNITS[match[2]]) * 1e9)
    try:
        return int(datetime.fromisoformat(text).timestamp() * 1e9)
    except (ValueError, OverflowError):
        raise UsageError(f"--since {text}: write 30s, 10m, 2h, 1d or a time such as 2026-11-21T18:30") from None


def read(run: LoggedRun, labels: set[str]) -> Iterator[LogRecord]:
    """All records of a run, in order of time; of all processes where no labels are given."""
    files: dict[str, list[Path]] = {}
    for path in run.folder.glob("*.jsonl*"):
        label = path.name.partition(".jsonl")[0]
        if not labels or label in {name.replace("/", ".") for name in labels}:
            files.setdefault(label, []).append(path)
    oldest_first = [sorted(paths, key=lambda p: (len(p.name), p.name), reverse=True) for paths in files.values()]
    return heapq.merge(*(_records(paths) for paths in oldest_first), key=lambda record: record.time)


class Follower:
    """The records that come after the moment in which it was made."""

    def __init__(self, run: LoggedRun, labels: set[str]) -> None:
        self._folder = run.folder
        self._wanted = {f"{name.replace('/', '.')}.jsonl" for name in labels}
        self._places: dict[Path, tuple[int, int]] = {}
        """By file, which one it is (its inode) and how far it has been read."""
        for path in self._paths():
            stat = path.stat()
            self._places[path] = stat.st_ino, stat.st_size

    def records(self) -> Iterator[LogRecord]:
        """Records as they come, without end."""
        while True:
            fresh: list[LogRecord] = []
            for path in self._paths():
                fresh += self._more(path)
            yield from sorted(fresh, key=lambda record: record.time)
            time.sleep(_PERIOD)

    def _paths(self) -> list[Path]:
        return [path for path in self._folder.glob("*.jsonl") if not self._wanted or path.name in self._wanted]

    def _more(self, path: Path) -> list[LogRecord]:
        found: list[LogRecord] = []
        try:
            with path.open("rb") as file:
                inode = os.fstat(file.fileno()).st_ino
                before, place = self._places.get(path, (0, 0))
                if before != inode and path.with_name(f"{path.name}.1").exists():  # set aside, and begun anew
                    with path.with_name(f"{path.name}.1").open("rb") as older:
                        found += _whole_lines(older, place)[0]
                    place = 0
                records, place = _whole_lines(file, place)
        except OSError:
            return found  # it is just being set aside
        self._places[path] = inode, place
        return found + records


def newest(records: Iterable[LogRecord], count: int | None) -> Iterable[LogRecord]:
    """The last so many; all where no number is given."""
    if count is None:
        return records
    return list(records)[-count:] if count else []


def _records(paths: Sequence[Path]) -> Iterator[LogRecord]:
    for path in paths:
        try:
            with path.open("rb") as file:
                for line in file:
                    record = _parsed(line)
                    if record is not None:
                        yield record
        except OSError:
            continue  # the oldest went while we read


def _whole_lines(file: BinaryIO, place: int) -> tuple[list[LogRecord], int]:
    """The records after a place, and the place after them."""
    file.seek(place)
    whole, newline, _ = file.read().rpartition(b"\n")
    records = [record for line in whole.split(b"\n") if (record := _parsed(line)) is not None]
    return records, place + len(whole) + len(newline)


def _parsed(line: bytes) -> LogRecord | None:
    try:
        return msgspec.json.decode(line, type=readable(LogRecord))
    except UNREADABLE:
        return None  # cut short when its writer was killed
