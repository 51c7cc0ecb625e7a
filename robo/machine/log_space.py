"""Room for log files: the oldest go, so that all runs of all robots together take no more than is granted."""

import os
import shutil
import time
from collections import defaultdict
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import msgspec

from robo.environment import LOG_LIMIT_VARIABLE, LOG_RUN_LIMIT_VARIABLE
from robo.errors import UsageError
from robo.machine.log_files import KEPT_FILES, LARGEST, LEAST, RunInfo
from robo.text.files import size_of
from robo.text.readable import readable
from robo.text.unreadable import UNREADABLE
from robo.wire.run_id import supervisor_lives

KEPT_RUNS = 10
"""How many runs of a robot are kept."""
DEFAULT_LIMIT = 1_000
"""What all log files of a user may take, MB; on a small disk it is less, `SHARE` of it."""
DEFAULT_RUN_LIMIT = 300
"""What those of one run may take, MB."""
SHARE = 0.1
"""The part of a disk that all log files take at most, where nobody says more."""

_AT_REST = 86_400.0
"""A run of a container or another machine is over when nothing was written for so long, s: nobody can ask for it."""


class KeptRun(NamedTuple):
    """The files of a run."""

    folder: Path
    info: RunInfo
    size: int
    """Bytes."""
    lives: bool


def limit(base: Path | None = None) -> int:
    """What all log files may take, bytes; `base` is where they are, if that is known.

    Raises:
        UsageError: ROBO_LOG_LIMIT is no number.
    """
    said = _said(LOG_LIMIT_VARIABLE, "all log files", 500)
    if said is not None:
        return said
    usual = DEFAULT_LIMIT * 1_000_000
    return usual if base is None else min(usual, int(SHARE * _disk_size(base)))


def run_limit(most: int) -> int:
    """What the log files of one run may take, bytes: not more than all may, `most`.

    Raises:
        UsageError: ROBO_LOG_RUN_LIMIT is no number.
    """
    said = _said(LOG_RUN_LIMIT_VARIABLE, "the log files of one run", 100)
    return min(most, DEFAULT_RUN_LIMIT * 1_000_000 if said is None else said)


def file_limit(most: int, processes: int) -> int:
    """How large one file may grow, bytes, so that all of a run with so many processes take no more than `most`."""
    return max(LEAST, min(LARGEST, most // (KEPT_FILES * processes)))


def _said(variable: str, what: str, example: int) -> int | None:
    text = os.environ.get(variable, "")
    if text and not (text.isascii() and text.isdigit() and int(text) > 0):
        raise UsageError(f"{variable}={text!r}: say how many megabytes {what} may take, for example {example}")
    return int(text) * 1_000_000 if text else None


def _disk_size(place: Path) -> int:
    """Of the disk on which a folder is, or will be, bytes."""
    there = next(one for one in (place.absolute(), *place.absolute().parents) if one.exists())
    disk = os.statvfs(there)
    return disk.f_blocks * disk.f_frsize


def make_room(base: Path, most: int, own: Path | None = None) -> None:
    """Remove the oldest runs: more than `KEPT_RUNS` of a robot, and of all what takes more than `most` bytes.

    What runs keeps its files. Where it alone takes too much, files of `own`, the folder of one's own run, that were
    set aside go as well, the oldest first.
    """
    runs = kept_runs(base)
    for run in surplus(runs, most):
        shutil.rmtree(run.folder, ignore_errors=True)
    if own is not None:
        over = sum(run.size for run in kept_runs(base)) - most
        for file in sorted(own.glob("*.jsonl.*"), key=_modified):
            if over <= 0:
                break
            over -= size_of(file)
            with suppress(OSError):
                file.unlink()


def surplus(runs: Iterable[KeptRun], most: int) -> list[KeptRun]:
    """The runs that are to go, so that no robot has more than `KEPT_RUNS` and all take no more than `most` bytes."""
    newest_first = sorted(runs, key=lambda run: run.info.begin, reverse=True)
    count: dict[str, int] = defaultdict(int)
    used = sum(run.size for run in newest_first if run.lives)
    found = []
    for run in newest_first:
        count[run.info.robot] += 1
        if run.lives:
            continue
        if count[run.info.robot] > KEPT_RUNS or used + run.size > most:
            found.append(run)
        else:
            used += run.size
    return found


def kept_runs(base: Path, now: Callable[[], float] = time.time) -> list[KeptRun]:
    """All runs whose files are kept."""
    found = []
    for file in base.glob("*/*/run.json"):
        try:
            info = msgspec.json.decode(file.read_bytes(), type=readable(RunInfo))
            files = list(file.parent.iterdir())
        except (OSError, *UNREADABLE):
            continue  # cut short, or being removed
        fresh = now() - max(map(_modified, files), default=0.0) < _AT_REST
        lives = supervisor_lives(info.run, unknown=fresh)
        found.append(KeptRun(file.parent, info, sum(map(size_of, files)), lives))
    return found


def _modified(file: Path) -> float:
    try:
        return file.stat().st_mtime
    except OSError:
        return 0.0
