"""Folders for the time being, each with the id of the process that has made it: those of dead ones go."""

import os
import shutil
import tempfile
from contextlib import suppress
from pathlib import Path

import psutil


def make(prefix: str, base: Path | None = None) -> Path:
    """Make a folder that belongs to this process.

    Args:
        prefix: what its name begins with.
        base: the folder that it is in; None for that of temporary files.

    Raises:
        OSError: it cannot be made.
    """
    return Path(tempfile.mkdtemp(prefix=f"{prefix}{os.getpid()}-", dir=base))


def sweep(prefix: str, base: Path | None = None) -> None:
    """Take away the folders of processes that have ended without doing so, by a kill or a power cut."""
    for left in (base or Path(tempfile.gettempdir())).glob(f"{prefix}*-*"):
        pid = left.name.removeprefix(prefix).partition("-")[0]
        if pid.isdecimal() and not _lives(int(pid)):
            shutil.rmtree(left, ignore_errors=True)


def _lives(pid: int) -> bool:
    with suppress(psutil.NoSuchProcess):
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    return False
