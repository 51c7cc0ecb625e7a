"""The records of MCAP files (https://mcap.dev/spec), from bytes. Pure.

A file is the magic, records, the magic. A record is one byte that says what it is, its length as a uint64, and its
content. Numbers are little-endian, times are ns, texts have their length before them as a uint32. Nothing is read
beyond the end of what was handed in, whatever lengths it claims.
"""

import struct
import zlib
from collections.abc import Callable, Iterator
from typing import Final

import msgspec

from robo.text.brief import shown

MAGIC: Final = b"\x89MCAP0\r\n"

HEADER: Final = 0x01
FOOTER: Final = 0x02
SCHEMA: Final = 0x03
CHANNEL: Final = 0x04
MESSAGE: Final = 0x05
CHUNK: Final = 0x06
MESSAGE_INDEX: Final = 0x07
CHUNK_INDEX: Final = 0x08
ATTACHMENT: Final = 0x09
ATTACHMENT_INDEX: Final = 0x0A
STATISTICS: Final = 0x0B
METADATA: Final = 0x0C
METADATA_INDEX: Final = 0x0D
SUMMARY_OFFSET: Final = 0x0E
DATA_END: Final = 0x0F

PREFIX: Final = struct.Struct("<BQ")
"""What a record is, and how long its content."""
MESSAGE_HEAD: Final = struct.Struct("<HIQQ")
"""Channel, sequence number, arrival and publish time, before a message's data."""
WHOLE_MESSAGE_HEAD: Final = struct.Struct("<BQHIQQ")
"""Both together."""

FOOTER_SIZE: Final = PREFIX.size + 20
"""Of the whole record, bytes."""

_MOST_WORDS = 10_000
"""Of metadata."""


class Malformed(Exception):
    """Bytes that are no such record; the text is the reason."""


class Header(msgspec.Struct, frozen=True):
    """The first record."""

    profile: str
    library: str


class Footer(msgspec.Struct, frozen=True):
    """The last record."""

    summary_start: int
    """0 where there is no summary."""
    summary_offset_start: int
    crc: int
    """Of the summary and of this record up to here; 0 for none."""


class Schema(msgspec.Struct, frozen=True):
    """What messages of a type look like."""

    id: int
    name: str
    encoding: str
    data: bytes


class Channel(msgspec.Struct, frozen=True):
    """A topic."""

    id: int
    schema_id: int
    """0 for none."""
    topic: str
    encoding: str
    metadata: dict[str, str]


class Chunk(msgspec.Struct, frozen=True):
    """Records together, mostly compressed."""

    begin: int
    """Of the arrival times in it, ns."""
    end: int
    size: int
    """Uncompressed, bytes."""
    crc: int
    """Of what is uncompressed; 0 for none."""
    compression: str
    data: memoryview


class ChunkIndex(msgspec.Struct, frozen=True):
    """Where a chunk is, and what is in it."""

    begin: int
    end: int
    offset: int
    length: int
    """Of the whole record, bytes."""
    channels: dict[int, int]
    """Where the index of each channel's messages is."""
    message_index_length: int
    compression: str
    compressed_size: int
    size: int


class Attachment(msgspec.Struct, frozen=True):
    """A file within the file."""

    arrived: int
    created: int
    name: str
    media_type: str
    data: bytes
    crc: int
    """Of all before it; 0 for none."""


class AttachmentIndex(msgspec.Struct, frozen=True):
    """Where an attachment is."""

    offset: int
    length: int
    arrived: int
    created: int
    size: int
    name: str
    media_type: str


class Metadata(msgspec.Struct, frozen=True):
    """Words about the recording."""

    name: str
    words: dict[str, str]


class MetadataIndex(msgspec.Struct, frozen=True):
    """Where words are."""

    offset: int
    length: int
    name: str


class Statistics(msgspec.Struct, frozen=True):
    """How much a file holds."""

    messages: int
    schemas: int
    channels: int
    attachments: int
    metadata: int
    chunks: int
    begin: int
    end: int
    counts: dict[int, int]
    """Messages of each channel."""


class Cursor:
    """Reads the fields of one record, and nothing beyond it."""

    def __init__(self, data: bytes | memoryview, what: str) -> None:
        self._data = memoryview(data)
        self._at = 0
        self._what = what

    @property
    def left(self) -> int:
        """Bytes to the end."""
        return len(self._data) - self._at

    def raw(self, length: int) -> memoryview:
        """The next bytes.

        Raises:
            Malformed: there are not so many.
        """
        if length > self.left:
            raise Malformed(f"its {self._what} claims {length:,} bytes, and {self.left:,} are left")
        self._at += length
        return self._data[self._at - length : self._at]

    def number(self, size: int) -> int:
        """The next unsigned number, of `size` bytes."""
        return int.from_bytes(self.raw(size), "little")

    def text(self) -> str:
        """The next text."""
        try:
            return str(self.raw(self.number(4)), "utf-8")
        except UnicodeDecodeError:
            raise Malformed(f"a text of its {self._what} is not UTF-8") from None

    def words(self) -> dict[str, str]:
        """The next map of texts."""
        inner = Cursor(self.raw(self.number(4)), self._what)
        found = {}
        while inner.left:
            key = inner.text()
            found[key] = inner.text()
            if len(found) > _MOST_WORDS:
                raise Malformed(f"its {self._what} has more than {_MOST_WORDS:,} words")
        return found

    def numbers(self) -> dict[int, int]:
        """The next map of a uint16 to a uint64."""
        data = self.raw(self.number(4))
        if len(data) % 10:
            raise Malformed(f"a map of its {self._what} is cut")
        return dict(struct.iter_unpack("<HQ", data))


