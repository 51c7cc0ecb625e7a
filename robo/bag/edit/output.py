"""A new file that is made of others: whole, or not there."""

import contextlib
import io
import os
from collections.abc import Iterator
from pathlib import Path

from robo.bag.mcap.compression import SMALL, Compression, compressor
from robo.bag.mcap.file_writer import FileWriter
from robo.errors import BagError


@contextlib.contextmanager
def new_file(path: str | Path, compression: Compression = "zstd", *, force: bool = False) -> Iterator[FileWriter]:
    """What writes a new recording, which is finished at the end and deleted where that is not reached.

    Args:
        path: of it.
        compression: of its chunks.
        force: take the place of a file of this name, once the new one is whole; what is read meanwhile may be it.

    Raises:
        BagError: there is something of this name already, or it cannot be written.
    """
    how = compressor(compression, SMALL)
    with new_output(path, force=force) as output:
        writer = FileWriter(output, *how)
        yield writer
        writer.finish()


@contextlib.contextmanager
def new_output(path: str | Path, *, force: bool = False) -> Iterator[io.FileIO]:
    """A new file, open for writing, that is deleted where the end is not reached; `force` as in `new_file`.

    Raises:
        BagError: there is something of this name already, or it cannot be written.
    """
    target = Path(path)
    draft = target.with_name(f".{target.name}.{os.getpid()}.part") if force and target.name else target
    try:
        output = io.FileIO(draft, "x")
    except FileExistsError:
        raise BagError("it is there already; name another one, or say --force to write over it", str(path)) from None
    except (OSError, ValueError) as error:
        raise _error(error, path) from None
    try:
        with output:
            yield output
        if draft is not target:
            draft.replace(target)
    except BaseException as error:
        with contextlib.suppress(OSError):
            draft.unlink()
        if isinstance(error, OSError) and not isinstance(error, BagError):
            raise _error(error, path) from None
        raise


def _error(error: OSError | ValueError, path: str | Path) -> BagError:
    return BagError(f"it cannot be written: {getattr(error, 'strerror', None) or error}", str(path))
