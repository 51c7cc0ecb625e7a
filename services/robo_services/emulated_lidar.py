"""Plays a lidar LD06 on a pseudo-terminal, for a desk without one."""

import math
import random
from pathlib import Path
from typing import Annotated

from msgspec import Meta

import robo
from robo import READ_ONLY, Node, ParameterError, Subscribes, Unit, service
from robo_messages import Odometry, Trigger
from robo_services import world
from robo_services.kinematics import Pose2
from robo_services.ld_packets import CLOCK, POINT_RATE, POINTS, Packet, encode
from robo_services.planar import yaw_from_quaternion
from robo_services.pseudo_terminal import PseudoTerminal

PERIOD = 0.02
"""How often it says what it has measured since, s."""

MOST_PACKETS = 40
"""Said at once after the process was held up; what would be more is lost."""

INTENSITY = 200


class EmulatedLidar(Node):
    """Play a lidar LD06 that stands in a flat world, on a pseudo-terminal, with faults where they are asked for.

    It stands still, or moves as the odometry says that it follows. What is too near, too far or nowhere it says as a
    real one does: 0.
    """

    class Parameters(robo.Parameters):
        """Where it is plugged in, where it stands and what is wrong with it."""

        port: Annotated[
            str, Meta(min_length=1, description="a link to its pseudo-terminal is made here"), READ_ONLY
        ] = "/tmp/robo_lidar"
        world: Annotated[
            str, Meta(description="YAML file of walls, boxes and circles; empty: a 10 m room"), READ_ONLY
        ] = ""
        x: Annotated[float, Meta(description="where it stands at the start, along x"), Unit("m"), READ_ONLY] = 0.0
        y: Annotated[float, Meta(description="where it stands at the start, along y"), Unit("m"), READ_ONLY] = 0.0
        yaw: Annotated[float, Meta(description="where it looks at the start"), Unit("rad"), READ_ONLY] = 0.0
        follow: Annotated[
            str,
            Meta(description="it moves from there as this nav/Odometry says, as ground_truth; empty: it stands still"),
            Subscribes(Odometry),
            READ_ONLY,
        ] = ""
        scan_rate: Annotated[float, Meta(ge=5, le=13, description="turns per second"), Unit("Hz")] = 10.0
        range_max: Annotated[
            float, Meta(gt=0, le=60, description="it measures nothing further"), Unit("m"), READ_ONLY
        ] = 12.0
        range_noise: Annotated[
            float, Meta(ge=0, le=10, description="standard deviation of a range"), Unit("m"), READ_ONLY
        ] = 0.005
        garbled: Annotated[float, Meta(ge=0, le=1, description="share of packets of which a bit is wrong")] = 0.0
        lost: Annotated[float, Meta(ge=0, le=1, description="share of packets of which the end is missing")] = 0.0
        seed: Annotated[int, Meta(description="the same seed, the same noise and faults"), READ_ONLY] = 0

    parameters: Parameters

    _terminal: PseudoTerminal | None = None

    def on_start(self) -> None:
        """Build the world and plug it in."""
        p = self.parameters
        surroundings = world.load(p.world) if p.world else world.ROOM
        self._laser = world.Laser(
            surroundings, rays=720, range_min=0.02, range_max=p.range_max, noise=p.range_noise, seed=p.seed
        )
        self._pose = Pose2(p.x, p.y, p.yaw)
        self._start = self._pose
        self._random = random.Random(p.seed)
        self._angle, self._time = 0.0, 0.0
        self._ranges: list[float] = []
        self._wall = self.clock.wall
        self._begin, self._packets = self._wall.monotonic(), 0
        if p.follow:
            self.create_subscription(Odometry, p.follow, self.on_odometry, depth=1)
        self._plug_in()
        self.create_timer(PERIOD, self.speak, self._wall)

    def on_odometry(self, odometry: Odometry) -> None:
        """Move along."""
        there = odometry.pose.pose
        pose = Pose2(there.position.x, there.position.y, yaw_from_quaternion(there.orientation))
        if all(map(math.isfinite, pose)):
            cos, sin = math.cos(self._start.yaw), math.sin(self._start.yaw)
            x, y = self._start.x + cos * pose.x - sin * pose.y, self._start.y + sin * pose.x + cos * pose.y
            self._pose = Pose2(x, y, self._start.yaw + pose.yaw)

    @service("~/unplug")
    def unplug(self, _request: Trigger.Request) -> Trigger.Response:
        """Pull its plug: the port is gone."""
        if self._terminal is None:
            return Trigger.Response(success=False, message="it is not plugged in")
        self._terminal.unplug()
        self._terminal = None
        return Trigger.Response(message=f"{self.parameters.port} is gone")

    @service("~/replug")
    def replug(self, _request: Trigger.Request) -> Trigger.Response:
        """Plug it in again; it begins anew."""
        if self._terminal is not None:
            return Trigger.Response(success=False, message="it is plugged in")
        self._plug_in()
        return Trigger.Response(message=f"it is on {self.parameters.port}")

    def speak(self) -> None:
        """Say what was measured since."""
        due = int((self._wall.monotonic() - self._begin) * POINT_RATE / POINTS)
        self._packets = max(self._packets, due - MOST_PACKETS)
        while self._packets < due:
            self._packets += 1
            data = self._spoilt(encode(self._next()))
            if self._terminal is not None:
                self._terminal.write(data)

    def on_stop(self) -> None:
        """Pull the plug."""
        if self._terminal is not None:
            self._terminal.unplug()
            self._terminal = None

    def _plug_in(self) -> None:
        link = Path(self.parameters.port)
        try:
            self._terminal = PseudoTerminal(link)
        except OSError as error:
            raise ParameterError(f"{self.full_name}: port {link} cannot be made: {error.strerror}") from None
        self.logger.info("plays a lidar on %s, which is %s", link, self._terminal.path)

    def _next(self) -> Packet:
        """The packet of the next twelve points."""
        step = self.parameters.scan_rate * 360.0 / POINT_RATE
        begin, distances = self._angle, []
        for index in range(POINTS):
            angle = (begin + index * step) % 360.0
            if not self._ranges or angle < step:
                self._ranges = self._laser.scan(self._pose)
            distance = self._ranges[self._ray(angle)]
            distances.append(distance if math.isfinite(distance) else 0.0)
        self._angle = (begin + POINTS * step) % 360.0
        self._time = (self._time + POINTS / POINT_RATE) % CLOCK
        span = (POINTS - 1) * step
        return Packet(self.parameters.scan_rate, begin, span, self._time, tuple(distances), (INTENSITY,) * POINTS)

    def _ray(self, angle: float) -> int:
        """The laser's ray nearest to an angle of the lidar, °."""
        laser = self._laser
        return round((-math.radians(angle) - laser.angle_min) / laser.angle_increment) % laser.rays

    def _spoilt(self, data: bytes) -> bytes:
        """A packet with the faults that are asked for."""
        p = self.parameters
        if self._random.random() < p.garbled:
            bit = self._random.randrange(8 * len(data))
            data = data[: bit // 8] + bytes((data[bit // 8] ^ 1 << bit % 8,)) + data[bit // 8 + 1 :]
        if self._random.random() < p.lost:
            data = data[: self._random.randrange(len(data))]
        return data


if __name__ == "__main__":
    robo.run(EmulatedLidar)
