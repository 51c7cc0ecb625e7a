"""The reference robot's chain in a closed loop, without Zenoh and without a clock: does it ever touch anything?

A random world, a pose and whoever commands at random, or what leads into things; a laser, the smoother's and the
monitor's logic at their rates, and a base. One seed is one drive. As a program it makes many and tells what came out:

    python -m tests.closed_loop --worlds 10000 --variant "late scans"
"""

import argparse
import math
import random
import time
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from robo_messages import LaserScan, Twist, Vector3
from robo_services.collision import Sighting
from robo_services.contact import Velocity
from robo_services.kinematics import Pose2
from robo_services.obstacles import Obstacle, Track, from_scan
from robo_services.safety import Situation, decide
from robo_services.safety_monitor import SafetyMonitor
from robo_services.safety_parameters import FootprintParameters, limits_of
from robo_services.simulated_base import BaseLimits, SimulatedBase
from robo_services.smoothing import STANDING, AxisLimits, step, twist_of
from robo_services.smoothing import Limits as SmootherLimits
from robo_services.world import Box, Circle, Laser, Segment, World, clearance

PERIOD = 0.02
"""Of the monitor and of the base, s."""
SMOOTHER_PERIOD = 0.05
RADIUS = 0.2
"""Of the round base, m."""
CORNERS = [0.25, 0.15, -0.25, 0.15, -0.25, -0.15, 0.25, -0.15]
"""Of the other one, m."""
BETWEEN = 0.02
"""The points at which it is looked whether that touches something are so far apart, m."""
SECONDS = 4.0
"""How long a drive takes."""
STARTS_AWAY = 0.03
"""How far the base's surface is from everything at the start, at the least, m."""
MOVING = 0.01
"""A robot that is slower stands, m/s and rad/s."""


@dataclass(frozen=True)
class Variant:
    """What is made harder."""

    chain: bool = True
    scan_rate: float = 10.0
    missing: float = 0.0
    """The share of the rays that say nothing."""
    sensor_delay: float = 0.0
    """Until a scan and odometry are heard, s."""
    command_delay: float = 0.0
    """Until the base hears of a command, s."""
    obstacle_speed: float = 0.0
    """Of something round that moves, at most, m/s."""
    corners: bool = False
    """Whether the robot is a rectangle, which may touch things when it turns."""
    deceleration: tuple[float, float] = (2.0, 5.0)
    """How the base brakes: between these, m/s²."""


VARIANTS = {
    "plain": Variant(),
    "late scans": Variant(sensor_delay=0.1),
    "late commands": Variant(command_delay=0.1),
    "slow laser": Variant(scan_rate=5.0),
    "missing rays": Variant(missing=0.2),
    "corners": Variant(corners=True),
    "moving": Variant(obstacle_speed=0.3),
    "without": Variant(chain=False),
}


class Drive(NamedTuple):
    """How a drive went."""

    touched: bool
    """Whether the robot touched something while it moved."""
    tightest: float
    """The least distance of its surface from anything while it moved, m."""
    driven: float
    """m."""


class Base(Protocol):
    """What is driven."""

    @property
    def pose(self) -> Pose2: ...

    @property
    def linear(self) -> float:
        """m/s."""

    @property
    def angular(self) -> float:
        """rad/s."""

    def step(self, linear: float, angular: float, dt: float) -> None:
        """Drive for `dt` s."""


class Scanner(Protocol):
    """What looks around."""

    angle_min: float
    angle_increment: float
    range_min: float
    range_max: float

    def scan(self, pose: Pose2) -> list[float]:
        """Ranges, m."""


class Mover(NamedTuple):
    """Something round that moves straight on."""

    x: float
    y: float
    vx: float
    vy: float
    radius: float

    def at(self, moment: float) -> Circle:
        return Circle((self.x + self.vx * moment, self.y + self.vy * moment), self.radius)


def random_world(rng: random.Random, room: float) -> tuple[World, Pose2]:
    """A room with things in it, and a pose that is further than `room` m from all of them."""
    half = rng.uniform(1.0, 4.0), rng.uniform(1.0, 4.0)
    x, y = half
    walls: tuple[Segment, ...] = ((-x, -y, x, -y), (x, -y, x, y), (x, y, -x, y), (-x, y, -x, -y))
    boxes = tuple(
        Box(
            (rng.uniform(-x, x), rng.uniform(-y, y)),
            (rng.uniform(0.06, 1.2), rng.uniform(0.06, 1.2)),
            rng.uniform(-math.pi, math.pi),
        )
        for _ in range(rng.randint(0, 4))
    )
    circles = tuple(
        Circle((rng.uniform(-x, x), rng.uniform(-y, y)), rng.uniform(0.03, 0.4)) for _ in range(rng.randint(0, 4))
    )
    world = World(walls, boxes, circles)
    segments = world.segments()
    for _ in range(1000):
        pose = Pose2(rng.uniform(-x, x), rng.uniform(-y, y), rng.uniform(-math.pi, math.pi))
        in_box = any(_inside(box, pose) for box in boxes)
        if not in_box and clearance(segments, circles, pose.x, pose.y) > room:
            return world, pose
    return random_world(rng, room)


