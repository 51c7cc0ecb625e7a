"""Drives a receiver of satellites, GPS and its like, that speaks NMEA 0183."""

import os
import stat
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Annotated, ClassVar

from msgspec import Meta

import robo
from robo import READ_ONLY, Health, Node, ParameterError, Publisher, Unit, check
from robo_messages import Header, NavSatFix, TimeReference, Twist, TwistStamped, Vector3
from robo_services.nmea import (
    NmeaLines,
    Position,
    Receiver,
    Unreadable,
    Velocity,
    as_time,
    import_pynmea2,
    nav_sat_fix,
    time_of,
)
from robo_services.serial_feed import SerialFeed, shown
from robo_services.serial_port import import_serial

SILENT_AFTER = 3.0
"""A receiver that says nothing for this long is silent, s; most say something every second."""

LONGEST_GAP = 10.0
"""A gap in a file that is longer is not waited for, s."""

SLOWEST = 1e-3
"""A file is played no slower."""

FILES = frozenset((".nmea", ".nma", ".txt", ".log", ".gps"))
"""What the names of files of sentences end with."""

_PIECE = 4096

Error = Annotated[float, Meta(ge=0, le=1e6), Unit("m")]


class NmeaGps(Node):
    """Publish what a receiver of satellites says by NMEA, from a port, or from a file where there is none.

    What has a wrong checksum, or says what cannot be, is left out and counted. A port that is not there, or is
    unplugged, is waited for. A file is played as fast as it was written, and the node ends with it.
    """

    REQUIRES: ClassVar = {"pynmea2": "robo-zenoh[gps]", "serial": "robo-zenoh[gps]"}

    class Parameters(robo.Parameters):
        """Where the receiver is, and how sure it is; names are those of ROS's nmea_navsat_driver, where it has them."""

        port: Annotated[
            str,
            Meta(min_length=1, description="its port: a path, or a USB id such as 1546:01a8; or a file of sentences"),
            READ_ONLY,
        ] = "/dev/ttyACM0"
        baud: Annotated[int, Meta(ge=300, le=4_000_000, description="bits per second of the port"), READ_ONLY] = 9600
        frame_id: Annotated[str, Meta(min_length=1, description="the antenna's frame"), READ_ONLY] = "gps"
        time_ref_source: Annotated[
            str, Meta(description="whose clock time_reference says it is; empty: frame_id"), READ_ONLY
        ] = ""
        use_rmc: Annotated[
            bool, Meta(description="RMC says where it is, and not GGA: no altitude, no covariance"), READ_ONLY
        ] = False
        epe_quality1: Annotated[Error, Meta(description="expected error of a fix, for an HDOP of 1")] = 4.0
        epe_quality2: Annotated[Error, Meta(description="the same of a differential fix")] = 0.1
        epe_quality4: Annotated[Error, Meta(description="the same of RTK")] = 0.02
        epe_quality5: Annotated[Error, Meta(description="the same of RTK float")] = 4.0
        epe_quality9: Annotated[Error, Meta(description="the same of WAAS")] = 3.0
        playback_rate: Annotated[
            float,
            Meta(ge=0, le=1e6, description="a file: 1.0 as fast as it was written, 0 as fast as it can be read"),
            READ_ONLY,
        ] = 1.0
        loop: Annotated[bool, Meta(description="a file begins anew at its end"), READ_ONLY] = False

    parameters: Parameters

    fixes = Publisher(NavSatFix, "fix")
    """Where the antenna is; without a fix NaN, with the status that says so."""
    velocities = Publisher(TwistStamped, "vel")
    """How fast it moves over ground: x to the east, y to the north."""
    times = Publisher(TimeReference, "time_reference")
    """What time it is by the satellites."""

    _feed: SerialFeed | None = None

    def on_start(self) -> None:
        """No port is open yet."""
        import_pynmea2()  # what cannot work is said at once
        p = self.parameters
        self._file = _is_file(p.port)
        if self._file and not os.access(p.port, os.R_OK):
            raise ParameterError(f"{self.full_name}: port {p.port} is a file that may not be read")
        if _would_be_file(p.port):
            raise ParameterError(f"{self.full_name}: port {p.port}: there is no such file")
        if not self._file:
            import_serial()
            self._feed = SerialFeed(p.port, p.baud, self.logger.warning, self._opened)
        self._wall = self.clock.wall
        self._lines, self._receiver = NmeaLines(), Receiver(use_rmc=p.use_rmc)
        self._heard = self._wall.monotonic()
        self._position: Position | None = None
        self._said = self._heard
        """When that came."""
        self._impossible = 0
        self._told = 0

    def shutdown(self, exit_code: int = 0) -> None:
        """End the node: wakes what waits for the port."""
        super().shutdown(exit_code)
        if self._feed is not None:
            self._feed.wake()

    def main(self) -> None:
        """Read the receiver, whenever there is one; or the file, to its end."""
        if self._feed is not None:
            for chunk in self._feed.chunks(lambda: self.stopping):
                self._read(chunk)
            return
        count = 0
        for sentence in self._played():
            self._take(sentence)
            self._tell_unread()
            count += 1
        self.flush(timeout=10.0)
        self.logger.info("played %d sentences of %s", count, self.parameters.port)

    @check("fix")
    def has_fix(self) -> Health:
        """Whether the receiver is there, speaks and has a fix."""
        figures = {
            "checksum_faults": self._lines.checksum_faults,
            "unread_lines": self._lines.unread,
            "impossible_sentences": self._impossible,
        }
        if self._feed is not None and self._feed.missed:
            return Health.error(f"no port: {self._feed.missed}", **figures)
        if self._wall.monotonic() - self._heard > SILENT_AFTER:
            return Health.error(f"no sentence of NMEA comes from {self.parameters.port}", **figures)
        position = self._position
        if position is None:
            hint = ": RMC comes and no GGA; start it with use_rmc:=true" if self._receiver.has_only_rmc else ""
            return Health.warn(f"no position so far{hint}", **figures)
        figures["satellites"] = position.satellites
        if (age := self._wall.monotonic() - self._said) > SILENT_AFTER:
            return Health.warn(f"the last position is {age:.0f} s old", **figures)
        if position.latitude != position.latitude:
            return Health.warn(f"no fix, {position.satellites} satellites", **figures)
        return Health.ok(**figures)

    def _opened(self, path: str) -> None:
        self._lines.forget()
        self._heard, self._position = self._wall.monotonic(), None
        self._told = self._lines.unread + 1  # that of the line in whose middle it was opened is nothing to tell
        self.logger.info("listens to the receiver on %s", path)

    def _played(self) -> Iterator[str]:
        """The sentences of the file, when they are due."""
        rate, before = self.parameters.playback_rate, None
        rate = max(rate, SLOWEST) if rate > 0.0 else 0.0
        while True:
            with open(self.parameters.port, "rb") as file:
                while chunk := file.read(_PIECE) or (b"\n" if self._lines.has_rest else b""):
                    for sentence in self._lines.feed(chunk):
                        now = time_of(sentence)
                        if rate > 0.0 and now is not None and before is not None:
                            gap = now - before
                            self.sleep(gap / rate if 0.0 < gap <= LONGEST_GAP else 0.0)
                        before = before if now is None else now
                        if self.stopping:
                            return
                        yield sentence
            if not self.parameters.loop or not self.sleep(0.1):
                return

    def _read(self, chunk: bytes) -> None:
        for sentence in self._lines.feed(chunk):
            self._take(sentence)
        self._tell_unread()

    def _take(self, sentence: str) -> None:
        self._heard = self._wall.monotonic()
        try:
            said = self._receiver.take(sentence)
        except Unreadable as error:
            self._impossible += 1
            self.logger.warning("left out a sentence that says what cannot be, %s: %s", error, sentence, throttle=5.0)
            return
        header = Header(self.now(), self.parameters.frame_id)
        for each in said:
            match each:
                case Position():
                    self._said, self._position = self._heard, each
                    self.fixes.publish(nav_sat_fix(each, self._receiver.errors, self._expected(), header))
                case Velocity():
                    self.velocities.publish(TwistStamped(header, Twist(Vector3(each.east, each.north))))
                case datetime():
                    source = self.parameters.time_ref_source or self.parameters.frame_id
                    self.times.publish(TimeReference(header, as_time(each), source))

    def _expected(self) -> dict[int, float]:
        p = self.parameters
        return {1: p.epe_quality1, 2: p.epe_quality2, 4: p.epe_quality4, 5: p.epe_quality5, 9: p.epe_quality9}

    def _tell_unread(self) -> None:
        lines = self._lines
        if lines.unread > self._told:
            self.logger.warning(
                "%d lines could not be read so far, %d of them for a wrong checksum; the last one: %s",
                lines.unread, lines.checksum_faults, shown(lines.last_unread, 32), throttle=5.0,
            )  # fmt: skip
            self._told = lines.unread

    def on_stop(self) -> None:
        """Give the port back."""
        if self._feed is not None:
            self._feed.close()


def _is_file(path: str) -> bool:
    """Whether it is a plain file, and no device."""
    try:
        return stat.S_ISREG(os.stat(path).st_mode)
    except OSError:
        return False


def _would_be_file(path: str) -> bool:
    """Whether nothing is there, and its name is that of a file: a device is waited for, a file that is misspelt not."""
    return Path(path).suffix.lower() in FILES and not path.startswith("/dev/") and not os.path.lexists(path)


if __name__ == "__main__":
    robo.run(NmeaGps)
