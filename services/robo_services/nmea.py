"""What a receiver of satellites says by NMEA 0183: bytes, sentences, positions and velocities, without a port or Zenoh.

A sentence is taken only if its checksum holds, each of its numbers is written as a number, and what they say can be.
"""

import importlib
import math
import re
from datetime import UTC, datetime
from functools import reduce
from operator import xor
from typing import Any, NamedTuple

from robo.errors import RunError
from robo_messages import Header, NavSatFix, NavSatStatus, Time

MOST = 256
"""The longest sentence that is read, bytes. The standard has 82; receivers say more."""

KNOT = 1852.0 / 3600.0
"""m/s."""

FASTEST = 600.0
"""m/s; receivers stop at 515."""

_SENTENCE = re.compile(rb"\$([!-#%-)+-~ ]+)\*([0-9A-Fa-f]{2})")
_READ = frozenset(("GGA", "RMC", "VTG", "GST"))
_NUMBER = re.compile(r"[-+]?(\d{1,9}(\.\d{0,12})?|\.\d{1,12})")
_MEASURED = frozenset(("", "A", "D", "F", "P", "R"))
"""Modes of RMC and VTG in which satellites are measured; the others reckon, simulate, or were told by hand."""
_DAY = 86_400.0

_SERVICES = {"GP": 1, "GL": 2, "GB": 4, "BD": 4, "GA": 8}
"""Bits of NavSatStatus.service by talker; GN, which is several, counts as GPS."""


class Unreadable(ValueError):
    """A sentence whose checksum holds says what cannot be; tells what."""


class NmeaLines:
    """Makes sentences of bytes, however they are cut into pieces, and whatever stands between them."""

    def __init__(self) -> None:
        self._rest = b""
        self.checksum_faults = 0
        """Lines that look like a sentence and have a wrong checksum."""
        self.unread = 0
        """Lines that are no sentence, or one with a wrong checksum."""
        self.last_unread = b""
        """The last of them, or its beginning."""

    def feed(self, data: bytes) -> list[str]:
        """The sentences that are complete and have their checksum, from `$` to `*HH`."""
        *lines, rest = re.split(rb"[\r\n]+", self._rest + data)
        sentences = [sentence for line in lines if line and (sentence := self._checked(line)) is not None]
        if len(rest) > MOST:  # no sentence is that long: none of it is kept, but for what may begin one
            self._leave(rest)
            begin = rest.rfind(b"$")
            rest = rest[begin:] if 0 <= len(rest) - begin <= MOST and begin >= 0 else b""
        self._rest = rest
        return sentences

    @property
    def has_rest(self) -> bool:
        """Whether a line has begun."""
        return bool(self._rest)

    def forget(self) -> None:
        """What comes next is another stream: the beginning of a sentence is dropped."""
        self._rest = b""

    def _checked(self, line: bytes) -> str | None:
        begin = line.rfind(b"$")  # what stands before it is the rest of something else
        match = _SENTENCE.fullmatch(line[begin:]) if begin >= 0 and len(line) - begin <= MOST else None
        if match is None:
            self._leave(line)
            return None
        if checksum(match[1]) != int(match[2], 16):
            self.checksum_faults += 1
            self._leave(line)
            return None
        return match[0].decode("ascii")

    def _leave(self, line: bytes) -> None:
        self.unread += 1
        self.last_unread = line[:MOST]


def checksum(body: bytes) -> int:
    """The checksum of what stands between `$` and `*`."""
    return reduce(xor, body, 0)


class Position(NamedTuple):
    """Where the antenna is."""

    quality: int
    """As in GGA: 0 no fix, 1 GPS, 2 differential, 4 RTK, 5 RTK float, 9 WAAS."""
    latitude: float = math.nan
    """°, north positive; NaN without a fix."""
    longitude: float = math.nan
    """°, east positive."""
    altitude: float = math.nan
    """m above the ellipsoid; NaN where it is not said."""
    hdop: float = math.nan
    """Dilution of the horizontal precision; NaN where it is not said."""
    satellites: int = 0
    service: int = 1
    """Bits, as in NavSatStatus."""
    time: float = math.nan
    """s of the day, UTC."""


