"""Reading and writing text files line by line, in bounded memory."""

import contextlib
import io
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, Final, Protocol

from robo.bag.edit.output import new_output
from robo.bag.progress import Tell, silent
from robo.errors import BagError, UnreadableFile
from robo.text.files import open_regular

STANDARD: Final = "-"
"""In place of a file: standard input, or standard output."""
MOST_LINE: Final = 2**27
"""Of a line that is read, bytes: 134 MB. A picture as text has a few millions."""
_EACH = 50


def lines_of(path: str | Path, tell: Tell = silent) -> Iterator[bytes]:
    """The lines of a file, one after another, with their ends; `tell` is told how many bytes have been read.

    Raises:
        BagError: it cannot be read, or a line is too long.
    """
    with contextlib.ExitStack() as stack:
        if str(path) == STANDARD:
            file: BinaryIO = sys.stdin.buffer
            size = 0
        else:
            try:
                file = stack.enter_context(open_regular(path))
            except UnreadableFile as error:
                raise BagError(str(error), str(path)) from None
            size = file.seek(0, io.SEEK_END)
            file.seek(0)
        yield from _lines(file, str(path), size, tell)


def _lines(file: BinaryIO, path: str, size: int, tell: Tell) -> Iterator[bytes]:
    done = number = 0
    while True:
        try:
            line = file.readline(MOST_LINE + 1)
        except OSError as error:
            raise BagError(f"it cannot be read: {error.strerror}", path) from None
        if not line:
            return
        number += 1
        if len(line) > MOST_LINE:
            raise BagError(f"line {number:,} has more than {MOST_LINE:,} bytes", path)
        yield line
        done += len(line)
        if number % _EACH == 0:
            tell(done, size)


class Text(Protocol):
    """What text is written to, as UTF-8."""

    def write(self, data: bytes, /) -> int:
        """Write it."""


@contextlib.contextmanager
def new_text(path: str | Path, *, force: bool = False) -> Iterator[Text]:
    """A new file for text, that is deleted where its end is not reached; or standard output.

    Raises:
        BagError: there is something of this name already, or it cannot be written.
    """
    if str(path) == STANDARD:
        yield _Terminal() if sys.stdout.isatty() else sys.stdout.buffer
        sys.stdout.flush()
        return
    with new_output(path, force=force) as output:
        buffered = io.BufferedWriter(output)
        try:
            yield buffered
            buffered.flush()
        finally:
            with contextlib.suppress(OSError, ValueError):
                buffered.detach()  # whoever opened the file closes it


class _Terminal:
    """Standard output, where people read: control characters are shown there."""

    def write(self, data: bytes) -> int:
        return sys.stdout.write(data.decode())
