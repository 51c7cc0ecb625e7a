"""What the lidars LD06 and LD19 of LDROBOT say: bytes, packets and whole turns, without a port, Zenoh or a clock.

By their development manuals: 230400 baud, and nothing is ever sent to them. A packet has 47 bytes, little-endian: 0x54,
0x2C, the speed in °/s, the first point's angle in 0.01°, 12 points of a distance in mm and an intensity, the last
point's angle, a time in ms that begins anew after 30 s, and a CRC-8 of all that (polynomial 0x4D). The points of a
packet lie evenly between its two angles. Angles count clockwise, from the front.
"""

import math
import struct
from typing import Literal, NamedTuple

from robo_messages import Header, LaserScan

BAUD = 230_400
POINTS = 12
"""In a packet."""
LENGTH = 47
"""Of a packet, bytes."""
CLOCK = 30.0
"""After how long the time of packets begins anew, s."""
POINT_RATE = 4500
"""Points per second, however fast it turns."""

_HEAD = b"\x54\x2c"
_PACKET = struct.Struct("<2sHH36sHHB")
_POINT = struct.Struct("<HB")

_MOST_SPAN = 30.0
"""A packet with its two angles further apart is none, °: 12 points are 12.5° at 13 turns a second."""
_MOST_SPEED = 20 * 360
"""°/s; they turn 5 to 13 times a second."""

_NOTHING_READ = -1.0

MOST_GAP = 30.0
"""A turn that says nothing of more than this in a row is none, °: three packets are 29° at ten turns a second."""


def _table(polynomial: int) -> bytes:
    """The remainders of a CRC-8, most significant bit first, for each byte."""
    remainders = bytearray()
    for value in range(256):
        for _ in range(8):
            value = (value << 1) ^ polynomial if value & 0x80 else value << 1
        remainders.append(value & 0xFF)
    return bytes(remainders)


_CRC = _table(0x4D)


def crc8(data: bytes) -> int:
    """The checksum of a packet's bytes."""
    remainder = 0
    for byte in data:
        remainder = _CRC[remainder ^ byte]
    return remainder


class Packet(NamedTuple):
    """Twelve points."""

    speed: float
    """Turns per second."""
    start: float
    """Angle of the first point, clockwise from the front, °, in [0, 360)."""
    span: float
    """From the first point to the last one, °."""
    time: float
    """By the lidar's clock, s, in [0, 65.6)."""
    distances: tuple[float, ...]
    """m; 0 where nothing was measured."""
    intensities: tuple[int, ...]
    """0 to 255."""


def encode(packet: Packet) -> bytes:
    """The bytes of a packet."""
    points = b"".join(map(_POINT.pack, (round(1e3 * d) for d in packet.distances), packet.intensities))
    end = (packet.start + packet.span) % 360.0
    body = _PACKET.pack(
        _HEAD, round(packet.speed * 360), round(packet.start * 100) % 36_000, points,
        round(end * 100) % 36_000, round(packet.time * 1e3), 0,
    )[:-1]  # fmt: skip
    return body + bytes((crc8(body),))


class LdDecoder:
    """Makes packets of bytes, however they are cut into pieces; finds the next packet behind what is none."""

    def __init__(self) -> None:
        self._rest = b""
        self.packets = 0
        """Those that were read."""
        self.crc_faults = 0
        """Packets whose checksum was wrong, or that say what no lidar can mean."""
        self.skipped = 0
        """Bytes that were no packet."""
        self.unread = b""
        """The last of those, up to a packet's length."""

    def feed(self, data: bytes) -> list[Packet]:
        """The packets that are complete; at most a packet's length is kept for the next piece."""
        data = self._rest + data
        packets: list[Packet] = []
        at = 0
        while True:
            begin = data.find(_HEAD, at)
            if begin < 0:
                left = data[at:]
                self._rest = left[-1:] if left.endswith(_HEAD[:1]) else b""  # its second byte may come yet
                self._skip(left.removesuffix(self._rest))
                return packets
            self._skip(data[at:begin])
            if begin + LENGTH > len(data):
                self._rest = data[begin:]
                return packets
            raw = data[begin : begin + LENGTH]
            packet = _decoded(raw) if crc8(raw) == 0 else None  # with its CRC, a packet has the remainder 0
            if packet is None:
                self.crc_faults += 1
                self._skip(data[begin : begin + len(_HEAD)])
                at = begin + len(_HEAD)  # a true packet may begin within what only looked like one
            else:
                packets.append(packet)
                self.packets += 1
                at = begin + LENGTH

    def forget(self) -> None:
        """What comes next is another stream: the beginning of a packet is dropped."""
        self._rest = b""

    def _skip(self, data: bytes) -> None:
        self.skipped += len(data)
        if data:
            self.unread = (self.unread + data[-LENGTH:])[-LENGTH:]


def _decoded(raw: bytes) -> Packet | None:
    """The packet of bytes whose checksum holds; None for what no lidar can mean."""
    _, speed, start, points, end, time, _ = _PACKET.unpack(raw)
    span = (end - start) % 36_000 / 100
    if start >= 36_000 or end >= 36_000 or span > _MOST_SPAN or speed > _MOST_SPEED:
        return None
    both = list(_POINT.iter_unpack(points))
    distances = tuple(distance * 1e-3 for distance, _ in both)
    return Packet(speed / 360, start / 100, span, time * 1e-3, distances, tuple(each for _, each in both))


