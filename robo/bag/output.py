"""A new file that is made of others: whole, or not there."""

import contextlib
import io
from collections.abc import Iterator
from pathlib import Path

from robo.bag.compression import SMALL, Compression, compressor
from robo.bag.file_writer import FileWriter
from robo.errors import BagError


@contextlib.contextmanager
def new_file(path: str | Path, compression: Compression = "zstd") -> Iterator[FileWriter]:
    """What writes a new file, which is finished at the end and deleted where that is not reached.

    Raises:
        BagError: there is something of this name already, or it cannot be written.
    """
    how = compressor(compression, SMALL)
    try:
        output = io.FileIO(path, "x")
    except FileExistsError:
        raise BagError("it is there already; name another one", str(path)) from None
    except (OSError, ValueError) as error:
        raise _error(error, path) from None
    try:
        with output:
            writer = FileWriter(output, *how)
            yield writer
            writer.finish()
    except BaseException as error:
        with contextlib.suppress(OSError):
            Path(path).unlink()
        if isinstance(error, OSError) and not isinstance(error, BagError):
            raise _error(error, path) from None
        raise


def _error(error: OSError | ValueError, path: str | Path) -> BagError:
    return BagError(f"it cannot be written: {getattr(error, 'strerror', None) or error}", str(path))
