"""Where robo keeps what outlives a run."""

import os
from pathlib import Path

from robo.environment import LOG_FOLDER_VARIABLE


def log_base() -> Path:
    """Where all runs are kept: ROBO_LOG_DIR, or where the desktop standard keeps state."""
    state = os.environ.get("XDG_STATE_HOME") or os.path.expanduser("~/.local/state")
    return Path(os.environ.get(LOG_FOLDER_VARIABLE) or Path(state) / "robo" / "log")
