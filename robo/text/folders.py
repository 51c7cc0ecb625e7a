"""Where robo keeps what outlives a run."""

import os
from pathlib import Path
from typing import BinaryIO

from robo.environment import LOG_FOLDER_VARIABLE


def log_base() -> Path:
    """Where all runs are kept: ROBO_LOG_DIR, or where the desktop standard keeps state."""
    state = os.environ.get("XDG_STATE_HOME") or os.path.expanduser("~/.local/state")
    return Path(os.environ.get(LOG_FOLDER_VARIABLE) or Path(state) / "robo" / "log")


def make_private(folder: Path, base: Path) -> None:
    """Make a folder, and those between it and a base, which their user alone may look into.

    What robo prints names processes, endpoints and files. A base that is there stays as it is: it may be anybody's.

    Args:
        folder: is below the base.
        base: of what is kept.

    Raises:
        OSError: one of them cannot be made.
    """
    if not base.exists():
        base.mkdir(parents=True, exist_ok=True, mode=0o700)  # parents are made as usual
    for part in [*reversed(folder.relative_to(base).parents), folder.relative_to(base)]:
        one = base / part
        if one != base:
            one.mkdir(mode=0o700, exist_ok=True)
            if one.stat().st_mode & 0o077:  # one of before this was so
                one.chmod(0o700)


def append_private(path: Path) -> BinaryIO:
    """Open a file to add to it, unbuffered; where it is made now, its user alone may read it.

    Raises:
        OSError: it cannot be opened.
    """
    return os.fdopen(os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC, 0o600), "ab", buffering=0)
