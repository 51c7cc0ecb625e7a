"""Plays the log of a real robot."""

from collections.abc import Iterable
from typing import Annotated

import msgspec
from msgspec import Meta

import robo
from robo import KEEP_ALL, READ_ONLY, Node, ParameterError, Publisher, Unit
from robo.bag.forms import carmen
from robo.tf import StaticTransformBroadcaster, Transform3
from robo_messages import Clock, Header, LaserScan, Odometry, TFMessage, Time

MOST_NAMED = 20
"""Lines that are left out and named, one by one while playing, and in the summary."""


class CarmenPlayer(Node):
    """Play a CARMEN log, plain or .gz, in file order, and end with it.

    A log says where the laser stands by the parameters robot_frontlaser_offset, robot_frontlaser_side_offset and
    robot_frontlaser_angular_offset of its robot. One that does not has it in the middle of the base.
    """

    class Parameters(robo.Parameters):
        """What to play, and how fast."""

        log: Annotated[str, Meta(description="the log file"), READ_ONLY] = ""
        rate: Annotated[
            float,
            Meta(ge=0, le=1e6, description="1.0 as recorded, 2.0 twice as fast, 0 as fast as nothing is lost"),
            READ_ONLY,
        ] = 1.0
        delay: Annotated[
            float,
            Meta(ge=0, le=86_400, description="wait before the first record, for others to tune in"),
            Unit("s"),
            READ_ONLY,
        ] = 0.0
        range_max: Annotated[float, Meta(gt=0, description="longer ranges are no return"), Unit("m")] = 80.0
        publish_clock: Annotated[
            bool,
            Meta(description="publish /clock: time is that of the records, for nodes with use_sim_time"),
            READ_ONLY,
        ] = False
        odom_frame: Annotated[str, Meta(min_length=1, description="the frame of odometry's poses"), READ_ONLY] = "odom"
        base_frame: Annotated[str, Meta(min_length=1, description="the frame of odometry's velocities"), READ_ONLY] = (
            "base_link"
        )
        laser_frame: Annotated[str, Meta(min_length=1, description="the frame of scans"), READ_ONLY] = "base_laser"
        laser_pose: Annotated[
            list[float],
            Meta(description="where the laser stands on the base, x and y in m, yaw in rad; empty: as the log says"),
            READ_ONLY,
        ] = msgspec.field(default_factory=list)
        publish_laser_tf: Annotated[
            bool, Meta(description="say that on tf_static; false where a robot_state_publisher does"), READ_ONLY
        ] = True

    parameters: Parameters

    odometry = Publisher(Odometry, "odom", depth=KEEP_ALL)
    """The odometry of the log."""
    scans = Publisher(LaserScan, "scan", depth=KEEP_ALL)
    """The laser scans of the log."""
    transforms = Publisher(TFMessage, "tf", depth=KEEP_ALL)
    """Where the base stands in the frame of its odometry."""
    fixed_frames = StaticTransformBroadcaster()

    def on_start(self) -> None:
        """Open the log, so that a wrong name is told at once."""
        self._check_frames()
        if not self.parameters.log:
            raise ParameterError(f"{self.full_name}: log names no file; give it with -p log:=FILE (robo up: log:=FILE)")
        self._records = carmen.read(self.parameters.log)
        self._laser = dict.fromkeys(("x", "y", "yaw"), 0.0)
        self._first = self._after_offsets()
        self.clock = self.clock.wall  # who says the time does not wait for it
        if self.parameters.publish_clock:
            self._clock_topic = self.create_publisher(Clock, "/clock", depth=KEEP_ALL)
        self._latest = 0
        self._odometry = 0
        self._scans = 0
        self._rewritten: list[int] = []
        self._malformed: list[int] = []
        self._say_where_laser_is()

    def main(self) -> None:
        """Play everything, then say what was played."""
        if self.sleep(self.parameters.delay):
            begin = self.clock.monotonic()
            if self._first is not None:
                self._play(self._first, begin)
            for record in self._records:
                if self.stopping:
                    self.logger.warning("stopped in line %d of the log", record.line)
                    break
                self._play(record, begin)
            self.flush(timeout=10.0)
            self._summarize(self.clock.monotonic() - begin)

    def _play(self, record: carmen.Record, begin: float) -> None:
        match record:
            case carmen.Rewritten(line):
                self._rewritten.append(line)
            case carmen.MalformedLog(line, reason):
                self._malformed.append(line)
                if len(self._malformed) <= MOST_NAMED:
                    self.logger.warning("line %d is skipped: %s", line, reason)
            case carmen.Motion():
                self._wait_for(record.time, begin)
                self._publish_odometry(record)
            case carmen.Scan():
                self._wait_for(record.time, begin)
                self.scans.publish(carmen.laser_scan(record, self.parameters.laser_frame, self.parameters.range_max))
                self._scans += 1

            case carmen.LaserOffset():
                self._take(record)
                self._say_where_laser_is()

    def _publish_odometry(self, record: carmen.Motion) -> None:
        odometry = carmen.odometry(record, self.parameters.odom_frame, self.parameters.base_frame)
        # The transform goes first: who is called with the odometry of a moment may look up where that was.
        moved = Transform3.from_message(odometry.pose.pose)
        self.transforms.publish(TFMessage([moved.to_stamped(odometry.header, odometry.child_frame_id)]))
        self.odometry.publish(odometry)
        self._odometry += 1

    def _check_frames(self) -> None:
        p = self.parameters
        if len({p.odom_frame, p.base_frame, p.laser_frame}) < 3:
            raise ParameterError(f"{self.full_name}: odom_frame, base_frame and laser_frame have to be three")
        if len(p.laser_pose) not in (0, 3):
            raise ParameterError(f"{self.full_name}: laser_pose takes x, y and yaw, not {len(p.laser_pose)} numbers")

    def _after_offsets(self) -> carmen.Record | None:
        """The first record behind those that say where the laser stands."""
        for record in self._records:
            if not isinstance(record, carmen.LaserOffset):
                return record
            self._take(record)
        return None

    def _take(self, offset: carmen.LaserOffset) -> None:
        self._laser[offset.part] = offset.value

    def _say_where_laser_is(self) -> None:
        p = self.parameters
        if p.publish_laser_tf:
            where = Transform3.planar(*(p.laser_pose or self._laser.values()))
            self.fixed_frames.send(where.to_stamped(Header(self.now(), p.base_frame), p.laser_frame))

    def _wait_for(self, stamp: int, begin: float) -> None:
        """Wait until a record is due. One whose stamp steps back is due at once: file order is kept."""
        if not self._odometry and not self._scans:
            self._epoch = stamp
        if self.parameters.publish_clock:
            self._latest = max(self._latest, stamp)
            self._clock_topic.publish(Clock(Time.from_nanoseconds(self._latest)))
        if self.parameters.rate:
            due = begin + (stamp - self._epoch) * 1e-9 / self.parameters.rate
            self.sleep(due - self.clock.monotonic())

    def _summarize(self, seconds: float) -> None:
        self.logger.info(
            "played %d odometry and %d laser records of %s in %.1f s",
            self._odometry,
            self._scans,
            self.parameters.log,
            seconds,
        )
        if self._rewritten:
            self.logger.info(
                "skipped %d odometry records of time 0, which a mapping tool wrote: lines %s",
                len(self._rewritten),
                first_lines(self._rewritten),
            )
        if self._malformed:
            self.logger.warning("skipped %d malformed lines: %s", len(self._malformed), first_lines(self._malformed))


def first_lines(lines: list[int]) -> str:
    """The first of many line numbers, in short."""
    return line_ranges(lines[:MOST_NAMED]) + (", …" if len(lines) > MOST_NAMED else "")


def line_ranges(lines: Iterable[int]) -> str:
    """Line numbers in short: `3, 7-9, 12`."""
    runs: list[list[int]] = []
    for line in lines:
        if runs and line == runs[-1][1] + 1:
            runs[-1][1] = line
        else:
            runs.append([line, line])
    return ", ".join(str(a) if a == b else f"{a}-{b}" for a, b in runs)


if __name__ == "__main__":
    robo.run(CarmenPlayer)