def _inside(box: Box, pose: Pose2) -> bool:
    dx, dy = pose.x - box.center[0], pose.y - box.center[1]
    cos, sin = math.cos(box.yaw), math.sin(box.yaw)
    return abs(cos * dx + sin * dy) < box.size[0] / 2 and abs(cos * dy - sin * dx) < box.size[1] / 2


def surfaces(world: World) -> list[tuple[float, float]]:
    """Points on all things, BETWEEN m apart at the most."""
    points = []
    for x1, y1, x2, y2 in world.segments():
        count = math.ceil(math.hypot(x2 - x1, y2 - y1) / BETWEEN)
        points += [(x1 + (x2 - x1) * i / count, y1 + (y2 - y1) * i / count) for i in range(count + 1)]
    for (x, y), radius in ((circle.center, circle.radius) for circle in world.circles):
        count = math.ceil(math.tau * radius / BETWEEN)
        angles = [math.tau * i / count for i in range(count)]
        points += [(x + radius * math.cos(a), y + radius * math.sin(a)) for a in angles]
    return points


class Commander:
    """Who commands: what is held or changes sharply, at random, or straight for something, to graze or to hit it."""

    def __init__(self, rng: random.Random, world: World) -> None:
        self._rng, self._until, self._twist = rng, 0.0, Twist()
        self.through_smoother = rng.random() < 0.7
        """Or with no smoother between it and the monitor."""
        kind = rng.random()
        self._hunts, self._holds = kind < 0.4, kind > 0.7
        things = [(*box.center, min(box.size) / 2) for box in world.boxes]
        things += [(*circle.center, circle.radius) for circle in world.circles]
        things += [(*wall[:2], 0.0) for wall in world.walls]
        self._thing, self._beside = rng.choice(things), rng.uniform(-0.3, 0.3)
        self._speed = rng.choice((0.3, 0.6, 1.0, 1.5))

    def at(self, moment: float, pose: Pose2) -> Twist:
        """What is commanded at a moment to a robot that stands there."""
        if self._hunts:
            return self._towards(pose)
        rng = self._rng
        if moment >= self._until:
            self._until = moment + (math.inf if self._holds else rng.uniform(0.1, 1.5))
            forward = rng.choice((1.0, 0.5, rng.uniform(0.0, 1.5), -0.5, rng.uniform(-1.5, 0.0), 0.0))
            turning = rng.choice((0.0, rng.uniform(-0.5, 0.5), rng.uniform(-3.0, 3.0)))
            self._twist = Twist(Vector3(forward), Vector3(z=turning))
        return self._twist

    def _towards(self, pose: Pose2) -> Twist:
        """At full speed for a place beside something, which is passed too near or not at all."""
        x, y, radius = self._thing
        dx, dy = x - pose.x, y - pose.y
        away = max(math.hypot(dx, dy), 1e-3)
        beside = math.copysign(radius + RADIUS, self._beside) + self._beside
        bearing = math.atan2(dy + beside * dx / away, dx - beside * dy / away)
        off = math.remainder(bearing - pose.yaw, math.tau)
        return Twist(Vector3(self._speed), Vector3(z=max(-3.0, min(3.0, 3.0 * off))))


_SMOOTHER = SmootherLimits(
    linear=AxisLimits(max_velocity=1.0, min_velocity=-1.0, max_acceleration=2.5, max_deceleration=2.5),
    lateral=AxisLimits(max_velocity=0.0, min_velocity=0.0, max_acceleration=2.5, max_deceleration=2.5),
    angular=AxisLimits(max_velocity=2.5, min_velocity=-2.5, max_acceleration=3.2, max_deceleration=3.2),
)
_ROUND = limits_of(SafetyMonitor.Parameters())
_RECTANGLE = limits_of(SafetyMonitor.Parameters(footprint=FootprintParameters(polygon=CORNERS)))