class Velocity(NamedTuple):
    """Over ground, m/s."""

    east: float
    north: float


class Errors(NamedTuple):
    """Standard deviations as the receiver says them, m."""

    east: float
    north: float
    up: float
    time: float
    """s of the day, UTC."""


class Meaning(NamedTuple):
    """What a quality of GGA means."""

    status: int
    """As in NavSatStatus."""
    epe: int
    """Of which quality its expected error is."""


_QUALITIES = {
    1: Meaning(NavSatStatus.STATUS_FIX, 1),
    2: Meaning(NavSatStatus.STATUS_SBAS_FIX, 2),
    3: Meaning(NavSatStatus.STATUS_FIX, 1),  # military GPS
    4: Meaning(NavSatStatus.STATUS_GBAS_FIX, 4),
    5: Meaning(NavSatStatus.STATUS_GBAS_FIX, 5),
    9: Meaning(NavSatStatus.STATUS_SBAS_FIX, 9),
}
"""Others, dead reckoning, by hand and simulated, are no fix."""


class Receiver:
    """Makes positions, velocities and times of sentences.

    GGA is where it is, RMC or else VTG how fast it moves, RMC which time it is, GST how sure it is.
    """

    def __init__(self, *, use_rmc: bool = False) -> None:
        """`use_rmc`: RMC says where it is, without altitude and covariance; GGA does not count."""
        self._use_rmc = use_rmc
        self._pynmea2 = import_pynmea2()
        self._without_rmc = MOST
        """How many VTG have come since the last RMC: where there are both, RMC counts."""
        self._without_gga = 0
        """How many RMC have come since the last GGA."""
        self._has_fix = False
        self.errors: Errors | None = None
        """Of the newest GST."""

    @property
    def has_only_rmc(self) -> bool:
        """Whether RMC says where it is, is not asked for that, and nothing else says it."""
        return not self._use_rmc and self._without_gga >= 4

    def take(self, sentence: str) -> list[Position | Velocity | datetime]:
        """What a sentence says; nothing for those that are of no interest.

        Raises:
            Unreadable: it says what cannot be.
        """
        kind = _kind(sentence)
        if not kind:
            return []
        fields = self._fields(sentence)
        if kind == "GGA":
            self._without_gga = 0
            return [] if self._use_rmc else [self._position(fields, sentence[1:3])]
        if kind == "RMC":
            self._without_rmc = 0
            self._without_gga += 1
            return self._recommended_minimum(fields, sentence[1:3])
        if kind == "VTG":
            self._without_rmc += 1
            return self._ground_speed(fields)
        self.errors = Errors(
            _number(fields, "std_dev_longitude", 0, 1e6),
            _number(fields, "std_dev_latitude", 0, 1e6),
            _number(fields, "std_dev_altitude", 0, 1e6),
            _time(fields["timestamp"]),
        )
        return []

    def _fields(self, sentence: str) -> dict[str, str]:
        """Its fields as they are written, by pynmea2's names."""
        try:
            read = self._pynmea2.parse(sentence, check=True)
        except self._pynmea2.ParseError as error:
            raise Unreadable(str(error)) from None
        names = [field[1] for field in read.fields]
        return dict.fromkeys(names, "") | dict(zip(names, read.data, strict=False))  # some leave out the last ones

    def _position(self, fields: dict[str, str], talker: str) -> Position:
        quality = int(_number(fields, "gps_qual", 0, 9) if fields["gps_qual"] else 0)
        time = _time(fields["timestamp"])
        satellites = _number(fields, "num_sats", 0, 99)
        satellites = 0 if math.isnan(satellites) else int(satellites)
        self._has_fix = quality in _QUALITIES
        if not self._has_fix:
            return Position(0, satellites=satellites, service=_SERVICES.get(talker, 1), time=time)
        if fields["altitude_units"] not in ("", "M") or fields["geo_sep_units"] not in ("", "M"):
            raise Unreadable("heights are in m")
        return Position(
            quality,
            *_place(fields),
            _number(fields, "altitude", -10_000, 100_000) + _number(fields, "geo_sep", -1000, 1000),
            _number(fields, "horizontal_dil", 0, 9999),
            satellites,
            _SERVICES.get(talker, 1),
            time,
        )

    def _recommended_minimum(self, fields: dict[str, str], talker: str) -> list[Position | Velocity | datetime]:
        status, time, service = fields["status"], _time(fields["timestamp"]), _SERVICES.get(talker, 1)
        if status not in ("A", "V"):
            raise Unreadable(f"a status is A or V, not {status!r}")
        if status == "V" or fields["mode_indicator"] not in _MEASURED:
            return [Position(0, service=service, time=time)] if self._use_rmc else []
        place = _place(fields)
        velocity = _velocity(fields, "spd_over_grnd", "true_course")
        said: list[Position | Velocity | datetime] = []
        if fields["datestamp"] and not math.isnan(time):
            said.append(_moment(fields["datestamp"], time))
        if self._use_rmc:
            said.append(Position(1, *place, service=service, time=time))
        return said + velocity

    def _ground_speed(self, fields: dict[str, str]) -> list[Position | Velocity | datetime]:
        units = fields["true_track_sym"], fields["spd_over_grnd_kts_sym"]
        if units[0] not in ("", "T") or units[1] not in ("", "N"):
            raise Unreadable(f"a track and knots have the signs T and N, not {units}")
        velocity = _velocity(fields, "spd_over_grnd_kts", "true_track")
        if self._use_rmc or self._without_rmc < 4 or not self._has_fix or fields["faa_mode"] not in _MEASURED:
            return []
        return velocity


