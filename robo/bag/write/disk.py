"""The files of a recording that is being written, and the room that they take."""

import contextlib
import io
import os
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

from robo.bag.options import Options
from robo.bag.write import ros2_folder
from robo.bag.write.ros2_folder import FileOf, TopicKey, TopicOf
from robo.errors import BagError
from robo.text.files import size_of

_METADATA = "metadata.yaml"

_HEADS = 2
"""What files begin with may take so many times of what is granted to all that comes after it; of two files that are
whole it may take whatever it does."""

Free = Callable[[Path], int]
"""Room on the disk of a folder, bytes."""


def free_room(folder: Path) -> int:
    """What a disk has left for this user, bytes."""
    return shutil.disk_usage(folder).free


def second_name(file: Path, name: Path) -> None:
    """Have a file under another name, too, whatever becomes of the first one; on a disk without such names, a copy.

    Raises:
        OSError: it is not there, or no room is.
    """
    try:
        os.link(file, name)
    except FileNotFoundError:
        raise
    except OSError:
        shutil.copyfile(file, name)


class Disk:
    """One file, or files with numbers in a folder, of which the oldest may have to go."""

    def __init__(self, path: str | Path, options: Options, free: Free = free_room) -> None:
        """
        Raises:
            BagError: there is something of this name already, or nothing can be made there.
        """
        self._options = options
        self._free = free
        self._path = Path(path)
        self._number = 0
        self._old: list[Path] = []
        self._whole: dict[Path, FileOf] = {}
        self._topics: Sequence[TopicOf] = ()
        self._heads: dict[Path, int] = {}
        """Of each file what it begins with, bytes."""
        self.now: Path | None = None
        """The file that is being written."""
        folder = self._path if options.splits else self._path.parent
        self._folder = folder
        try:
            if os.path.lexists(self._path):
                raise BagError("it is there already; name another one", str(self._path))
            folder.mkdir(parents=True, exist_ok=not options.splits)
        except (OSError, ValueError) as error:
            raise _error(error, self._path) from None

    @property
    def files(self) -> list[Path]:
        """Those that are there, the oldest first."""
        return [*self._old, *([self.now] if self.now is not None else [])]

    @property
    def data_size(self) -> int:
        """Of all files, without what each begins with, bytes."""
        return sum(map(size_of, self.files)) - sum(self._heads.values())

    def open_next(self) -> io.FileIO:
        """The next file, empty.

        Raises:
            BagError: it cannot be made.
        """
        path = self._path
        if self._options.splits:
            path = self._folder / f"{self._path.name}_{self._number}.mcap"
            self._number += 1
        try:
            found = io.FileIO(path, "x")
        except (OSError, ValueError) as error:
            raise _error(error, path) from None
        self.now = path
        if self._options.sync:
            _sync_folder(path.parent)
        return found

    def begun(self, head: int) -> None:
        """What every file begins with is in the one that is being written: so many bytes."""
        assert self.now is not None
        self._heads[self.now] = head

    def finished(self, begin: int, end: int, counts: dict[TopicKey, int], topics: Sequence[TopicOf]) -> None:
        """The file is whole: its first and last arrival in ns, its messages by topic, and all topics so far."""
        assert self.now is not None
        self._whole[self.now] = FileOf(self.now.name, begin, end, counts)
        self._old.append(self.now)
        self.now = None
        self._topics = topics
        self._tell_ros()

    def keep_newest(self, now: int) -> None:
        """Delete files beyond those that are to be kept, the one that is being written among them.

        Args:
            now: when that one began, ns since the epoch.
        """
        before = len(self._old)
        while self._old and self._is_too_much(now):
            self._delete_oldest()
        if len(self._old) < before:
            self._tell_ros()

    def _is_too_much(self, now: int) -> bool:
        """Whether the oldest file has to go."""
        o = self._options
        if o.keep is not None and len(self.files) > o.keep:
            return True
        if o.keep_duration is not None and now - self._whole[self._old[0]].end > o.keep_duration * 1e9:
            return True
        if o.most_size is None:
            return False
        if sum(self._heads.values()) > _HEADS * o.most_size and len(self._old) > 2:
            return True
        return self.data_size + (o.split_size or 0) > o.most_size

    def snapshot(self, folder: Path, topics: Sequence[TopicOf]) -> list[Path]:
        """Give the whole files second names, which stay when the first ones go.

        Args:
            folder: where they are to stand; it is made.
            topics: all so far.

        Raises:
            BagError: the folder or a name in it cannot be made; nothing is left of it.
        """
        try:
            folder.mkdir(parents=True)
        except (OSError, ValueError) as error:
            raise _error(error, folder) from None
        names = [folder / file.name for file in self._old]
        try:
            for file, name in zip(self._old, names, strict=True):
                second_name(file, name)
        except OSError as error:
            shutil.rmtree(folder, ignore_errors=True)
            raise _error(error, folder) from None
        self._write_metadata(folder, topics)
        return names

    def has_room(self) -> bool:
        """Whether others have enough left, after old files have been deleted where that is wanted.

        Raises:
            BagError: the disk does not tell: somebody has deleted the folder, or taken the disk away.
        """
        least = self._options.least_free
        if not least:
            return True
        before = len(self._old)
        try:
            while self._free(self._folder) < least:
                if self._options.when_full != "drop_oldest" or not self._old:
                    return False
                self._delete_oldest()
        except OSError as error:
            raise BagError(
                f"its disk does not tell what room it has: {error.strerror or error}", str(self._path)
            ) from None
        finally:
            if len(self._old) < before:
                self._tell_ros()
        return True

    def discard(self) -> None:
        """Delete all of it."""
        with contextlib.suppress(OSError):
            for file in self.files:
                file.unlink(missing_ok=True)
            if self._options.splits:
                (self._folder / _METADATA).unlink(missing_ok=True)
                self._folder.rmdir()

    def _delete_oldest(self) -> None:
        oldest = self._old.pop(0)
        self._whole.pop(oldest, None)
        self._heads.pop(oldest, None)
        with contextlib.suppress(OSError):
            oldest.unlink()

    def _tell_ros(self) -> None:
        """Which files there are."""
        if self._options.splits:
            self._write_metadata(self._folder, self._topics)

    def _write_metadata(self, folder: Path, topics: Sequence[TopicOf]) -> None:
        """For ROS 2, which wants it; robo reads the files themselves, so that a full disk does not matter."""
        text = ros2_folder.metadata_yaml([self._whole[path] for path in self._old], topics)
        target = folder / _METADATA
        draft = target.with_suffix(".yaml.part")
        with contextlib.suppress(OSError):
            draft.write_text(text, encoding="utf-8")
            draft.replace(target)


def _sync_folder(folder: Path) -> None:
    """Its names are on the disk: a file without one is lost in a power cut, however much of it is there."""
    with contextlib.suppress(OSError):  # not every disk can
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _error(error: OSError | ValueError, path: Path) -> BagError:
    return BagError(f"it cannot be made: {getattr(error, 'strerror', None) or error}", str(path))
