"""The folder of a flight recorder's files: of bounded number and size, the oldest go."""

import os
import re
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from robo.bag.read.files import Files
from robo.bag.read.reader import Bag
from robo.bag.types import nothing
from robo.errors import BagError
from robo.recording.flight.windows import names_of, to_go
from robo.recording.naming import unused
from robo.text.files import size_of

WORDS = "flight_recorder"
"""What the metadata are called that tell of a file why it was written."""
_DRAFT = re.compile(r"\.(.+)\.(\d+)\.part")


class Shelf:
    """Takes new files, whole or not at all. The files of others in the folder are left alone."""

    def __init__(self, folder: Path, robot: str) -> None:
        """Nothing is made before the first file.

        Args:
            folder: for the files.
            robot: whose they are: its namespace.
        """
        self.folder = folder
        self._names = names_of(robot)

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
        path = unused(self.folder / f"{name}.mcap")
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

    def keep_newest(self, new: Path, most: int, most_size: int) -> list[Path]:
        """Delete the oldest files beyond a number and a size in bytes; which. `new` is the newest of them."""
        files = sorted(self.files(), key=lambda path: path == new)
        gone = files[: to_go([(0, size_of(path)) for path in files], most, most_size)]
        for path in gone:
            with suppress(OSError):
                path.unlink()
        return gone

    def files(self) -> list[Path]:
        """Its files, the oldest first."""
        with suppress(OSError):
            found = [path for path in self.folder.iterdir() if self._names.fullmatch(path.name)]
            return sorted(found, key=lambda path: (_modified(path), path.name))
        return []

    def remove_drafts(self) -> None:
        """Delete what recorders of this robot had begun to write when they were killed; to be called before `add`."""
        with suppress(OSError):
            for path in list(self.folder.iterdir()):
                draft = _DRAFT.fullmatch(path.name)
                if draft and self._names.fullmatch(draft[1]) and not _runs(int(draft[2])):
                    path.unlink()


def words_of(path: Path) -> dict[str, str]:
    """What a file's metadata tell of it: `run`, `nodes`, `reason_0`, …; nothing where it is no flight recorder's."""
    try:
        with Bag(str(path), Files([path]), nothing) as found:
            return found.metadata.get(WORDS, {})
    except BagError:
        return {}


def reasons_of(words: dict[str, str]) -> list[tuple[int, str]]:
    """Why a file was written, by its words: times in ns since the epoch, and reasons, `died: /r1/base was killed`."""
    found = []
    for number in range(len(words)):
        time, _, reason = words.get(f"reason_{number}", "").partition(" ")
        if time.isdecimal():
            found.append((int(time), reason))
    return found


def _runs(pid: int) -> bool:
    """Whether another process of this number runs."""
    if pid == os.getpid():
        return False
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True


def _modified(path: Path) -> int:
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return 0