class Loop:
    """One drive."""

    def __init__(self, variant: Variant, seed: int) -> None:
        self.variant = variant
        self.rng = rng = random.Random(seed)
        self.limits = _RECTANGLE if variant.corners else _ROUND
        assert self.limits.body is not None
        self.shape = self.limits.body.footprint
        self.world, pose = random_world(rng, self.shape.reach + STARTS_AWAY)
        self.segments = self.world.segments()
        limits = BaseLimits(
            radius=RADIUS, max_linear_velocity=1.5, max_angular_velocity=3.0, linear_acceleration=2.0,
            linear_deceleration=rng.uniform(*variant.deceleration), angular_acceleration=6.0,
        )  # fmt: skip
        self.base = self.new_base(limits, pose)
        self.laser = self._laser_in(self.world)
        self.commander = Commander(rng, self.world)
        self.mover = self._new_mover() if variant.obstacle_speed else None
        self.track = Track()
        self.scan: LaserScan | None = None
        self.obstacles: list[Obstacle] = []
        self.scan_sent = -math.inf
        self.motion = STANDING
        self.smoothed = Twist()
        self.scans: deque[tuple[float, LaserScan]] = deque()
        self.odometry: deque[tuple[float, Velocity]] = deque()
        self.commands: deque[tuple[float, Twist]] = deque()
        self.obeyed = Twist()
        self.surfaces = surfaces(self.world) if variant.corners else []
        self.near: tuple[Pose2, list[tuple[float, float]]] | None = None

    def drive(self) -> Drive:
        """Until the time is over or something is touched."""
        tightest, driven, start = math.inf, 0.0, self._room(0.0)
        next_scan, next_smooth = self.rng.uniform(0.0, 1.0 / self.variant.scan_rate), 0.0
        for tick in range(round(SECONDS / PERIOD)):
            now = tick * PERIOD
            self.odometry.append((now, Velocity(self.base.linear, 0.0, self.base.angular)))
            if now >= next_scan:
                next_scan += 1.0 / self.variant.scan_rate
                self.scans.append((now, self._scanned(now)))
            if now >= next_smooth:
                next_smooth += SMOOTHER_PERIOD
                self._smooth(now)
            self._hear(now)
            self.commands.append((now, self._guarded(now) if self.variant.chain else self.smoothed))
            while self.commands and self.commands[0][0] <= now - self.variant.command_delay:
                self.obeyed = self.commands.popleft()[1]
            self.base.step(self.obeyed.linear.x, self.obeyed.angular.z, PERIOD)
            driven += abs(self.base.linear) * PERIOD
            room = self._room(now + PERIOD)
            turning = self.variant.corners and abs(self.base.angular) > MOVING
            if (abs(self.base.linear) > MOVING or turning) and not self._is_fleeing(now + PERIOD):
                if room < start - 1e-3:  # nearer than it was put
                    tightest = min(tightest, room)
                if room <= 0.0:
                    return Drive(True, room, driven)
            elif room <= 0.0:
                break  # something has run into a robot that stands
        return Drive(False, tightest, driven)

    def new_base(self, limits: BaseLimits, pose: Pose2) -> Base:
        """Something else to drive; what it touches is looked at here."""
        return SimulatedBase(World(), limits, pose)

    def _room(self, now: float) -> float:
        if self.variant.corners:
            return self._room_of_corners()
        circles = (*self.world.circles, self.mover.at(now)) if self.mover else self.world.circles
        return clearance(self.segments, circles, self.base.pose.x, self.base.pose.y) - RADIUS

    def _room_of_corners(self) -> float:
        """From the rectangle to the nearest of the points on things."""
        x, y, yaw = self.base.pose
        if self.near is None or math.hypot(self.near[0].x - x, self.near[0].y - y) > 0.2:
            reach = self.shape.reach + 0.5
            self.near = self.base.pose, [p for p in self.surfaces if math.hypot(p[0] - x, p[1] - y) < reach]
        cos, sin = math.cos(yaw), math.sin(yaw)
        there = ((px - x, py - y) for px, py in self.near[1])
        return min((self.shape.distance(cos * dx + sin * dy, cos * dy - sin * dx) for dx, dy in there), default=1.0)

    def _is_fleeing(self, now: float) -> bool:
        """Whether what moves is what is nearest, and the robot moves away from it."""
        if self.mover is None:
            return False
        pose, there = self.base.pose, self.mover.at(now)
        dx, dy = there.center[0] - pose.x, there.center[1] - pose.y
        away = math.hypot(dx, dy) - there.radius - RADIUS
        along = self.base.linear * (dx * math.cos(pose.yaw) + dy * math.sin(pose.yaw))
        return along < 0.0 and away <= self._room(now)

    def _laser_in(self, world: World) -> Scanner:
        return Laser(world, rays=360, range_min=0.05, range_max=12.0, noise=0.005, seed=self.rng.randrange(2**32))

    def _scanned(self, now: float) -> LaserScan:
        laser, missing = self.laser, self.variant.missing
        if self.mover:
            laser = self._laser_in(World(self.world.walls, self.world.boxes, (*self.world.circles, self.mover.at(now))))
        ranges = laser.scan(self.base.pose)
        if missing:
            ranges = [math.nan if self.rng.random() < missing else r for r in ranges]
        return LaserScan(
            angle_min=laser.angle_min, angle_increment=laser.angle_increment, range_min=laser.range_min,
            range_max=laser.range_max, ranges=ranges,
        )  # fmt: skip

    def _smooth(self, now: float) -> None:
        wanted = self.commander.at(now, self.base.pose)
        if self.commander.through_smoother:
            self.motion = step(self.motion, wanted, _SMOOTHER, SMOOTHER_PERIOD)
            self.smoothed = twist_of(self.motion, _SMOOTHER)
        else:
            self.smoothed = wanted

    def _hear(self, now: float) -> None:
        heard = now - self.variant.sensor_delay
        while self.odometry and self.odometry[0][0] <= heard:
            self.track.add(*self.odometry.popleft())
        while self.scans and self.scans[0][0] <= heard:
            self.scan_sent, self.scan = self.scans.popleft()
            self.obstacles = from_scan(self.scan, Pose2())

    def _guarded(self, now: float) -> Twist:
        age = now - self.scan_sent
        sightings = []
        if self.scan is not None:
            moved = self.track.moved(self.scan_sent, now)
            sightings.append(Sighting(source="scan", obstacles=self.obstacles, age=age, moved=moved))
        situation = Situation(
            command=self.smoothed, command_age=0.0, scan=self.scan, scan_age=age, speed=self.track.velocity.speed,
            velocity=self.track.velocity, sightings=sightings,
        )  # fmt: skip
        return decide(situation, self.limits).twist

    def _new_mover(self) -> Mover:
        """Something round that crosses the robot's way: it moves towards a place near the robot or ahead of it."""
        rng, pose = self.rng, self.base.pose
        radius, speed = rng.uniform(0.05, 0.3), rng.uniform(0.2, 1.0) * self.variant.obstacle_speed
        bearing, away = rng.uniform(-math.pi, math.pi), rng.uniform(0.3, 1.5) + RADIUS + radius
        x, y = pose.x + away * math.cos(bearing), pose.y + away * math.sin(bearing)
        ahead, beside = rng.uniform(-0.5, 1.5), rng.uniform(-0.5, 0.5)
        cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
        aim = math.atan2(pose.y + sin * ahead + cos * beside - y, pose.x + cos * ahead - sin * beside - x)
        return Mover(x, y, speed * math.cos(aim), speed * math.sin(aim), radius)


