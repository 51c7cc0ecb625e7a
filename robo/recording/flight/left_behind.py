"""What recorders have left whose runs have ended without a word: each ring becomes a file, and goes then."""

import shutil
import threading
from contextlib import suppress
from pathlib import Path

from robo.recording.flight.files import FlightFiles
from robo.recording.flight.keeping import Place
from robo.recording.flight.ring import OldFile, claimed, rings_without_owner, taken_over
from robo.wire.run_id import supervisor_lives

_MOST = 3
"""Rings that wait for a file which cannot be written; of more the oldest go."""


class LeftBehind:
    """The rings of a robot's runs that are over."""

    def __init__(self, files: FlightFiles, place: Place) -> None:
        """
        Args:
            files: writes them.
            place: the ring of the present run.
        """
        self.remain = False
        """Whether some could not be written."""
        self._files = files
        self._place = place
        self._one = threading.Lock()

    def write(self) -> None:
        """Write them, one after the other; nothing where this is being done already."""
        if not self._one.acquire(blocking=False):
            return
        try:
            place = self._place
            found = [
                folder
                for base in place.bases
                # The lock says whether a recorder lives, in another container too.
                for folder in rings_without_owner(base, place.robot, place.run, _lives)
            ]
            self.remain = False
            for number, folder in enumerate(sorted(found, key=lambda folder: folder.name)):
                with suppress(OSError):
                    self._write(folder, is_old=len(found) - number > _MOST)
        finally:
            self._one.release()

    def _write(self, folder: Path, *, is_old: bool) -> None:
        with claimed(folder) as is_ours:
            if not is_ours:
                return
            left = [files for _, files in sorted(taken_over(folder).items())]
            if left and not self._is_written(folder.name, left) and not is_old:
                self.remain = True
                return
            shutil.rmtree(folder, ignore_errors=True)

    def _is_written(self, run: str, left: list[list[OldFile]]) -> bool:
        end = max(one.end for files in left for one in files)
        return self._files.write_last_words(run, end, [[one.path for one in files] for files in left])


def _lives(run: str) -> bool:
    return supervisor_lives(run, unknown=False)