def header(content: bytes | memoryview) -> Header:
    """A header from the content of its record."""
    c = Cursor(content, "header")
    return Header(c.text(), c.text())


def footer(content: bytes | memoryview) -> Footer:
    """A footer from the content of its record."""
    c = Cursor(content, "footer")
    return Footer(c.number(8), c.number(8), c.number(4))


def schema(content: bytes | memoryview) -> Schema:
    """A schema from the content of its record."""
    c = Cursor(content, "schema")
    found = Schema(c.number(2), c.text(), c.text(), bytes(c.raw(c.number(4))))
    if not found.id:
        raise Malformed("a schema has the number 0, which means none")
    return found


def channel(content: bytes | memoryview) -> Channel:
    """A channel from the content of its record."""
    c = Cursor(content, "channel")
    return Channel(c.number(2), c.number(2), c.text(), c.text(), c.words())


def chunk(content: bytes | memoryview) -> Chunk:
    """A chunk from the content of its record; what is in it is not looked at."""
    c = Cursor(content, "chunk")
    return Chunk(c.number(8), c.number(8), c.number(8), c.number(4), c.text(), c.raw(c.number(8)))


def chunk_index(content: bytes | memoryview) -> ChunkIndex:
    """Where a chunk is, from the content of its record."""
    c = Cursor(content, "index of chunks")
    return ChunkIndex(
        c.number(8), c.number(8), c.number(8), c.number(8), c.numbers(), c.number(8), c.text(), c.number(8), c.number(8)
    )  # fmt: skip


def attachment(content: bytes | memoryview) -> Attachment:
    """An attachment from the content of its record."""
    c = Cursor(content, "attachment")
    found = Attachment(c.number(8), c.number(8), c.text(), c.text(), bytes(c.raw(c.number(8))), c.number(4))
    if found.crc and zlib.crc32(content[: len(content) - c.left - 4]) != found.crc:
        raise Malformed(f"the attachment {shown(found.name)} has another checksum than it says")
    return found


def attachment_index(content: bytes | memoryview) -> AttachmentIndex:
    """Where an attachment is, from the content of its record."""
    c = Cursor(content, "index of attachments")
    return AttachmentIndex(
        c.number(8), c.number(8), c.number(8), c.number(8), c.number(8), c.text(), c.text()
    )  # fmt: skip


def metadata(content: bytes | memoryview) -> Metadata:
    """Words from the content of their record."""
    c = Cursor(content, "metadata")
    return Metadata(c.text(), c.words())


def metadata_index(content: bytes | memoryview) -> MetadataIndex:
    """Where words are, from the content of the record."""
    c = Cursor(content, "index of metadata")
    return MetadataIndex(c.number(8), c.number(8), c.text())


def statistics(content: bytes | memoryview) -> Statistics:
    """How much there is, from the content of the record."""
    c = Cursor(content, "statistics")
    messages, schemas, channels = c.number(8), c.number(2), c.number(4)
    attachments, words, chunks = c.number(4), c.number(4), c.number(4)
    return Statistics(messages, schemas, channels, attachments, words, chunks, c.number(8), c.number(8), c.numbers())


class Row(msgspec.Struct, frozen=True, gc=False):
    """Where a message is within a block of records, and when it came."""

    channel: int
    sequence: int
    arrived: int
    published: int
    begin: int
    """Of its data."""
    end: int


def rows(data: bytes | memoryview, others: Callable[[int, memoryview], None] | None = None) -> Iterator[Row]:
    """The messages among records that stand one after another.

    Args:
        data: the records.
        others: called with what all other records are, and their contents.

    Raises:
        Malformed: a record goes beyond the end, or is too short for a message.
    """
    whole = len(data)
    view = memoryview(data)
    at = 0
    prefix, head = PREFIX.unpack_from, MESSAGE_HEAD.unpack_from
    while at + PREFIX.size <= whole:
        kind, length = prefix(view, at)
        begin = at + PREFIX.size
        at = begin + length
        if at > whole:
            raise Malformed(f"a record claims {length:,} bytes, and {whole - begin:,} are left")
        if not kind:
            raise Malformed("a record is of no kind")
        if kind == MESSAGE:
            if length < MESSAGE_HEAD.size:
                raise Malformed(f"a message of {length} bytes is too short for its head")
            channel, sequence, arrived, published = head(view, begin)
            yield Row(channel, sequence, arrived, published, begin + MESSAGE_HEAD.size, at)
        elif others is not None:
            others(kind, view[begin:at])
    if at != whole:
        raise Malformed(f"{whole - at} bytes are left, too few for a record")
