"""Drives a lidar LD06 or LD19 of LDROBOT."""

import math
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

import robo
from robo import READ_ONLY, Health, Node, Publisher, QoS, Unit, check
from robo_messages import Header, LaserScan, Time
from robo_services.ld_packets import BAUD, CLOCK, LENGTH, LdDecoder, Packet, Turn, Turns, laser_scan
from robo_services.serial_feed import SerialFeed, shown
from robo_services.serial_port import import_serial

SILENT_AFTER = 1.0
"""A lidar that says nothing for this long is silent, s."""

STALE_AFTER = 0.1
"""It speaks every 2.7 ms: what has waited in the port for longer is of the past, s. Ports keep 0.2 to 3 s of it."""

MANY = 0.1
"""A larger share of packets that cannot be read is a warning."""

ENOUGH = 100
"""Packets that tell the share: those of a quarter of a second."""

STRANGE = 20 * LENGTH
"""So many bytes without a packet are no lidar's."""


class LdLidar(Node):
    """Publish what a lidar LD06 or LD19 sees, a scan per turn.

    It only listens: these lidars turn and speak as soon as they have power. A port that is not there, or is unplugged,
    is waited for; while it is not there nothing is published, so that whoever drives by the scan stops.
    """

    REQUIRES: ClassVar = {"serial": "robo-zenoh[serial]"}

    class Parameters(robo.Parameters):
        """Where the lidar is plugged in, and what is made of its turns."""

        port: Annotated[
            str,
            Meta(min_length=1, description="its port: a path, or a USB id such as 10c4:ea60"),
            READ_ONLY,
        ] = "/dev/ttyUSB0"
        frame_id: Annotated[str, Meta(min_length=1, description="the frame of scans"), READ_ONLY] = "base_laser"
        inverted: Annotated[bool, Meta(description="it hangs upside down, with its front where it was"), READ_ONLY] = (
            False
        )
        rays: Annotated[
            int,
            Meta(ge=36, le=10_000, description="rays of a scan; the lidar measures 4,500 points a second"),
            READ_ONLY,
        ] = 360
        range_min: Annotated[
            float, Meta(ge=0, le=100, description="the lidar measures nothing nearer"), Unit("m"), READ_ONLY
        ] = 0.02
        range_max: Annotated[
            float, Meta(ge=1, le=100, description="the lidar measures nothing further"), Unit("m"), READ_ONLY
        ] = 12.0
        no_return: Annotated[
            Literal["nan", "inf"],
            Meta(description="what a ray is of which nothing came back: not known, or free"),
        ] = "nan"

        def __post_init__(self) -> None:
            """Refuse a lidar that measures nothing."""
            if not self.range_min < self.range_max:
                raise ValueError(f"range_min = {self.range_min:g} has to be less than range_max = {self.range_max:g}")

    parameters: Parameters

    scans = Publisher(LaserScan, "scan", qos=QoS.SENSOR_DATA)
    """One per turn, counter-clockwise from the back; stamped with when ray 0 was measured: the end of the turn, or its
    beginning where the lidar hangs upside down."""

    _feed: SerialFeed | None = None

    def on_start(self) -> None:
        """No port is open yet."""
        import_serial()  # what cannot work is said at once
        p = self.parameters
        self._wall = self.clock.wall
        self._feed = SerialFeed(
            p.port, BAUD, self.logger.warning, self._opened,
            stale_after=STALE_AFTER, held_up=self._was_held_up, now=self._wall.monotonic,
        )  # fmt: skip
        self._decoder, self._assembly = LdDecoder(), Turns(p.rays)
        self._heard = self._turned = -math.inf
        self._speed = 0.0
        self._held_up = 0
        """How often it was read too late."""
        self._counted = (0, 0)
        """Packets that could not and could be read when the share was told last."""
        self._share = 0.0
        """Of packets that cannot be read, of late."""
        self._told = 0
        """Bytes that could not be read, as last said."""
        self._is_new = True
        """Whether nothing was heard since the port was opened, or was read too late."""

    def shutdown(self, exit_code: int = 0) -> None:
        """End the node: wakes what waits for the port."""
        super().shutdown(exit_code)
        if self._feed is not None:
            self._feed.wake()

    def main(self) -> None:
        """Read the lidar, whenever there is one."""
        assert self._feed is not None
        for chunk in self._feed.chunks(lambda: self.stopping):
            self._take(chunk, self._feed.read_at)

    @check("lidar")
    def is_heard(self) -> Health:
        """Whether the lidar is there, speaks and turns."""
        assert self._feed is not None
        decoder = self._decoder
        figures = {
            "turns_per_second": round(self._speed, 2),
            "crc_faults": decoder.crc_faults,
            "skipped_bytes": decoder.skipped,
            "incomplete_turns": self._assembly.incomplete,
            "held_up": self._held_up,
        }
        if self._feed.missed:
            return Health.error(f"no port: {self._feed.missed}", **figures)
        if self._wall.monotonic() - self._heard > SILENT_AFTER:
            return Health.error(f"the lidar on {self.parameters.port} is silent", **figures)
        if self._wall.monotonic() - self._turned > SILENT_AFTER:
            return Health.error("the lidar speaks and makes no whole turn: is it stuck?", **figures)
        if self._unread_share() > MANY:
            return Health.warn(f"{self._share:.0%} of what it says cannot be read: look at the cable", **figures)
        return Health.ok(**figures)

    def _unread_share(self) -> float:
        """Of packets that could not be read since it was asked last."""
        counts = (self._decoder.crc_faults, self._decoder.packets)
        faults, read = (late - early for late, early in zip(counts, self._counted, strict=True))
        if faults + read >= ENOUGH:
            self._share, self._counted = faults / (faults + read), counts
        return self._share

    def _opened(self, path: str) -> None:
        self._begin()
        self._heard = self._turned = self._wall.monotonic()
        self.logger.info("listens to the lidar on %s", path)

    def _was_held_up(self, gap: float) -> None:
        self._begin()
        self._held_up += 1
        self.logger.warning("held up: the lidar was not read for %.2f s, which is left out", gap, throttle=5.0)

    def _begin(self) -> None:
        """What comes now does not join on to what came before."""
        self._decoder.forget()
        self._assembly.forget()
        self._told, self._is_new = self._decoder.skipped, True

    def _take(self, chunk: bytes, read_at: float) -> None:
        """Take what was read then, s by the wall's monotonic clock."""
        ended: list[Turn] = []
        last: Packet | None = None
        for last in self._decoder.feed(chunk):
            turn = self._assembly.take(last)
            if turn is not None:
                ended.append(turn)
        if last is not None:
            self._heard, self._speed = read_at, last.speed
            for turn in ended:
                self._turned = read_at
                self._publish(turn, read_at - (last.time - turn.time) % CLOCK)
        self._tell_unread(heard=last is not None)

    def _publish(self, turn: Turn, ended: float) -> None:
        """Publish a turn that ended then, s by the wall's monotonic clock."""
        p = self.parameters
        age = max(0.0, self._wall.monotonic() - ended)  # however long this process was held up since
        before = age + (1.0 / turn.speed if p.inverted else 0.0)
        header = Header(Time.from_nanoseconds(max(0, self.now().to_nanoseconds() - round(before * 1e9))), p.frame_id)
        scan = laser_scan(turn, header, p.range_min, p.range_max, p.no_return, inverted=p.inverted)
        self.scans.publish(scan, age)

    def _tell_unread(self, *, heard: bool) -> None:
        """Say what could not be read; a packet that was cut off when the port was opened is nothing to tell."""
        decoder = self._decoder
        new = decoder.skipped - self._told
        if not heard and new < STRANGE:
            return
        if new >= (LENGTH if self._is_new else 1):
            self.logger.warning(
                "%d bytes so far were no packet of a lidar LD06 or LD19, %d checksums were wrong; the last ones: %s",
                decoder.skipped, decoder.crc_faults, shown(decoder.unread), throttle=5.0,
            )  # fmt: skip
        self._told, self._is_new = decoder.skipped, self._is_new and not heard

    def on_stop(self) -> None:
        """Give the port back."""
        if self._feed is not None:
            self._feed.close()


if __name__ == "__main__":
    robo.run(LdLidar)