class Result(NamedTuple):
    """What came out of many drives."""

    drives: int
    touches: list[int]
    """The seeds of those in which something was touched."""
    tightest: float
    """m."""
    tightest_seed: int
    driven: float
    """All together, m."""


def run(variant: Variant, seed: int, drives: int) -> Result:
    """Make drives with the seeds from `seed` on."""
    touches, tightest, tightest_seed, driven = [], math.inf, seed, 0.0
    for each in range(seed, seed + drives):
        drive = Loop(variant, each).drive()
        driven += drive.driven
        if drive.touched:
            touches.append(each)
        if drive.tightest < tightest:
            tightest, tightest_seed = drive.tightest, each
    return Result(drives, touches, tightest, tightest_seed, driven)


def main() -> None:
    """Make many drives and tell what came out."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--worlds", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--variant", choices=[*VARIANTS, "all"], default="all")
    asked = parser.parse_args()
    for name, variant in VARIANTS.items():
        if asked.variant in (name, "all"):
            begin = time.process_time()
            result = run(variant, asked.seed, asked.worlds)
            print(
                f"{name}: {result.drives} drives, touched in {len(result.touches)} {result.touches[:10]}, tightest "
                f"{result.tightest * 1000:.1f} mm (seed {result.tightest_seed}), driven {result.driven:.0f} m, "
                f"{time.process_time() - begin:.0f} s",
                flush=True,
            )


if __name__ == "__main__":
    main()
