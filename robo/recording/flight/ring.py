"""The ring of a flight recorder: the last seconds of a robot as files, of which the oldest go.

    <base>/<robot>/<run>/lock             held by the recorder that lives
    <base>/<robot>/<run>/<n>/             what the nth recorder of the run has written, a recording of several files

All of it is there after a kill -9 but for the last second; the next recorder of the run takes it over, and that of
another run finds it where nobody lives that could.
"""

import fcntl
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import msgspec

from robo.bag.edit.recovery import recover
from robo.bag.mcap.compression import Compression
from robo.bag.mcap.scan import index_of
from robo.bag.mcap.source import Source
from robo.bag.options import Options
from robo.bag.read.files import files_of
from robo.bag.write.disk import Free, free_room, second_name
from robo.bag.write.writer import Recording
from robo.errors import BagError, FlightRecorderError
from robo.text.files import size_of

_PARTS = 8
"""Into so many files a window is split; that much more than it is kept at most."""
_LEAST_PART = 1.0
"""Of a file, s: each begins with all types and latched messages."""
_LEAST_FREE = 2**23
"""Room that is left to others in the folder's disk, bytes: 8 MB."""
_LOCK = "lock"


class Limits(msgspec.Struct, frozen=True, kw_only=True):
    """What a ring keeps."""

    duration: float
    """The last of it, s."""
    size: int
    """Bytes at most."""
    compression: Compression = "none"


def default_bases() -> list[Path]:
    """Where rings may be, the best first: in memory, where the machine has a folder for what runs; that one goes when
    its user logs out.
    """
    lasting = Path(tempfile.gettempdir()) / f"robo-flight-{os.getuid()}"
    runtime = os.environ.get("XDG_RUNTIME_DIR", "")
    if runtime and os.access(runtime, os.W_OK | os.X_OK):
        return [Path(runtime) / "robo-flight", lasting]
    return [lasting]


class OldFile(msgspec.Struct, frozen=True):
    """A file of a recorder that has died."""

    path: Path
    end: int
    """Its last arrival, ns since the epoch."""
    size: int


