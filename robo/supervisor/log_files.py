"""Output of processes in files: a folder for each run, JSON Lines for each process, rotated and pruned.

<base>/<robot>/<begin>_<pid>/run.json            what run it is
<base>/<robot>/<begin>_<pid>/<node>.jsonl        one record a line; `.1` is the file before it
"""

import os
import shutil
import time
from pathlib import Path
from typing import BinaryIO

import msgspec

from robo.log import LEVEL_NAMES, LEVELS, level_of
from robo.terminal import escaped_json

LARGEST = 10_000_000
"""A file that has grown beyond this is set aside, bytes."""

KEPT_FILES = 3
"""How many files of a process are kept, the present one included."""

KEPT_RUNS = 10
"""How many runs of a robot are kept."""

SUPERVISOR = "robo"
"""The name under which the supervisor's own lines are kept."""


class LogRecord(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One line of output."""

    time: int
    """ns since the epoch."""
    node: str
    """As it is called on the console."""
    message: str
    level: str | None = None
    """DEBUG to FATAL where the line begins with it, as robo's nodes write it."""
    stream: str = "stderr"


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
    endpoints: list[str] = []
    """Where its router listens for tools and other robots."""


def record(node: str, stream: str, text: str) -> LogRecord:
    """A line with its level taken off and the time of now."""
    level = text[:5].rstrip()
    if level not in LEVEL_NAMES or not (len(text) == len(level) or text[len(level)] == " "):
        return LogRecord(time=time.time_ns(), node=node, message=text, stream=stream)
    return LogRecord(time=time.time_ns(), node=node, message=text[6:], level=level, stream=stream)


class Filter:
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


def log_base() -> Path:
    """Where all runs are kept: ROBO_LOG_DIR, or where the desktop standard keeps state."""
    state = os.environ.get("XDG_STATE_HOME") or os.path.expanduser("~/.local/state")
    return Path(os.environ.get("ROBO_LOG_DIR") or Path(state) / "robo" / "log")


class LogFiles:
    """The log files of one run, each made with its first line."""

    def __init__(self, info: RunInfo, base: Path | None = None) -> None:
        """Nothing is written before the first line, or `begin`."""
        stamp = time.strftime("%Y-%m-%d_%H-%M-%S", time.localtime(info.begin / 1e9))
        self._robot_folder = (base or log_base()) / info.robot.replace("/", ".")
        self.folder = self._robot_folder / f"{stamp}_{info.pid}"
        self._info = info
        self._files: dict[str, _Rotating] = {}

    def begin(self) -> None:
        """Make the folder, and remove the oldest runs.

        Raises:
            OSError: it cannot be made.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        (self.folder / "run.json").write_bytes(msgspec.json.encode(self._info) + b"\n")
        runs = sorted(folder for folder in self._robot_folder.iterdir() if (folder / "run.json").exists())
        for folder in runs[:-KEPT_RUNS]:
            shutil.rmtree(folder, ignore_errors=True)

    def write(self, line: LogRecord) -> None:
        """Add a line to its process's file.

        Raises:
            OSError: it cannot be written.
        """
        if line.node not in self._files:
            self._files[line.node] = _Rotating(self.folder / f"{line.node.replace('/', '.')}.jsonl")
        self._files[line.node].write(escaped_json(msgspec.json.encode(line).decode()).encode() + b"\n")

    def close(self) -> None:
        """Close all files."""
        for file in self._files.values():
            file.close()


class _Rotating:
    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: BinaryIO = path.open("ab", buffering=0)
        self._size = self._file.tell()

    def write(self, line: bytes) -> None:
        if self._size + len(line) > LARGEST:
            self._rotate()
        self._file.write(line)
        self._size += len(line)

    def _rotate(self) -> None:
        self._file.close()
        for number in range(KEPT_FILES - 1, 0, -1):
            older = self._path.with_name(f"{self._path.name}.{number}")
            newer = self._path.with_name(f"{self._path.name}.{number - 1}") if number > 1 else self._path
            if newer.exists():
                newer.replace(older)
        self._file = self._path.open("ab", buffering=0)
        self._size = 0

    def close(self) -> None:
        self._file.close()
