"""Output of processes in files: a folder for each run, a file for each process."""

import os
import time
from pathlib import Path
from typing import TextIO


def log_folder(robot: str) -> Path:
    """The folder for a new run: below ROBO_LOG_DIR, or where the desktop standard keeps state."""
    state = os.environ.get("XDG_STATE_HOME") or os.path.expanduser("~/.local/state")
    base = Path(os.environ.get("ROBO_LOG_DIR") or Path(state) / "robo" / "log")
    return base / f"{time.strftime('%Y-%m-%d_%H-%M-%S')}_{robot}_{os.getpid()}"


class LogFiles:
    """The log files of one run, each made with its first line."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._files: dict[str, TextIO] = {}

    def line(self, label: str, text: str) -> None:
        """Add a line, with the time, to a process's file.

        Raises:
            OSError: it cannot be written.
        """
        if label not in self._files:
            self.folder.mkdir(parents=True, exist_ok=True)
            path = self.folder / f"{label.replace('/', '.')}.log"
            self._files[label] = path.open("a", encoding="utf-8", buffering=1)
        now = time.time()
        stamp = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(now))
        self._files[label].write(f"{stamp}.{int(now * 1000) % 1000:03d} {text}\n")

    def close(self) -> None:
        """Close all files."""
        for file in self._files.values():
            file.close()