class Ring:
    """Keeps what is written into `recording`. Used by one thread at a time."""

    def __init__(self, folder: Path, limits: Limits, now: int, free: Free = free_room) -> None:
        """
        Args:
            folder: of the run; what is there of a recorder that has died is taken over.
            limits: what is kept.
            now: ns since the epoch.
            free: room on the disk of a folder, bytes.

        Raises:
            FlightRecorderError: another recorder of the run lives.
            BagError: nothing can be written there.
        """
        self.folder = folder
        self.follows = folder.is_dir()
        """Whether another recorder of the run was there, and has died: one that is stopped leaves nothing."""
        self._limits = limits
        self._free = free
        self._lock = _locked(folder)
        self._number = self._holds = 0
        self._old: dict[int, list[OldFile]] = {}
        """By recorder, what those before this one have left."""
        try:
            shutil.rmtree(folder / "held", ignore_errors=True)
            self.recording = self._begin(now)
        except BaseException:
            os.close(self._lock)
            raise
        self.taken = sum(map(len, self._old.values()))
        """Files that were there already."""

    def _begin(self, now: int) -> Recording:
        """Begin a recording; all that is there already is old."""
        with _as_bag_error(self.folder):
            self._old = taken_over(self.folder)
            numbers = [int(one.name) for one in self.folder.iterdir() if one.name.isdecimal()]
        self._number = max([self._number, *numbers]) + 1
        self._drop_old(now, 0)
        limits = self._limits
        options = Options(
            compression=limits.compression,
            sync=False,
            split_duration=max(limits.duration / _PARTS, _LEAST_PART),
            split_size=max(limits.size // _PARTS, 1),
            keep_duration=limits.duration,
            most_size=limits.size,
            least_free=_LEAST_FREE,
            when_full="drop_oldest",
        )
        return Recording(self.folder / str(self._number), options, free=self._free)

    def begin_anew(self, now: int) -> None:
        """Go on after a failure: what was written before is old.

        Raises:
            BagError: nothing can be written.
        """
        with suppress(BagError):
            self.recording.close()
        self.recording = self._begin(now)
        self.recording.flush()  # which tells whether there is room

    @property
    def size(self) -> int:
        """Of all files, bytes."""
        return self._present + sum(one.size for files in self._old.values() for one in files)

    @property
    def _present(self) -> int:
        return sum(size_of(path) for path in self.recording.files)

    def look(self, now: int) -> None:
        """Let go what is too old, or too much; to be called once a second. Times are ns since the epoch.

        Raises:
            BagError: nothing can be written.
        """
        self.recording.tick()
        if self._old:
            self._drop_old(now, self._present)

    def hold(self, at: int) -> tuple[Path, list[list[Path]]]:
        """Keep all files that are there from going, whatever is written from now on.

        Returns:
            A folder, to be removed when they are not needed any more; and the files of each recording.

        Raises:
            BagError: no folder can be made.
        """
        present = self.recording.files
        with suppress(BagError):  # it cannot be written any more: what is there is there
            self.recording.split(at)
            present = self.recording.files[:-1]
        self._holds += 1
        folder = self.folder / "held" / str(self._holds)
        recordings = [[one.path for one in files] for _, files in sorted(self._old.items())]
        recordings.append(present)
        found = []
        for number, files in enumerate(recordings):
            inner = folder / str(number)
            with _as_bag_error(inner):
                inner.mkdir(parents=True)
            held = [inner / path.name for path in files]
            found.append([link for path, link in zip(files, held, strict=True) if _linked(path, link)])
        return folder, found

    def close(self, *, remove: bool = True) -> None:
        """End it; what it had is removed, unless somebody is to find it."""
        with suppress(BagError):
            self.recording.close()
        if remove:
            shutil.rmtree(self.folder, ignore_errors=True)
            with suppress(OSError):
                self.folder.parent.rmdir()
        os.close(self._lock)

    def leave(self) -> None:
        """End it where another one goes on elsewhere: of what it had, only what is held stays."""
        with suppress(BagError):
            self.recording.close()
        for number in (*self._old, self._number):
            shutil.rmtree(self.folder / str(number), ignore_errors=True)
        os.close(self._lock)

    def _drop_old(self, now: int, present: int) -> None:
        """What others have left goes as it grows old; and all of it before anything of one's own, which has `present`
        bytes.
        """
        limits = self._limits
        over = present + sum(one.size for files in self._old.values() for one in files) - limits.size
        for number in sorted(self._old):
            files = self._old[number]
            while files and (over > 0 or now - files[0].end > limits.duration * 1e9):
                gone = files.pop(0)
                over -= gone.size
                with suppress(OSError):
                    gone.path.unlink()
            if not files:
                del self._old[number]
                shutil.rmtree(self.folder / str(number), ignore_errors=True)


def _locked(folder: Path) -> int:
    with _as_bag_error(folder):
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        descriptor = os.open(folder / _LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        raise FlightRecorderError(
            f"another flight recorder of this robot runs already ({folder}); one keeps all topics: stop the other one"
        ) from None
    return descriptor


def taken_over(folder: Path) -> dict[int, list[OldFile]]:
    """What recorders that are gone have left in a folder, whole: by recorder, the oldest file first.

    A file that a kill has cut is mended; what cannot be read goes.

    Raises:
        OSError: nobody may look there.
    """
    found: dict[int, list[OldFile]] = {}
    for inner in sorted(folder.iterdir()) if folder.is_dir() else ():
        if not inner.name.isdecimal() or not inner.is_dir():
            continue
        try:
            paths = files_of(inner)
        except BagError:
            shutil.rmtree(inner, ignore_errors=True)
            continue
        files = [one for path in paths if (one := _whole(path)) is not None]
        if files:
            found[int(inner.name)] = files
        else:
            shutil.rmtree(inner, ignore_errors=True)
    return found


def _whole(path: Path) -> OldFile | None:
    mended = path.with_suffix(".mended")
    try:
        with Source(path) as source:
            index = index_of(source)
        if index.faults:
            mended.unlink(missing_ok=True)
            found = recover(path, mended)
            mended.replace(path)
            return OldFile(path, found.end, size_of(path)) if found.messages else _gone(path)
        return OldFile(path, index.end, size_of(path)) if any(index.counts.values()) else _gone(path)
    except (OSError, BagError):
        with suppress(OSError):
            mended.unlink()
        return _gone(path)


def _gone(path: Path) -> OldFile | None:
    """Nothing is left of it."""
    with suppress(OSError):
        path.unlink()
    return None


def rings_without_owner(base: Path, robot: str, own: str, lives: Callable[[str], bool]) -> list[Path]:
    """The rings of a robot whose runs are over without having removed them, the oldest first.

    Args:
        base: of all rings.
        robot: as `ring_folder` has it.
        own: the id of the present run.
        lives: whether the supervisor of a run lives.
    """
    try:
        inner = sorted(path for path in ring_folder(base, robot, own).parent.iterdir() if path.is_dir())
    except OSError:
        return []
    return [path for path in inner if path.name != own and not lives(path.name)]


@contextmanager
def claimed(folder: Path) -> Iterator[bool]:
    """While this goes on, a ring without an owner is this process's; whether it is: a recorder may live after all."""
    try:
        descriptor = _locked(folder)
    except (BagError, FlightRecorderError):
        yield False
        return
    try:
        yield True
    finally:
        os.close(descriptor)


def ring_folder(base: Path, robot: str, run: str) -> Path:
    """The folder of a ring."""
    return base / (robot.replace("/", ".") or "robot") / run


def _linked(path: Path, link: Path) -> bool:
    """Whether a file has a second name now."""
    try:
        second_name(path, link)
    except OSError:
        return False
    return True


@contextmanager
def _as_bag_error(path: Path) -> Iterator[None]:
    """An error of the disk as one of robo's."""
    try:
        yield
    except OSError as error:
        raise BagError(f"it cannot be made: {error.strerror or error}", str(path)) from None
