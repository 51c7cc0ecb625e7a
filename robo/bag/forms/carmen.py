"""CARMEN logs: reading them line by line, keeping what is good and naming what is not.

PARAM name value host timestamp
ODOM x y theta tv rv accel ipc_timestamp host logger_timestamp
FLASER n r1 … rn x y theta odom_x odom_y odom_theta ipc_timestamp host logger_timestamp
"""

import gzip
import math
import zlib
from collections.abc import Callable, Iterable, Iterator
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import BinaryIO, Literal

import msgspec

from robo.errors import RoboError, UnreadableFile
from robo.text.brief import shown
from robo.text.files import open_regular
from robo_messages import (
    Header,
    LaserScan,
    Odometry,
    Point,
    Pose,
    PoseWithCovariance,
    Quaternion,
    Time,
    Twist,
    TwistWithCovariance,
    Vector3,
)

_NANO = 10**9
_MOST_SECONDS = 2**31
_MOST_LINE = 2**20
"""Bytes: a scan of 360 rays has 3,000."""


class LogError(RoboError):
    """A log cannot be opened."""


class Motion(msgspec.Struct, frozen=True):
    """An ODOM record."""

    line: int
    time: int
    """ns, the record's ipc_timestamp."""
    x: float
    """m."""
    y: float
    """m."""
    theta: float
    """rad."""
    linear: float
    """m/s."""
    angular: float
    """rad/s."""


class Scan(msgspec.Struct, frozen=True):
    """A FLASER record."""

    line: int
    time: int
    """ns, the record's ipc_timestamp."""
    ranges: list[float]
    """m, over 180° from right to left."""
    estimate: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Where the laser was, m, m and rad: a mapping tool's estimate where one has gone over the log."""


class LaserOffset(msgspec.Struct, frozen=True):
    """A PARAM record that says where the laser in front stands on the base."""

    line: int
    part: Literal["x", "y", "yaw"]
    value: float
    """m, or rad."""


class MalformedLog(msgspec.Struct, frozen=True):
    """A line that is cut short or makes no sense."""

    line: int
    reason: str


class Rewritten(msgspec.Struct, frozen=True):
    """An ODOM record of time 0 that is not the log's first record: a mapping tool wrote it."""

    line: int


Record = Motion | Scan | LaserOffset | MalformedLog | Rewritten

_OFFSETS: dict[bytes, Literal["x", "y", "yaw"]] = {
    b"robot_frontlaser_offset": "x",
    b"robot_frontlaser_side_offset": "y",
    b"robot_frontlaser_angular_offset": "yaw",
}


def read(path: str | Path) -> Iterator[Record]:
    """The records of a log file, plain or gzip, in file order. Lines of other kinds are passed over.

    A file that is cut short yields what is before the cut and a `Malformed` for its end.

    Raises:
        LogError: it cannot be opened.
    """
    try:
        raw = open_regular(path)
    except UnreadableFile as error:
        raise LogError(f"log {path} cannot be opened: {error}") from None
    with raw:
        zipped = raw.read(2) == b"\x1f\x8b"
        raw.seek(0)
        stream = gzip.GzipFile(fileobj=raw) if zipped else raw
        yield from records(_lines(stream))


def records(lines: Iterable[bytes | MalformedLog]) -> Iterator[Record]:
    """The records of lines, numbered from 1."""
    first = True
    for number, line in enumerate(lines, start=1):
        if isinstance(line, MalformedLog):
            yield line
            continue
        fields = line.split()
        read_one = _reader_of(fields)
        if read_one is None:
            continue
        record: Record
        try:
            record = read_one(number, fields)
        except _Bad as reason:
            record = MalformedLog(number, str(reason))
        # Exactly 0: real logs also hold times like 1e-42, which rounding would turn into 0 as well.
        if isinstance(record, Motion) and float(fields[7]) == 0.0 and not first:
            record = Rewritten(number)
        first = first and isinstance(record, LaserOffset)
        yield record


def odometry(motion: Motion, odom_frame: str, base_frame: str) -> Odometry:
    """An ODOM record as a message."""
    return Odometry(
        Header(Time.from_nanoseconds(motion.time), odom_frame),
        base_frame,
        PoseWithCovariance(Pose(Point(motion.x, motion.y), turn(motion.theta))),
        TwistWithCovariance(Twist(Vector3(x=motion.linear), Vector3(z=motion.angular))),
    )