class Turn(NamedTuple):
    """What was seen in one turn, by even rays that go counter-clockwise from the back."""

    distances: list[float]
    """m, one per ray; 0 where the lidar measured nothing, and -1 where it said nothing of this direction."""
    intensities: list[float]
    speed: float
    """Turns per second."""
    time: float
    """When its last point was measured, by the lidar's clock, s."""


class Turns:
    """Makes turns of packets.

    A turn begins and ends at the back, where the rays of a `LaserScan` do. Where several points fall into a ray, the
    nearest counts. A turn of which more than a half is missing is none, nor is one of which more than `MOST_GAP` in a
    row is, or whose beginning was not seen.
    """

    def __init__(self, rays: int) -> None:
        """`rays`: of a full turn."""
        self._rays = rays
        self._before: Packet | None = None
        self.incomplete = 0
        """Turns that were left out since too much of them is missing."""
        self._phase = 0.0
        self._begin(seen=False)

    def forget(self) -> None:
        """What comes next is another stream: the present turn is none."""
        self._before = None
        self._begin(seen=False)

    def take(self, packet: Packet) -> Turn | None:
        """Take a packet. Returns the turn that has ended in it."""
        if self._before is not None and not self._follows(packet):
            self.incomplete += self._seen
            self._begin(seen=False)
            self._before = None
        step = packet.span / (POINTS - 1)
        ended = None
        for index, (distance, intensity) in enumerate(zip(packet.distances, packet.intensities, strict=True)):
            phase = (packet.start + index * step - 180.0) % 360.0  # 0 at the back, clockwise
            if self._before is not None and phase < self._phase - 180.0:
                ended = self._ended(packet, time=packet.time - (POINTS - 1 - index) / POINT_RATE)
                self._begin(seen=True)
            self._phase, self._before = phase, packet
            self._put(phase, distance, float(intensity))
            self._swept += step
        self._speeds += packet.speed
        self._count += 1
        return ended

    def _begin(self, *, seen: bool) -> None:
        self._seen = seen
        """Whether it is seen from its beginning."""
        self._swept = 0.0
        self._speeds = 0.0  # no list: a lidar that is stuck never ends a turn
        self._count = 0
        self._distances = [_NOTHING_READ] * self._rays
        self._intensities = [0.0] * self._rays

    def _follows(self, packet: Packet) -> bool:
        """Whether less than half a turn lies between the last packet and this one."""
        assert self._before is not None
        elapsed = (packet.time - self._before.time) % CLOCK
        return elapsed * max(packet.speed, self._before.speed) < 0.5

    def _put(self, phase: float, distance: float, intensity: float) -> None:
        # Clockwise from the back is what counter-clockwise from the back, at -π, has at its other end.
        ray = round((360.0 - phase) / 360.0 * self._rays) % self._rays
        there = self._distances[ray]
        if there <= 0.0 < distance or there < 0.0 or 0.0 < distance < there:
            self._distances[ray], self._intensities[ray] = distance, intensity

    def _ended(self, packet: Packet, time: float) -> Turn | None:
        if not self._seen:
            return None
        speed = self._speeds / self._count if self._count else packet.speed
        if self._swept < 180.0 or speed <= 0.0 or _longest_gap(self._distances) * 360.0 > MOST_GAP * self._rays:
            self.incomplete += 1
            return None
        return Turn(self._distances, self._intensities, speed, time)


def _longest_gap(distances: list[float]) -> int:
    """How many rays in a row nothing was said of; all the way round."""
    longest = gap = 0
    for distance in distances * 2:  # a gap over the back is one
        gap = gap + 1 if distance == _NOTHING_READ else 0
        longest = max(longest, gap)
    return min(longest, len(distances))


def laser_scan(
    turn: Turn,
    header: Header,
    range_min: float,
    range_max: float,
    no_return: Literal["nan", "inf"] = "nan",
    *,
    inverted: bool = False,
) -> LaserScan:
    """A turn as a message.

    REP-117: -inf is too near, +inf beyond `range_max`, NaN no measurement. The lidar turns clockwise, so that the first
    ray is measured last: `time_increment` is negative, but for a lidar that is upside down.

    Args:
        turn: what was seen.
        header: when ray 0 was measured, which is the end of the turn, or its beginning where it is inverted; and the
            lidar's frame.
        range_min: the lidar measures nothing nearer, m.
        range_max: and nothing further, m.
        no_return: what a measured 0 becomes, by which a lidar tells that nothing came back.
        inverted: it hangs upside down, with its front where it was.
    """
    distances, intensities, sense = turn.distances, turn.intensities, -1.0
    if inverted:  # what was at an angle is at its negative, of which -π is itself
        distances, intensities = distances[:1] + distances[:0:-1], intensities[:1] + intensities[:0:-1]
        sense = 1.0
    rays = len(distances)
    nothing = math.nan if no_return == "nan" else math.inf

    def as_range(distance: float) -> float:
        if distance <= 0.0:
            return nothing if distance == 0.0 else math.nan
        if distance < range_min:
            return -math.inf
        return distance if distance <= range_max else math.inf

    increment = math.tau / rays
    return LaserScan(
        header=header,
        angle_min=-math.pi,
        angle_max=-math.pi + (rays - 1) * increment,
        angle_increment=increment,
        time_increment=sense / turn.speed / rays,
        scan_time=1.0 / turn.speed,
        range_min=range_min,
        range_max=range_max,
        ranges=[as_range(distance) for distance in distances],
        intensities=intensities,
    )
