"""Reading files that a user names: only regular ones, asked for their size first, and no more than is expected.

A pipe would keep a command waiting, and a device such as `/dev/zero` never ends.
"""

import os
import stat
from pathlib import Path
from typing import BinaryIO

from robo.errors import UnreadableFile

MOST = 2_000_000
"""The most that is read where nothing else is said, bytes."""

_KINDS = {
    stat.S_IFDIR: "a folder", stat.S_IFIFO: "a pipe", stat.S_IFCHR: "a device", stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}  # fmt: skip


def read_text(path: str | Path, most: int = MOST) -> str:
    """The text of a file.

    Raises:
        UnreadableFile: as `read_bytes`, or it is not text in UTF-8.
    """
    data = read_bytes(path, most)
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise UnreadableFile(f"it is not text in UTF-8: byte 0x{data[error.start]:02x} in line {line}") from None


def read_bytes(path: str | Path, most: int = MOST) -> bytes:
    """What a file holds.

    Args:
        path: of a regular file.
        most: that it may hold, bytes.

    Raises:
        UnreadableFile: it is missing, may not be read, is no regular file, or holds more; says why.
    """
    with open_regular(path) as file:
        size = os.fstat(file.fileno()).st_size
        if size > most:
            raise UnreadableFile(f"it has {size:,} bytes, and at most {most:,} are read")
        try:
            data = file.read(most + 1)
        except OSError as error:
            raise UnreadableFile(_reason(error)) from None
    if data is None or len(data) > most:  # it tells no size, or grows
        raise UnreadableFile(f"it has more than {most:,} bytes")
    return data


def open_regular(path: str | Path) -> BinaryIO:
    """A regular file, open for reading.

    Raises:
        UnreadableFile: it is missing, may not be read, or is something else; says why.
    """
    try:
        _refuse_others(os.stat(path).st_mode)
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    except FileNotFoundError as error:
        raise UnreadableFile(_reason(error), missing=True) from None
    except (OSError, ValueError) as error:  # a ValueError where its name holds a zero character
        raise UnreadableFile(_reason(error)) from None
    file = os.fdopen(descriptor, "rb", buffering=-1)
    try:
        _refuse_others(os.fstat(descriptor).st_mode)  # it may have been replaced meanwhile
    except UnreadableFile:
        file.close()
        raise
    return file


def size_of(path: Path) -> int:
    """Of a file, bytes; 0 where it is just gone."""
    try:
        return path.stat().st_size
    except OSError:
        return 0


def _refuse_others(mode: int) -> None:
    if not stat.S_ISREG(mode):
        raise UnreadableFile(f"it is {_KINDS.get(stat.S_IFMT(mode), 'something else')}, not a file")


def _reason(error: OSError | ValueError) -> str:
    return getattr(error, "strerror", None) or str(error)