def laser_scan(scan: Scan, frame: str, range_max: float) -> LaserScan:
    """A FLASER record as a message: a field of 180° centred on x, the first ray on the right."""
    count = len(scan.ranges)
    return LaserScan(
        Header(Time.from_nanoseconds(scan.time), frame),
        angle_min=-math.pi / 2,
        angle_max=math.pi / 2,
        angle_increment=math.pi / (count - 1) if count > 1 else 0.0,
        range_max=range_max,
        ranges=scan.ranges,
    )


def turn(yaw: float) -> Quaternion:
    """A turn about z, which may be many times around, as a unit quaternion."""
    half = math.remainder(yaw, math.tau) / 2
    half = math.pi / 2 if half == -math.pi / 2 else half  # from (-π, π], so that each turn is written in one way
    return Quaternion(0.0, 0.0, math.sin(half), math.cos(half))


class _Bad(Exception):
    pass


def _lines(stream: BinaryIO | gzip.GzipFile) -> Iterator[bytes | MalformedLog]:
    number = 0
    try:
        while line := stream.readline(_MOST_LINE):
            number += 1
            if len(line) < _MOST_LINE or line.endswith(b"\n"):
                yield line
                continue
            while (rest := stream.readline(_MOST_LINE)) and not rest.endswith(b"\n"):
                pass  # a small file may unfold to a line without end
            yield MalformedLog(number, f"the line has more than {_MOST_LINE:,} bytes")
    except (EOFError, zlib.error, gzip.BadGzipFile, OSError) as error:
        yield MalformedLog(number + 1, f"the file is cut short or damaged here ({error})")


def _reader_of(fields: list[bytes]) -> Callable[[int, list[bytes]], Record] | None:
    """What reads a record of this kind; None where it is passed over."""
    match fields:
        case [b"ODOM", *_]:
            return _odom
        case [b"FLASER", *_]:
            return _flaser
        case [b"PARAM", name, *_] if name in _OFFSETS:
            return _laser_offset
    return None


def _laser_offset(line: int, fields: list[bytes]) -> LaserOffset:
    if len(fields) < 3:
        raise _Bad(f"PARAM {fields[1].decode()} has no value")
    (value,) = _numbers(fields[2:3])
    return LaserOffset(line, _OFFSETS[fields[1]], value)


def _odom(line: int, fields: list[bytes]) -> Motion:
    if len(fields) != 10:
        raise _Bad(f"ODOM takes 9 values, this line has {len(fields) - 1}")
    x, y, theta, linear, angular, _ = _numbers(fields[1:7])
    return Motion(line, _time(fields[7], fields[9]), x, y, theta, linear, angular)


def _flaser(line: int, fields: list[bytes]) -> Scan:
    count_text = fields[1] if len(fields) > 1 else b""
    if not (count_text.isdigit() and len(count_text) < 10 and int(count_text) > 0):
        raise _Bad(f"FLASER begins with its number of ranges, not {_text(count_text)}")
    count = int(count_text)
    if len(fields) != count + 11:
        raise _Bad(f"FLASER of {count} ranges takes {count + 10} values, this line has {len(fields) - 1}")
    ranges = _numbers(fields[2 : count + 2])
    x, y, theta, *_ = _numbers(fields[count + 2 : count + 8])
    return Scan(line, _time(fields[-3], fields[-1]), ranges, (x, y, theta))


def _numbers(fields: list[bytes]) -> list[float]:
    try:
        values = list(map(float, fields))
    except ValueError:
        values = []
    if len(values) == len(fields) and all(map(math.isfinite, values)):
        return values
    bad = next(f for f in fields if not _is_finite(f))
    raise _Bad(f"{_text(bad)} is no finite number")


def _is_finite(field: bytes) -> bool:
    try:
        return math.isfinite(float(field))
    except ValueError:
        return False


def _time(field: bytes, logger: bytes) -> int:
    """A time as ns, exact to its last digit; a float would round times since the epoch."""
    _numbers([field, logger])
    try:
        seconds = Decimal(field.decode("ascii"))
    except (UnicodeDecodeError, InvalidOperation):
        raise _Bad(f"{_text(field)} is no time") from None
    if not -_MOST_SECONDS <= seconds < _MOST_SECONDS:
        raise _Bad(f"time {_text(field)} is out of range")
    return int((seconds * _NANO).to_integral_value())


def _text(field: bytes) -> str:
    return shown(field.decode("ascii", "replace"), 22)
