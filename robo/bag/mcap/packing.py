"""The records of MCAP files, to bytes. Pure: what `format` reads."""

import struct
import zlib
from collections.abc import Mapping, Sequence

from robo.bag.mcap.format import (
    ATTACHMENT,
    ATTACHMENT_INDEX,
    CHANNEL,
    CHUNK,
    CHUNK_INDEX,
    DATA_END,
    FOOTER,
    HEADER,
    MESSAGE_INDEX,
    METADATA,
    METADATA_INDEX,
    PREFIX,
    SCHEMA,
    STATISTICS,
    SUMMARY_OFFSET,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

U32 = 0xFFFF_FFFF
U64 = 0xFFFF_FFFF_FFFF_FFFF


def header(record: Header) -> bytes:
    """The first record."""
    return _record(HEADER, _text(record.profile), _text(record.library))


def schema(record: Schema) -> bytes:
    """What messages of a type look like."""
    return _record(
        SCHEMA,
        struct.pack("<H", record.id),
        _text(record.name),
        _text(record.encoding),
        struct.pack("<I", len(record.data)),
        record.data,
    )


def channel(record: Channel) -> bytes:
    """A topic."""
    ids = struct.pack("<HH", record.id, record.schema_id)
    return _record(CHANNEL, ids, _text(record.topic), _text(record.encoding), _words(record.metadata))


def chunk(begin: int, end: int, size: int, crc: int, compression: str, data: bytes | memoryview) -> bytes:
    """Records together; `data` is compressed already, `size` and `crc` are those of what is not."""
    return chunk_head(begin, end, size, crc, compression, len(data)) + data


def chunk_head(begin: int, end: int, size: int, crc: int, compression: str, length: int) -> bytes:
    """What stands before the `length` bytes of a chunk's data."""
    head = struct.pack("<QQQI", begin, end, size, crc) + _text(compression) + struct.pack("<Q", length)
    return PREFIX.pack(CHUNK, len(head) + length) + head


def message_index(channel_id: int, entries: Sequence[int]) -> bytes:
    """Where a channel's messages are in the chunk before: time and place of each, in turn."""
    packed = struct.pack(f"<{len(entries)}Q", *entries)
    return _record(MESSAGE_INDEX, struct.pack("<HI", channel_id, len(packed)), packed)


def chunk_index(record: ChunkIndex) -> bytes:
    """Where a chunk is."""
    return _record(
        CHUNK_INDEX,
        struct.pack("<QQQQ", record.begin, record.end, record.offset, record.length),
        _numbers(record.channels),
        struct.pack("<Q", record.message_index_length),
        _text(record.compression),
        struct.pack("<QQ", record.compressed_size, record.size),
    )


def attachment(arrived: int, created: int, name: str, media_type: str, data: bytes) -> bytes:
    """A file within the file, with its checksum."""
    times = struct.pack("<QQ", arrived, created)
    content = b"".join((times, _text(name), _text(media_type), struct.pack("<Q", len(data)), data))
    return _record(ATTACHMENT, content, struct.pack("<I", zlib.crc32(content)))


def attachment_index(record: AttachmentIndex) -> bytes:
    """Where an attachment is."""
    numbers = struct.pack("<QQQQQ", record.offset, record.length, record.arrived, record.created, record.size)
    return _record(ATTACHMENT_INDEX, numbers, _text(record.name), _text(record.media_type))


def metadata(record: Metadata) -> bytes:
    """Words about the recording."""
    return _record(METADATA, _text(record.name), _words(record.words))


def metadata_index(record: MetadataIndex) -> bytes:
    """Where words are."""
    return _record(METADATA_INDEX, struct.pack("<QQ", record.offset, record.length), _text(record.name))


def statistics(record: Statistics) -> bytes:
    """How much a file holds."""
    return _record(
        STATISTICS,
        struct.pack("<QHIIII", record.messages, record.schemas, record.channels, record.attachments, record.metadata,
                    record.chunks),
        struct.pack("<QQ", record.begin, record.end),
        _numbers(record.counts),
    )  # fmt: skip


def data_end() -> bytes:
    """The end of the data, without a checksum of all of them, as ROS's and MCAP's own writers have it."""
    return _record(DATA_END, struct.pack("<I", 0))


def summary(groups: Sequence[tuple[int, bytes]], at: int) -> bytes:
    """All that follows the data but for the magic: groups of records, where each is, and the footer.

    Args:
        groups: what records are, and those, packed.
        at: where in the file they will stand.
    """
    parts = [data for _, data in groups]
    offsets, begin = [], at
    for kind, data in groups:
        if data:
            offsets.append(_record(SUMMARY_OFFSET, struct.pack("<BQQ", kind, begin, len(data))))
        begin += len(data)
    body = b"".join(parts + offsets)
    foot = PREFIX.pack(FOOTER, 20) + struct.pack("<QQ", at if body else 0, begin if offsets else 0)
    return body + foot + struct.pack("<I", zlib.crc32(foot, zlib.crc32(body)))


def _record(kind: int, *parts: bytes | memoryview) -> bytes:
    return b"".join((PREFIX.pack(kind, sum(map(len, parts))), *parts))


def _text(text: str) -> bytes:
    data = text.encode("utf-8", "replace")
    return struct.pack("<I", len(data)) + data


def _words(words: Mapping[str, str]) -> bytes:
    packed = b"".join(_text(key) + _text(value) for key, value in words.items())
    return struct.pack("<I", len(packed)) + packed


def _numbers(numbers: Mapping[int, int]) -> bytes:
    packed = b"".join(struct.pack("<HQ", *item) for item in numbers.items())
    return struct.pack("<I", len(packed)) + packed
