"""Recordings for tests: small ones in all forms that MCAP knows, and ones that somebody has damaged."""

import random
import struct
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import msgspec

from robo import bag
from robo.bag import offered
from robo.bag.mcap import format as mcap
from robo.bag.mcap import packing
from robo.bag.mcap.compression import CannotRestore, restored
from robo.bag.mcap.file_writer import FileWriter
from robo.bag.mcap.format import MESSAGE, PREFIX, WHOLE_MESSAGE_HEAD
from robo.bag.types import topic_of
from robo.interfaces import cdr
from robo.wire.qos import QoS
from robo_messages import Header, LaserScan, Odometry, TFMessage, Time, TransformStamped, Twist, Vector3

START = 1_700_000_000_000_000_000
"""When these recordings begin, ns since the epoch."""
MS = 1_000_000

Chunk = tuple[str, Callable[[bytes], bytes]]


def twist(x: float) -> bytes:
    """A command as it stands in a recording."""
    return cdr.encoder(Twist)(Twist(Vector3(x=x)))


def transform(frame: str) -> bytes:
    """A static transform to a frame as it stands in a recording."""
    return cdr.encoder(TFMessage)(TFMessage([TransformStamped(Header(frame_id="base_link"), frame)]))


def drive(
    path: Path, options: bag.Options | None = None, count: int = 100, missing: Iterable[int] = (), start: int = START
) -> None:
    """Record a short drive: a command each 10 ms, a scan each 100, what is static once."""
    leave_out = set(missing)
    with bag.Recording(
        path, options if options is not None else bag.Options(compression="none", sync=False)
    ) as recording:
        static = recording.topic(topic_of("r1/tf_static", TFMessage, QoS.LATCHED))
        commands = recording.topic(topic_of("r1/cmd_vel", Twist))
        scans = recording.topic(topic_of("r1/scan", LaserScan, QoS.SENSOR_DATA))
        odometry = recording.topic(topic_of("r1/odom", Odometry))
        recording.attach("manifest.yaml", b"nodes: {}\n", "text/yaml", start)
        recording.add_metadata("robo", {"version": "1", "robot": "r1"})
        for source in ("base", "laser"):
            recording.write(static, transform(source), start, start, 1, source)
        for number in range(count):
            at = start + number * 10 * MS
            if number not in leave_out:
                recording.write(commands, twist(number / 10), at + MS, at, number + 1, "commander")
            if number % 10 == 0:
                scan = LaserScan(Header(Time.from_nanoseconds(at), "laser"), ranges=[1.0, 2.0, float("inf")])
                recording.write(scans, cdr.encoder(LaserScan)(scan), at + 2 * MS, at, number // 10 + 1, "laser")
                where = Odometry(Header(Time.from_nanoseconds(at), "odom"), "base_link")
                where.pose.pose.position.x = number / 100
                recording.write(odometry, cdr.encoder(Odometry)(where), at + 2 * MS, at, number // 10 + 1, "base")


def of_ros(
    path: Path, topic: bag.TopicInFile, said: Iterable[tuple[int, int, int, bytes]], publishers: int = 1
) -> None:
    """A recording of one topic with several publishers, as ROS writes it.

    Args:
        path: of it.
        topic: what it is.
        said: sequence number, arrival and publishing after the beginning, ns, and data of each message.
        publishers: how many were announced.
    """
    with path.open("wb") as file:
        writer = FileWriter(file)
        writer.add_schema(mcap.Schema(1, topic.schema, "ros2msg", topic.text.encode()))
        words = {offered.OFFERED: "\n".join([offered.words_of(topic.qos)[offered.OFFERED]] * publishers)}
        writer.add_channel(mcap.Channel(1, 1, f"/{topic.name}", "cdr", words))
        for sequence, arrived, published, data in said:
            writer.add_message(1, sequence, START + arrived, START + published, data)
        writer.finish()


def records_of(data: bytes) -> Iterator[tuple[int, int, int]]:
    """What the records of a whole file are, where each begins and where it ends."""
    at = len(mcap.MAGIC)
    while at + PREFIX.size <= len(data) - len(mcap.MAGIC):
        kind, length = PREFIX.unpack_from(data, at)
        end = at + PREFIX.size + length
        yield kind, at, end
        at = end


def without_summary(data: bytes) -> bytes:
    """A whole file that has no summary."""
    end = next(at for kind, at, _ in records_of(data) if kind == mcap.DATA_END)
    return data[:end] + packing.data_end() + packing.summary([], 0) + mcap.MAGIC


def summary_without_checksum(data: bytes) -> bytes:
    """A whole file whose summary may say what it likes."""
    return data[: -len(mcap.MAGIC) - 4] + bytes(4) + mcap.MAGIC


def with_summary_changed(data: bytes, change: Callable[[int, bytes], bytes]) -> bytes:
    """A whole file with another summary, and its checksum: `change` takes what a record is and its content."""
    begin = next(end for kind, _, end in records_of(data) if kind == mcap.DATA_END)
    parts = []
    for kind, at, end in records_of(data):
        if at >= begin and kind not in (mcap.FOOTER, mcap.SUMMARY_OFFSET):
            content = change(kind, data[at + PREFIX.size : end])
            parts.append((kind, PREFIX.pack(kind, len(content)) + content))
    return data[:begin] + packing.summary(parts, begin) + mcap.MAGIC


def without_chunks(data: bytes) -> bytes:
    """A whole file whose messages stand outside of chunks, without a summary."""
    parts = [mcap.MAGIC]
    for kind, at, end in records_of(data):
        if kind == mcap.CHUNK:
            chunk = mcap.chunk(data[at + PREFIX.size : end])
            parts.append(bytes(restored(chunk.compression, chunk.data, chunk.size)))
        elif kind in (mcap.HEADER, mcap.ATTACHMENT, mcap.METADATA):
            parts.append(data[at:end])
    return b"".join([*parts, packing.data_end(), packing.summary([], 0), mcap.MAGIC])


def with_chunks(data: bytes, compression: str, compress: Callable[[bytes], bytes], crc: bool = True) -> bytes:
    """A file with its chunks compressed otherwise, without a summary and indexes."""
    parts = [mcap.MAGIC]
    for kind, at, end in records_of(data):
        if kind == mcap.CHUNK:
            chunk = mcap.chunk(data[at + PREFIX.size : end])
            plain = bytes(restored(chunk.compression, chunk.data, chunk.size))
            sum_ = chunk.crc if crc else 0
            parts.append(packing.chunk(chunk.begin, chunk.end, chunk.size, sum_, compression, compress(plain)))
        elif kind in (mcap.HEADER, mcap.ATTACHMENT, mcap.METADATA):
            parts.append(data[at:end])
    return b"".join([*parts, packing.data_end(), packing.summary([], 0), mcap.MAGIC])


def message(channel: int, sequence: int, arrived: int, published: int, data: bytes) -> bytes:
    """A message's record."""
    return WHOLE_MESSAGE_HEAD.pack(MESSAGE, 22 + len(data), channel, sequence, arrived, published) + data


def readable(compression: str) -> bool:
    """Whether a compression can be read here."""
    try:
        restored(compression, memoryview(b""), 0)
    except CannotRestore:
        return False
    except mcap.Malformed:
        pass
    return True


_LENGTHS = (0, 1, 8, 2**16, 2**31, 2**32 - 1, 2**40, 2**63, 2**64 - 1)


def damaged(data: bytes, chance: random.Random) -> bytes:
    """A file as a hostile hand, a bad disk or a power cut leaves it."""
    for _ in range(chance.choice((1, 1, 1, 2, 5))):
        data = chance.choice(_DAMAGES)(data, chance)
    return data


def _cut(data: bytes, chance: random.Random) -> bytes:
    return data[: chance.randrange(len(data) + 1)]


def _flip(data: bytes, chance: random.Random) -> bytes:
    changed = bytearray(data)
    for _ in range(chance.choice((1, 1, 2, 8, 64)) if changed else 0):
        changed[chance.randrange(len(changed))] ^= 1 << chance.randrange(8)
    return bytes(changed)


def _any_record(data: bytes, chance: random.Random) -> tuple[int, int]:
    records = list(records_of(data))
    if not records:
        return 0, len(data)
    _, begin, end = chance.choice(records)
    return begin, min(end, len(data))


def _lie(data: bytes, chance: random.Random) -> bytes:
    """A record that claims another length."""
    begin, end = _any_record(data, chance)
    length = chance.choice((*_LENGTHS, max(end - begin - 10, 0), end - begin - 8, len(data)))
    return data[: begin + 1] + struct.pack("<Q", length) + data[begin + 9 :]


def _lie_within(data: bytes, chance: random.Random) -> bytes:
    """A length or a count within a record that is another one."""
    begin, end = _any_record(data, chance)
    at = chance.randrange(begin, max(end, begin + 1))
    form = chance.choice(("<H", "<I", "<Q"))
    number = struct.pack(form, chance.choice(_LENGTHS) % 2 ** (8 * struct.calcsize(form)))
    return data[:at] + number + data[at + len(number) :]


def _other_kind(data: bytes, chance: random.Random) -> bytes:
    begin, _ = _any_record(data, chance)
    return data[:begin] + bytes([chance.randrange(20)]) + data[begin + 1 :]


def _without_record(data: bytes, chance: random.Random) -> bytes:
    begin, end = _any_record(data, chance)
    return data[:begin] + data[end:]


def _record_twice(data: bytes, chance: random.Random) -> bytes:
    begin, end = _any_record(data, chance)
    to, _ = _any_record(data, chance)
    return data[:to] + data[begin:end] + data[to:]


def _insert(data: bytes, chance: random.Random) -> bytes:
    at = chance.randrange(len(data) + 1)
    return data[:at] + chance.randbytes(chance.choice((1, 9, 100))) + data[at:]


def _without_checksum(data: bytes, chance: random.Random) -> bytes:
    """A chunk that says no checksum, and is damaged: what is in it has to be looked at."""
    chunks = [(begin, end) for kind, begin, end in records_of(data) if kind == mcap.CHUNK and end <= len(data)]
    if not chunks:
        return _flip(data, chance)
    begin, end = chance.choice(chunks)
    changed = bytearray(data)
    changed[begin + 33 : begin + 37] = bytes(4)
    for _ in range(chance.choice((1, 3, 20))):
        changed[chance.randrange(min(begin + 37, end - 1), end)] = chance.randrange(256)
    return bytes(changed)


def _change_index(data: bytes, chance: random.Random) -> bytes:
    """A summary with a checksum that leaves a channel out of a chunk, or has other times."""
    if not any(kind == mcap.CHUNK_INDEX for kind, _, end in records_of(data) if end <= len(data)):
        return _flip(data, chance)

    def change(kind: int, content: bytes) -> bytes:
        if kind != mcap.CHUNK_INDEX or chance.random() < 0.5:
            return content
        index = mcap.chunk_index(content)
        channels = {one: at for one, at in index.channels.items() if chance.random() < 0.7}
        end = index.begin if chance.random() < 0.3 else index.end
        return packing.chunk_index(msgspec.structs.replace(index, channels=channels, end=end))[PREFIX.size :]

    try:
        return with_summary_changed(data, change)
    except (mcap.Malformed, StopIteration, struct.error):
        return _flip(data, chance)


def _loose_message(data: bytes, chance: random.Random) -> bytes:
    """A message between records, in a chunk or not."""
    at, _ = _any_record(data, chance)
    return data[:at] + message(chance.randrange(1, 6), 1, START, START, twist(1)) + data[at:]


def _same_name(data: bytes, chance: random.Random) -> bytes:
    """Topics with the same name, or one that differs in slashes."""
    names = (b"/r1/odom", b"/r1/scan", b"//r1/odm", b"/r1/scan")
    return data.replace(chance.choice(names[:2]), chance.choice(names))


_DAMAGES = (
    _cut, _flip, _lie, _lie, _lie_within, _lie_within, _other_kind, _without_record, _record_twice, _insert,
    _without_checksum, _without_checksum, _change_index, _loose_message, _same_name,
)  # fmt: skip


def with_bomb(data: bytes, compression: str, compress: Callable[[bytes], bytes], size: int) -> bytes:
    """A file with a chunk more, of zeros, that says to be as large as it is; no larger than 268 MB in truth."""
    packed = compress(bytes(min(size, 2**28)))
    bomb = packing.chunk(START, START + MS, size, 0, compression, packed)
    end = next(at for kind, at, _ in records_of(data) if kind == mcap.DATA_END)
    return data[:end] + bomb + packing.data_end() + packing.summary([], 0) + mcap.MAGIC
