"""What a file says of itself beside its summary: where messages are within chunks, and a checksum of all the data.

Robo reads a file without either; other tools do not.
"""

import struct
from array import array
from itertools import chain

from robo.bag.mcap import format as mcap
from robo.bag.mcap.index import Index
from robo.bag.mcap.source import Place, Source

_MOST = 1_000_000
"""Messages of a channel in a chunk whose order is looked at."""


def untrue(source: Source, seen: Index) -> str:
    """What is untrue of it, in words; empty where nothing is.

    Args:
        source: the file, of which a scan has found nothing wrong.
        seen: what that has found.

    Raises:
        DamagedBag: it has changed meanwhile.
    """
    there: dict[int, array[int]] = {}
    said: set[int] = set()
    chunk: Place | None = None
    for place in chain(source.places(len(mcap.MAGIC), seen.data_end), (None,)):
        if place is not None and place.kind == mcap.MESSAGE_INDEX and chunk is not None:
            content = source.content(place)
            channel = int.from_bytes(content[:2], "little")
            if channel in said or not _same(there.get(channel, array("Q")), content[6:]):
                return f"an index says that other messages are in the chunk at byte {chunk.offset:,}"
            said.add(channel)
            continue
        if chunk is not None and said and said != there.keys():
            return f"an index leaves out a topic of the chunk at byte {chunk.offset:,}"
        chunk, there, said = None, {}, set()
        if place is not None and place.kind == mcap.CHUNK:
            chunk, there = place, _entries(source, place)
    return _untrue_checksum(source, seen.data_end)


def _entries(source: Source, place: Place) -> "dict[int, array[int]]":
    """Time and place of each message, in turn, by channel."""
    found: dict[int, array[int]] = {}
    head = mcap.WHOLE_MESSAGE_HEAD.size
    for row in mcap.rows(source.restored(place, source.chunk(place))):
        entries = found.setdefault(row.channel, array("Q"))
        entries.append(row.arrived)
        entries.append(row.begin - head)
    return found


def _same(there: "array[int]", said: bytes) -> bool:
    """Whether an index says what is there, in whatever order."""
    packed = struct.pack(f"<{len(there)}Q", *there)
    if packed == said or len(packed) != len(said):
        return packed == said
    pairs = struct.Struct("<QQ")
    return len(said) < _MOST * pairs.size and sorted(pairs.iter_unpack(said)) == sorted(pairs.iter_unpack(packed))


def _untrue_checksum(source: Source, data_end: int) -> str:
    place = source.place(data_end)
    crc = int.from_bytes(source.content(place)[:4], "little") if place.kind == mcap.DATA_END else 0
    return "the data have another checksum than the file says" if crc and source.checksum(0, data_end) != crc else ""
