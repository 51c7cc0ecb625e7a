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

from robo.environment import LOG_LIMIT_VARIABLE
from robo.errors import UsageError
from robo.machine.log_files import RunInfo
from robo.text.files import size_of
from robo.text.unreadable import UNREADABLE
from robo.wire.run_id import supervisor_lives

KEPT_RUNS = 10
"""How many runs of a robot are kept."""
DEFAULT_LIMIT = 1_000
"""What all log files of a user may take, MB."""

_AT_REST = 86_400.0
"""A run of a container or another machine is over when nothing was written for so long, s: nobody can ask for it."""


class KeptRun(NamedTuple):
    """The files of a run."""

    folder: Path
    info: RunInfo
    size: int
    """Bytes."""
    lives: bool


def limit() -> int:
    """What all log files may take, bytes.

    Raises:
        UsageError: ROBO_LOG_LIMIT is no number.
    """
    text = os.environ.get(LOG_LIMIT_VARIABLE, "")
    if text and not (text.isascii() and text.isdigit() and int(text) > 0):
        raise UsageError(
            f"{LOG_LIMIT_VARIABLE}={text!r}: say how many megabytes all log files may take, for example 500"
        )
    return int(text or DEFAULT_LIMIT) * 1_000_000


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
            info = msgspec.json.decode(file.read_bytes(), type=RunInfo)
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
