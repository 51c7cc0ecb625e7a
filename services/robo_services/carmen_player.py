"""Plays the log of a real robot."""

from collections.abc import Iterable
from typing import Annotated

from msgspec import Meta

import robo
from robo import KEEP_ALL, READ_ONLY, Node, ParameterError, Publisher, Unit
from robo_messages import Clock, LaserScan, Odometry, Time
from robo_services import carmen

MOST_NAMED = 20
"""Malformed lines named one by one while playing; the summary names the lines of all."""


class CarmenPlayer(Node):
    """Play a CARMEN log, plain or .gz, in file order, and end with it."""

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
        odom_frame: Annotated[str, Meta(description="the frame of odometry's poses")] = "odom"
        base_frame: Annotated[str, Meta(description="the frame of odometry's velocities")] = "base_link"
        laser_frame: Annotated[str, Meta(description="the frame of scans")] = "base_laser"

    parameters: Parameters

    odometry = Publisher(Odometry, "odom", depth=KEEP_ALL)
    """The odometry of the log."""
    scans = Publisher(LaserScan, "scan", depth=KEEP_ALL)
    """The laser scans of the log."""

    def on_start(self) -> None:
        """Open the log, so that a wrong name is told at once."""
        if not self.parameters.log:
            raise ParameterError(f"{self.full_name}: log names no file; give it with -p log:=FILE (robo up: log:=FILE)")
        self._records = carmen.read(self.parameters.log)
        self._first = next(self._records, None)
        self.clock = self.clock.wall  # who says the time does not wait for it
        if self.parameters.publish_clock:
            self._clock_topic = self.create_publisher(Clock, "/clock", depth=KEEP_ALL)
        self._latest = 0
        self._odometry = 0
        self._scans = 0
        self._rewritten: list[int] = []
        self._malformed: list[int] = []

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
                p = self.parameters
                self.odometry.publish(carmen.odometry(record, p.odom_frame, p.base_frame))
                self._odometry += 1
            case carmen.Scan():
                self._wait_for(record.time, begin)
                self.scans.publish(carmen.laser_scan(record, self.parameters.laser_frame, self.parameters.range_max))
                self._scans += 1

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
                line_ranges(self._rewritten[:MOST_NAMED]) + (", …" if len(self._rewritten) > MOST_NAMED else ""),
            )
        if self._malformed:
            self.logger.warning("skipped %d malformed lines: %s", len(self._malformed), line_ranges(self._malformed))


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
