"""The folder of a flight recorder's files: of bounded number and size, the oldest go."""

import os
import re
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from robo.errors import BagError
from robo.recording.flight.windows import to_go

_NAME = re.compile(r".+_\d{4}-\d\d-\d\d_\d\d-\d\d-\d\d(_[A-Za-z0-9_]+)?\.mcap")
"""Of a recorder's own files: others in the folder are left alone."""


class Shelf:
    """Takes new files, whole or not at all."""

    def __init__(self, folder: Path) -> None:
        """Nothing is made before the first file."""
        self.folder = folder

    def add(self, name: str, write: Callable[[Path], object]) -> Path:
        """Add a file.

        Args:
            name: without its end; a number is added where there is one of this name.
            write: writes it to a path.

        Raises:
            BagError: it cannot be written.
        """
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise BagError(f"the folder cannot be made: {error.strerror}", str(self.folder)) from None
        path, number = self.folder / f"{name}.mcap", 1
        while os.path.lexists(path):
            number += 1
            path = self.folder / f"{name}_{number}.mcap"
        draft = path.with_name(f".{path.name}.{os.getpid()}.part")
        with suppress(OSError):
            draft.unlink()
        write(draft)
        try:
            draft.replace(path)
        except OSError as error:
            with suppress(OSError):
                draft.unlink()
            raise BagError(f"it cannot be written: {error.strerror}", str(path)) from None
        return path

    def keep_newest(self, most: int, most_size: int) -> list[Path]:
        """Delete the oldest files beyond a number and a size in bytes; which."""
        files = self.files()
        gone = files[: to_go([(0, _size(path)) for path in files], most, most_size)]
        for path in gone:
            with suppress(OSError):
                path.unlink()
        return gone

    def files(self) -> list[Path]:
        """Its files, the oldest first."""
        with suppress(OSError):
            found = [path for path in self.folder.iterdir() if _NAME.fullmatch(path.name)]
            return sorted(found, key=lambda path: (_modified(path), path.name))
        return []


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0


def _modified(path: Path) -> int:
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return 0