def _kind(sentence: str) -> str:
    """What a sentence is, such as GGA; empty where it is of no interest, as all that makers have of their own."""
    kind = sentence[3:6]
    return kind if kind in _READ and sentence[6:7] == "," and sentence[1] != "P" else ""


def time_of(sentence: str) -> float | None:
    """When a sentence says that it is, s of the day, UTC; None for one that does not say it."""
    if _kind(sentence) not in ("GGA", "RMC", "GST"):
        return None
    try:
        seconds = _time(sentence.split(",")[1])
    except Unreadable:
        return None
    return None if math.isnan(seconds) else seconds


def nav_sat_fix(position: Position, errors: Errors | None, expected: dict[int, float], header: Header) -> NavSatFix:
    """A position as a message.

    The covariance is that of a GST of the same time, give or take 2 s, which is along the diagonal and known. Without
    one, or where it says an error of 0, it is approximated as nmea_navsat_driver does: (HDOP · e)² to the east and
    north, (4 · HDOP · e)² up. Where HDOP is not said it is unknown.

    Args:
        position: what GGA or RMC says.
        errors: what the newest GST says.
        expected: e by quality, m; for 1, 2, 4, 5 and 9.
        header: when it was said, and the antenna's frame.
    """
    meaning = _QUALITIES.get(position.quality)
    if meaning is None:
        status = NavSatStatus(NavSatStatus.STATUS_NO_FIX, position.service)
        return NavSatFix(header, status, math.nan, math.nan, math.nan)
    variances, kind = (0.0, 0.0, 0.0), NavSatFix.COVARIANCE_TYPE_UNKNOWN
    if errors is not None and _is_known(errors) and _apart(errors.time, position.time) <= 2.0:
        variances = (errors.east**2, errors.north**2, errors.up**2)
        kind = NavSatFix.COVARIANCE_TYPE_DIAGONAL_KNOWN
    elif position.hdop > 0.0:  # NaN is not
        error = position.hdop * expected[meaning.epe]
        variances = (error**2, error**2, (4.0 * error) ** 2)
        kind = NavSatFix.COVARIANCE_TYPE_APPROXIMATED
    east, north, up = variances
    return NavSatFix(
        header,
        NavSatStatus(meaning.status, position.service),
        position.latitude,
        position.longitude,
        position.altitude,
        (east, 0.0, 0.0, 0.0, north, 0.0, 0.0, 0.0, up),
        kind,
    )


