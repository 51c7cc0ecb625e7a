"""A file of a recording, read at any place, and never beyond its end."""

import contextlib
import os
import zlib
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Final, NamedTuple

from robo.bag.mcap import compression
from robo.bag.mcap.format import (
    ATTACHMENT,
    CHUNK,
    MAGIC,
    PREFIX,
    Attachment,
    Chunk,
    Malformed,
    attachment,
    chunk,
)
from robo.errors import BagError, DamagedBag, UnreadableFile
from robo.text.files import open_regular

MOST_RECORD: Final = compression.MOST + 2**16
"""The content of a record but an attachment, bytes."""
MOST_ATTACHMENT: Final = 2**28
"""The content of an attachment, bytes: 268 MB."""

_AT_ONCE = 2**20
"""Of what is only looked at, bytes."""

UNZSTD: Final = "`unzstd` makes MCAP of it"
OTHERS: Final = {
    b"SQLite f": "a database of SQLite, as ROS 2 wrote them: `rosbags-convert` or `ros2 bag convert` makes MCAP of it",
    b"#ROSBAG ": "a recording of ROS 1: `rosbags-convert` makes MCAP of it",
}
"""What else recordings are, by their first bytes."""
_ZSTD = b"\x28\xb5\x2f\xfd"


def other_form(begin: bytes) -> str | None:
    """What else than MCAP a file is, by its first eight bytes, and what to do; None where that is not known."""
    return f"compressed as a whole: {UNZSTD}" if begin.startswith(_ZSTD) else OTHERS.get(begin)


class Place(NamedTuple):
    """A record, where it stands."""

    offset: int
    """Of the record in the file, bytes."""
    kind: int
    length: int
    """Of its content, bytes."""

    @property
    def content(self) -> int:
        """Where its content begins."""
        return self.offset + PREFIX.size

    @property
    def end(self) -> int:
        """Where the next one begins."""
        return self.offset + PREFIX.size + self.length


class Source:
    """An MCAP file, open for reading: as large as it was when it was opened."""

    def __init__(self, path: str | Path) -> None:
        """
        Raises:
            BagError: it cannot be opened.
            DamagedBag: it is no MCAP file.
        """
        self.path = str(path)
        self.ends = True
        """Whether it ends as a whole file does."""
        try:
            self._file = open_regular(path)
        except UnreadableFile as error:
            raise BagError(str(error), self.path) from None
        try:
            self.size = os.fstat(self._file.fileno()).st_size
            begin = self._read(0, min(self.size, len(MAGIC)))
            if begin != MAGIC:
                other = other_form(begin)
                if other is not None:
                    raise BagError(f"it is {other}", self.path)
                begun = MAGIC.startswith(begin)
                raise DamagedBag("it is no MCAP file" if begin else "it is empty", self.path, 0, cut=begun)
            self.ends = self._read(max(self.size - len(MAGIC), 0), min(self.size, len(MAGIC))) == MAGIC
        except BagError:
            self.close()
            raise

    def read(self, offset: int, length: int) -> bytes:
        """Bytes of the file.

        Raises:
            DamagedBag: the file has not so many.
        """
        if not 0 <= offset <= offset + length <= self.size:
            raise self.damaged(offset, f"{length:,} bytes should follow, and the file has {self.size:,}")
        return self._read(offset, length)

    def place(self, offset: int) -> Place:
        """What record stands somewhere.

        Raises:
            DamagedBag: none does, or it claims to go beyond the end of the file.
        """
        if offset + PREFIX.size > self.size:
            raise self.ended(offset, "a record should follow")
        kind, length = PREFIX.unpack(self.read(offset, PREFIX.size))
        found = Place(offset, kind, length)
        if found.end > self.size:
            raise self.ended(offset, f"a record claims {length:,} bytes, and {self.size - found.content:,} are left")
        return found

    def content(self, place: Place) -> bytes:
        """The content of a record.

        Raises:
            DamagedBag: it is too large to be held in memory.
        """
        if place.length > MOST_RECORD:
            reason = f"a record has {place.length:,} bytes, and at most {MOST_RECORD:,} are read"
            raise self.damaged(place.offset, reason)
        return self.read(place.content, place.length)

    def attachment(self, offset: int) -> Attachment:
        """A file within the file.

        Raises:
            DamagedBag: there is none, or it is too large to be held in memory.
        """
        place = self.place(offset)
        try:
            if place.kind != ATTACHMENT:
                raise Malformed("there is no attachment, and the index says one is")
            if place.length > MOST_ATTACHMENT:
                raise Malformed(f"an attachment has {place.length:,} bytes, and at most {MOST_ATTACHMENT:,} are read")
            return attachment(self.read(place.content, place.length))
        except Malformed as error:
            raise self.damaged(offset, str(error)) from None

    def chunk(self, place: Place) -> Chunk:
        """A chunk, as it is.

        Raises:
            DamagedBag: there is none.
        """
        if place.kind != CHUNK:
            raise self.damaged(place.offset, "there is no chunk, and the index says one is")
        try:
            return chunk(self.content(place))
        except Malformed as error:
            raise self.damaged(place.offset, str(error)) from None

    def restored(self, place: Place, found: Chunk) -> bytes | memoryview:
        """The records in a chunk.

        Raises:
            DamagedBag: it is damaged.
            BagError: its compression cannot be read here.
        """
        try:
            data = compression.restored(found.compression, found.data, found.size)
        except Malformed as error:
            raise self.damaged(place.offset, str(error)) from None
        except compression.CannotRestore as error:
            raise BagError(str(error), self.path) from None
        if found.crc and zlib.crc32(data) != found.crc:
            raise self.damaged(place.offset, "a chunk has another checksum than it says")
        return data

    def places(self, begin: int, end: int) -> Iterator[Place]:
        """The records from a place up to another one.

        Raises:
            DamagedBag: one goes beyond it.
        """
        while begin < end:
            found = self.place(begin)
            if found.end > end:
                raise self.damaged(begin, f"a record claims {found.length:,} bytes, which is too much here")
            yield found
            begin = found.end

    def checksum(self, begin: int, end: int) -> int:
        """The CRC32 of some of its bytes.

        Raises:
            DamagedBag: the file has not so many.
        """
        found = 0
        for at in range(begin, end, _AT_ONCE):
            found = zlib.crc32(self.read(at, min(_AT_ONCE, end - at)), found)
        return found

    def damaged(self, offset: int, reason: str) -> DamagedBag:
        """An error of this file."""
        return DamagedBag(reason, self.path, offset)

    def ended(self, offset: int, reason: str) -> DamagedBag:
        """An error of this file, which has too little from some place on."""
        if self.ends and self.size > 2 * len(MAGIC):
            return self.damaged(offset, reason)
        return DamagedBag(f"the file is cut: {reason}", self.path, offset, cut=True)

    def close(self) -> None:
        """Close the file."""
        with contextlib.suppress(OSError):
            self._file.close()

    def __enter__(self) -> "Source":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _read(self, offset: int, length: int) -> bytes:
        try:
            parts = []
            while length > 0:  # the system may hand over less than what was asked for
                part = os.pread(self._file.fileno(), length, offset)
                if not part:
                    raise DamagedBag("the file has become shorter", self.path, offset)
                parts.append(part)
                offset, length = offset + len(part), length - len(part)
        except OSError as error:
            raise BagError(f"it cannot be read: {error.strerror}", self.path, offset) from None
        return b"".join(parts)
