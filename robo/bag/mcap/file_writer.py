"""One MCAP file, written from its first byte to its last: chunks with their indexes, and a summary at the end."""

import zlib
from collections.abc import Iterable
from typing import Final, Protocol

from robo.bag.mcap import format as mcap
from robo.bag.mcap import packing
from robo.bag.mcap.compression import Compress
from robo.bag.mcap.format import MESSAGE, MESSAGE_HEAD, WHOLE_MESSAGE_HEAD

PROFILE: Final = "ros2"
LIBRARY: Final = "robo"
CHUNK_SIZE: Final = 2**20
"""Of a chunk before it is compressed, bytes."""

_HEAD_SIZE = WHOLE_MESSAGE_HEAD.size
_CONTENT_HEAD = MESSAGE_HEAD.size
_pack_head = WHOLE_MESSAGE_HEAD.pack


class Output(Protocol):
    """What is written to: an unbuffered file."""

    def write(self, data: bytes | memoryview, /) -> int | None:
        """Write as much of it as can be written at once."""


class FileWriter:
    """Writes an MCAP file. Whoever closes the output does so after `finish`."""

    def __init__(
        self,
        output: Output,
        compression: str = "",
        compress: Compress | None = None,
        chunk_size: int = CHUNK_SIZE,
        profile: str = PROFILE,
    ) -> None:
        """
        Args:
            output: the file, empty.
            compression: what MCAP calls it; empty for none.
            compress: does it.
            chunk_size: of a chunk before it is compressed, bytes.
            profile: what topics and messages are like.
        """
        self._output = output
        self._compression = compression
        self._compress = compress
        self._chunk_size = chunk_size
        self.size = 0
        """Bytes that were written; a chunk that has not ended is not among them."""
        self._schemas: dict[int, mcap.Schema] = {}
        self._channels: dict[int, mcap.Channel] = {}
        self._counts: dict[int, int] = {}
        self._begin, self._end = 2**64, 0
        self._chunk_indexes = bytearray()
        self._chunks = 0
        self._attachments: list[mcap.AttachmentIndex] = []
        self._metadata: list[mcap.MetadataIndex] = []
        self._start_chunk()
        self._write(mcap.MAGIC + packing.header(mcap.Header(profile, LIBRARY)))

    def _start_chunk(self) -> None:
        self._parts: list[bytes | memoryview] = []
        self._filled = 0
        self._index: dict[int, list[int]] = {}
        self._chunk_begin, self._chunk_end = 2**64, 0

    @property
    def waiting(self) -> int:
        """Bytes of the chunk that has not ended."""
        return self._filled

    def add_schema(self, schema: mcap.Schema) -> None:
        """Say what messages look like, unless that was said."""
        if schema.id not in self._schemas:
            self._schemas[schema.id] = schema
            self._add(packing.schema(schema))

    def add_channel(self, channel: mcap.Channel) -> None:
        """Say a topic, after its schema, unless that was said."""
        if channel.id not in self._channels:
            self._channels[channel.id] = channel
            self._counts.setdefault(channel.id, 0)
            self._add(packing.channel(channel))

    def add_message(self, channel: int, sequence: int, arrived: int, published: int, data: bytes | memoryview) -> None:
        """Add a message of a channel that was said; a chunk that is full then is written.

        Args:
            channel: its number.
            sequence: 32 bits.
            arrived, published: 64 bits, ns.
            data: of the message.
        """
        size = len(data)
        self._parts.append(_pack_head(MESSAGE, size + _CONTENT_HEAD, channel, sequence, arrived, published))
        self._parts.append(data)
        index = self._index.get(channel)
        if index is None:
            index = self._index[channel] = []
        index.append(arrived)
        index.append(self._filled)
        self._filled += size + _HEAD_SIZE
        if arrived < self._chunk_begin:
            self._chunk_begin = arrived
        if arrived > self._chunk_end:
            self._chunk_end = arrived
        if self._filled >= self._chunk_size:
            self.end_chunk()

    def end_chunk(self) -> None:
        """Write what has come since the last chunk."""
        if not self._parts:
            return
        data = b"".join(self._parts)
        begin, end, index = self._chunk_begin, self._chunk_end, self._index
        self._start_chunk()
        crc, size = zlib.crc32(data), len(data)
        packed = data if self._compress is None else self._compress(data)
        if begin > end:  # schemas and channels alone
            begin, end = 0, 0
        head = packing.chunk_head(begin, end, size, crc, self._compression, len(packed))
        self._put_chunk(head, packed, begin, end, self._compression, size, index)

    def copy_chunk(self, chunk: mcap.Chunk, records: bytes | memoryview) -> None:
        """Write a chunk of another file as it is, with an index made anew; its schemas and channels have to be known.

        Args:
            chunk: as it is.
            records: what is in it, restored.

        Raises:
            Malformed: those make no sense.
        """
        self.end_chunk()
        index: dict[int, list[int]] = {}
        begin, end = 2**64, 0
        for row in mcap.rows(records):
            index.setdefault(row.channel, []).extend((row.arrived, row.begin - _HEAD_SIZE))
            begin, end = min(begin, row.arrived), max(end, row.arrived)
        if begin > end:
            begin, end = 0, 0
        crc = chunk.crc or zlib.crc32(records)
        head = packing.chunk_head(begin, end, chunk.size, crc, chunk.compression, len(chunk.data))
        self._put_chunk(head, chunk.data, begin, end, chunk.compression, chunk.size, index)

    def know(self, schemas: Iterable[mcap.Schema], channels: Iterable[mcap.Channel]) -> None:
        """Schemas and channels that chunks to be copied say."""
        self._schemas.update((schema.id, schema) for schema in schemas)
        for channel in channels:
            self._channels[channel.id] = channel
            self._counts.setdefault(channel.id, 0)

    def add_attachment(self, arrived: int, created: int, name: str, media_type: str, data: bytes) -> None:
        """Write a file within the file; times are ns."""
        self.end_chunk()
        record = packing.attachment(arrived, created, name, media_type, data)
        self._attachments.append(
            mcap.AttachmentIndex(self.size, len(record), arrived, created, len(data), name, media_type)
        )
        self._write(record)

    def add_metadata(self, name: str, words: dict[str, str]) -> None:
        """Write words about the recording."""
        self.end_chunk()
        record = packing.metadata(mcap.Metadata(name, words))
        self._metadata.append(mcap.MetadataIndex(self.size, len(record), name))
        self._write(record)

    def finish(self) -> None:
        """Write the summary: the file is whole."""
        self.end_chunk()
        self._write(packing.data_end())
        messages = sum(self._counts.values())
        statistics = mcap.Statistics(
            messages,
            len(self._schemas),
            len(self._channels),
            len(self._attachments),
            len(self._metadata),
            self._chunks,
            self._begin if messages else 0,
            self._end,
            self._counts,
        )
        groups = [
            (mcap.SCHEMA, b"".join(map(packing.schema, self._schemas.values()))),
            (mcap.CHANNEL, b"".join(map(packing.channel, self._channels.values()))),
            (mcap.STATISTICS, packing.statistics(statistics)),
            (mcap.CHUNK_INDEX, bytes(self._chunk_indexes)),
            (mcap.ATTACHMENT_INDEX, b"".join(map(packing.attachment_index, self._attachments))),
            (mcap.METADATA_INDEX, b"".join(map(packing.metadata_index, self._metadata))),
        ]
        self._write(packing.summary(groups, self.size) + mcap.MAGIC)

    def _add(self, record: bytes) -> None:
        self._parts.append(record)
        self._filled += len(record)

    def _put_chunk(
        self,
        head: bytes,
        data: bytes | memoryview,
        begin: int,
        end: int,
        compression: str,
        size: int,
        index: dict[int, list[int]],
    ) -> None:
        offset, length = self.size, len(head) + len(data)
        at = offset + length
        where: dict[int, int] = {}
        indexes = []
        for channel, entries in index.items():
            where[channel] = at
            record = packing.message_index(channel, entries)
            at += len(record)
            indexes.append(record)
        self._write(head, data, b"".join(indexes))
        self._chunk_indexes += packing.chunk_index(
            mcap.ChunkIndex(begin, end, offset, length, where, at - offset - length, compression, len(data), size)
        )
        self._chunks += 1
        for channel, entries in index.items():
            self._counts[channel] = self._counts.get(channel, 0) + len(entries) // 2
        if index:
            self._begin, self._end = min(self._begin, begin), max(self._end, end)

    def _write(self, *parts: bytes | memoryview) -> None:
        for part in parts:
            left = memoryview(part)
            while left:
                left = left[self._output.write(left) or 0 :]
        self.size += sum(map(len, parts))
