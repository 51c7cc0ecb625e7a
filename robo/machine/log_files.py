"""Output of processes in files: a folder for each run, JSON Lines for each process, rotated and pruned.

<base>/<robot>/<begin>_<pid>/run.json            what run it is
<base>/<robot>/<begin>_<pid>/<node>.jsonl        one record a line; `.1` is the file before it
"""

import os
import time
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

import msgspec

from robo.text.folders import append_private, log_base, make_private
from robo.text.levels import LEVEL_NAMES, LEVELS, level_of
from robo.text.terminal import escaped_json
from robo.wire.reports import LogRecord

LARGEST = 10_000_000
"""A file that has grown beyond this is set aside, bytes; where a run has many, they are smaller."""
LEAST = 50_000
"""But no smaller than this."""

KEPT_FILES = 3
"""How many files of a process are kept, the present one included."""

SUPERVISOR = "robo"
"""The name under which the supervisor's own lines are kept."""


class RunInfo(msgspec.Struct, frozen=True, kw_only=True):
    """What `run.json` says."""

    run: str
    """The run's id."""
    robot: str
    manifest: str
    begin: int
    """ns since the epoch."""
    pid: int
    """Of the supervisor."""
    nodes: list[str]
    groups: list[str] = []
    """Of each node."""
    processes: list[str] = []
    """Of each node the one that it shares with others, by its full name; empty where it has its own."""
    endpoints: list[str] = []
    """Where its router listens for tools and other robots."""


def record(node: str, stream: str, text: str) -> LogRecord:
    """A line with its level taken off and the time of now."""
    level = text[:5].rstrip()
    if level not in LEVEL_NAMES or not (len(text) == len(level) or text[len(level)] == " "):
        return LogRecord(time=time.time_ns(), node=node, message=text, stream=stream)
    return LogRecord(time=time.time_ns(), node=node, message=text[6:], level=level, stream=stream)


class LogFilter:
    """Which records are wanted. A line of stderr without a level belongs to the record before it: a traceback."""

    def __init__(self, *, since: int = 0, least: str | None = None) -> None:
        """
        Raises:
            UsageError: there is no such level.
        """
        self._since = since
        self._least = level_of(least or "debug")
        self._last: dict[str, int] = {}

    def wants(self, record: LogRecord) -> bool:
        """Whether a record is wanted."""
        rank = LEVELS.get((record.level or "").lower())
        if rank is None:
            rank = self._last.get(record.node, LEVELS["info"]) if record.stream == "stderr" else LEVELS["info"]
        else:
            self._last[record.node] = rank
        return rank >= self._least and record.time >= self._since


class LogFiles:
    """The log files of one run, each made with its first line."""

    def __init__(self, info: RunInfo, base: Path | None = None, largest: int | None = None) -> None:
        """Nothing is written before the first line, or `begin`.

        Args:
            info: what run it is.
            base: where all runs are kept; by default where the user's are.
            largest: how large a file may grow, bytes; by default `LARGEST`.
        """
        self.largest = LARGEST if largest is None else largest
        stamp = time.strftime("%Y-%m-%d_%H-%M-%S", time.localtime(info.begin / 1e9))
        self._base = base or log_base()
        self.folder = self._base / info.robot.replace("/", ".") / f"{stamp}_{info.pid}"
        self._info = info
        self._files: dict[str, _Rotating] = {}
        self._set_aside = 0
        self._told: set[str] = set()

    def begin(self) -> None:
        """Make the folder, and what tells of the run.

        Raises:
            OSError: they cannot be made.
        """
        make_private(self.folder, self._base)
        info = self.folder / "run.json"
        if not info.exists() or info.stat().st_size == 0:  # a full disk may have cut it short
            with append_private(info) as file:
                file.truncate(0)
                file.write(msgspec.json.encode(self._info) + b"\n")

    def write(self, line: LogRecord) -> None:
        """Add a line to its process's file.

        Raises:
            OSError: it cannot be written; nothing of it is.
        """
        self.open(line.node)
        self._files[line.node].write(escaped_json(msgspec.json.encode(line).decode()).encode() + b"\n")

    def open(self, node: str) -> None:
        """Open a process's file, if it is not open.

        Raises:
            OSError: it cannot be opened.
        """
        if node not in self._files:
            self._files[node] = _Rotating(self.folder / f"{node.replace('/', '.')}.jsonl", self.largest)

    def room(self) -> int:
        """How much the disk takes, bytes.

        Raises:
            OSError: the folder is not there.
        """
        disk = os.statvfs(self._base)
        return disk.f_bavail * disk.f_frsize

    def lost(self) -> int | None:
        """How many lines went, since this was last asked, to files that somebody has removed; None where none was."""
        lost = [file.lost() for file in self._files.values()]
        return sum(filter(None, lost)) if any(count is not None for count in lost) else None

    def dropped(self) -> list[str]:
        """Whose oldest lines are gone, to make room for newer ones; empty for a process that was told of before."""
        new = [node for node, file in self._files.items() if file.drops and node not in self._told]
        self._told |= {*new}
        return new

    @property
    def set_aside(self) -> int:
        """How many files have been set aside so far."""
        return self._set_aside + sum(file.set_aside for file in self._files.values())

    def close(self) -> None:
        """Close all files; what is written after that opens them again."""
        self._set_aside = self.set_aside
        files, self._files = self._files, {}
        for file in files.values():
            file.close()


class _Rotating:
    def __init__(self, path: Path, largest: int) -> None:
        self._path = path
        self._largest = largest
        self.drops = False
        """Whether a file of its own had to go for newer ones."""
        self._file: BinaryIO = append_private(path)
        self._size = self._file.tell()
        self._unseen = 0
        """Lines since the file was last seen where it should be."""
        self.set_aside = 0

    def write(self, line: bytes) -> None:
        if self._size + len(line) > self._largest:
            self._rotate()
        rest = memoryview(line)
        try:
            while rest:
                rest = rest[self._file.write(rest) :]
        except OSError:  # a disk that is full takes a part of it
            with suppress(OSError):
                os.ftruncate(self._file.fileno(), self._size)
            raise
        self._size += len(line)
        self._unseen += 1

    def lost(self) -> int | None:
        """How many lines are lost, where the file is not there any more."""
        count, self._unseen = self._unseen, 0
        try:
            there = os.path.samestat(os.stat(self._path), os.fstat(self._file.fileno()))
        except OSError:
            there = False
        return None if there else count

    def _rotate(self) -> None:
        self._file.close()
        for number in range(KEPT_FILES - 1, 0, -1):
            older = self._path.with_name(f"{self._path.name}.{number}")
            newer = self._path.with_name(f"{self._path.name}.{number - 1}") if number > 1 else self._path
            if newer.exists():
                self.drops |= older.exists()
                newer.replace(older)
        self._file = append_private(self._path)
        self._size = self._unseen = 0
        self.set_aside += 1

    def close(self) -> None:
        self._file.close()