def as_time(moment: datetime) -> Time:
    """A moment as a message, to the microsecond."""
    whole = moment.replace(microsecond=0)
    return Time.from_nanoseconds(int(whole.timestamp()) * 1_000_000_000 + moment.microsecond * 1000)


def import_pynmea2() -> Any:
    """The module of pynmea2.

    Raises:
        RunError: it is not installed; names the extra.
    """
    try:
        return importlib.import_module("pynmea2")
    except ImportError:
        raise RunError("NMEA needs pynmea2, which is not installed: pip install 'robo-zenoh[gps]'") from None


def _is_known(errors: Errors) -> bool:
    """Whether a receiver knows them: nobody measures without an error."""
    return all(map(math.isfinite, errors)) and min(errors[:3]) > 0.0


def _apart(a: float, b: float) -> float:
    """How far two times of a day are apart, s; over midnight too."""
    return abs(math.remainder(a - b, _DAY))


def _number(fields: dict[str, str], name: str, least: float, most: float) -> float:
    """A number; NaN where none is said."""
    text = fields[name]
    if not text:
        return math.nan
    if not _NUMBER.fullmatch(text):
        raise Unreadable(f"{name} is {text!r}, which is no number")
    value = float(text)
    if not least <= value <= most:
        raise Unreadable(f"{name} is {text}, which is not within {least:g} and {most:g}")
    return value


def _time(text: str) -> float:
    """Seconds of the day of hhmmss.ss; NaN where none is said."""
    if not text:
        return math.nan
    match = re.fullmatch(r"([01]\d|2[0-3])([0-5]\d)([0-5]\d(?:\.\d{0,9})?)", text)
    if match is None:
        raise Unreadable(f"{text!r} is no time of a day")
    return int(match[1]) * 3600.0 + int(match[2]) * 60.0 + float(match[3])


def _moment(date: str, time: float) -> datetime:
    """The moment of a date ddmmyy; GPS began in 1980."""
    if not re.fullmatch(r"\d{6}", date):
        raise Unreadable(f"{date!r} is no date")
    microseconds = round(time * 1e6)
    seconds, micro = divmod(microseconds, 1_000_000)
    hour, minute, second = seconds // 3600, seconds // 60 % 60, seconds % 60
    year = int(date[4:]) + (1900 if int(date[4:]) >= 80 else 2000)
    try:
        return datetime(year, int(date[2:4]), int(date[:2]), hour, minute, second, micro, UTC)
    except ValueError:
        raise Unreadable(f"{date!r} is no date") from None


def _place(fields: dict[str, str]) -> tuple[float, float]:
    """Latitude and longitude, °."""
    return (
        _degrees(fields["lat"], r"(\d\d)(\d\d(?:\.\d{0,12})?)", 90.0, fields["lat_dir"], "NS"),
        _degrees(fields["lon"], r"(\d\d\d)(\d\d(?:\.\d{0,12})?)", 180.0, fields["lon_dir"], "EW"),
    )


def _degrees(text: str, pattern: str, most: float, side: str, sides: str) -> float:
    match = re.fullmatch(pattern, text)
    degrees = int(match[1]) + float(match[2]) / 60.0 if match is not None and float(match[2]) < 60.0 else math.inf
    if degrees > most or len(side) != 1 or side not in sides:
        raise Unreadable(f"{text!r} {side!r} is no place on Earth")
    return degrees if side == sides[0] else -degrees


def _velocity(fields: dict[str, str], speed_name: str, course_name: str) -> list[Position | Velocity | datetime]:
    """The velocity of a speed in knots and a course in ° clockwise from north; none where one of them is not said."""
    speed = _number(fields, speed_name, 0, FASTEST / KNOT) * KNOT
    course = math.radians(_number(fields, course_name, 0, 360))
    if speed == 0.0:
        return [Velocity(0.0, 0.0)]  # who stands has no course
    if math.isnan(speed) or math.isnan(course):
        return []
    return [Velocity(speed * math.sin(course), speed * math.cos(course))]
