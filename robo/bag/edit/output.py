"""A new file that is made of others: whole, or not there."""

import contextlib
import io
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

from robo.bag.mcap.compression import SMALL, Compression, compressor
from robo.bag.mcap.file_writer import PROFILE, FileWriter
from robo.errors import BagError


@contextlib.contextmanager
def new_file(
    path: str | Path, compression: Compression = "zstd", *, force: bool = False, profile: str = PROFILE
) -> Iterator[FileWriter]:
    """What writes a new recording, which is there once it is finished, and not before.

    Args:
        path: of it.
        compression: of its chunks.
        force: take the place of a file of this name, once the new one is whole; what is read meanwhile may be it.
        profile: what its topics and messages are like: ros2.

    Raises:
        BagError: there is something of this name already, or it cannot be written.
    """
    how = compressor(compression, SMALL)
    with new_output(path, force=force) as output:
        writer = FileWriter(output, *how, profile=profile)
        yield writer
        writer.finish()


@contextlib.contextmanager
def new_output(path: str | Path, *, force: bool = False) -> Iterator[io.FileIO]:
    """A new file, open for writing, that gets its name once the end is reached, on the disk; `force` as in `new_file`.

    Raises:
        BagError: there is something of this name already, or it cannot be written.
    """
    target = Path(path)
    draft = _draft(target)
    try:
        if not force and os.path.lexists(target):
            raise _taken(path)
        output = io.FileIO(draft, "x")
    except (OSError, ValueError) as error:
        raise _error(error, path) from None
    try:
        with output:
            yield output
            os.fsync(output.fileno())
        if force:
            draft.replace(target)
        else:
            _give_name(draft, target)
        _sync_folder(target.parent)
    except BaseException as error:
        with contextlib.suppress(OSError):
            draft.unlink()
        if isinstance(error, OSError) and not isinstance(error, BagError):
            raise _error(error, path) from None
        raise


@contextlib.contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """A new folder under another name, that gets its own once the end is reached.

    Raises:
        BagError: there is something of this name already, or it cannot be made or written.
    """
    draft = _draft(path)
    try:
        if os.path.lexists(path):
            raise BagError("it is there already; name a folder that is not", str(path))
        draft.mkdir()
    except (OSError, ValueError) as error:
        raise _error(error, path) from None
    try:
        yield draft
        draft.rename(path)
        _sync_folder(path.parent)
    except BaseException as error:
        shutil.rmtree(draft, ignore_errors=True)
        if isinstance(error, OSError) and not isinstance(error, BagError):
            raise _error(error, path) from None
        raise


def _draft(target: Path) -> Path:
    """What stands for a file until it is whole; nobody takes it for a recording."""
    return target.with_name(f".{target.name[:50]}.{os.urandom(4).hex()}.part") if target.name else target


def _give_name(draft: Path, target: Path) -> None:
    """Have a draft under a name that nobody has."""
    try:
        os.link(draft, target)  # it refuses where somebody else was sooner
    except FileExistsError:
        raise _taken(target) from None
    except OSError:  # a disk without second names
        if os.path.lexists(target):
            raise _taken(target) from None
        draft.replace(target)
    else:
        draft.unlink()


def _sync_folder(folder: Path) -> None:
    """Have the names in a folder on the disk, where its system can do that."""
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _taken(path: str | Path) -> BagError:
    return BagError("it is there already; name another one, or say --force to write over it", str(path))


def _error(error: OSError | ValueError, path: str | Path) -> BagError:
    return BagError(f"it cannot be written: {getattr(error, 'strerror', None) or error}", str(path))
