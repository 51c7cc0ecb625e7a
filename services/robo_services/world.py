"""A flat world of walls, boxes and circles, and what a laser sees in it.

As YAML (m, rad):

    walls:   [[-5, -3, 5, -3], [5, -3, 5, 8]]                     # x1, y1, x2, y2
    boxes:   [{center: [1, 2], size: [0.5, 0.3], yaw: 0.2}]
    circles: [{center: [0, 2.5], radius: 0.4}]
"""

import math
import random
from typing import Annotated

import msgspec
from msgspec import Meta

from robo import RoboError
from robo.errors import UnreadableFile
from robo.process import lean
from robo.text.files import read_text
from robo_services.kinematics import Pose2

Segment = tuple[float, float, float, float]
Positive = Annotated[float, Meta(gt=0)]


class WorldError(RoboError):
    """A world file is missing or has mistakes; names all of them."""


class Box(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A rectangle."""

    center: tuple[float, float]
    size: tuple[Positive, Positive]
    """Along its own x and y, m."""
    yaw: float = 0.0
    """rad."""

    def sides(self) -> list[Segment]:
        """Its four walls."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        half_x, half_y = self.size[0] / 2, self.size[1] / 2
        corners = [
            (self.center[0] + cos * x - sin * y, self.center[1] + sin * x + cos * y)
            for x, y in ((-half_x, -half_y), (half_x, -half_y), (half_x, half_y), (-half_x, half_y))
        ]
        return [(*a, *b) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)]


class Circle(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A round thing."""

    center: tuple[float, float]
    radius: Positive


class World(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Everything that stands around."""

    walls: tuple[Segment, ...] = ()
    boxes: tuple[Box, ...] = ()
    circles: tuple[Circle, ...] = ()

    def segments(self) -> tuple[Segment, ...]:
        """All straight walls, those of the boxes included."""
        return self.walls + tuple(side for box in self.boxes for side in box.sides())


ROOM = World(walls=((-5, -5, 5, -5), (5, -5, 5, 5), (5, 5, -5, 5), (-5, 5, -5, -5)))
"""An empty room, 10 m x 10 m, around the origin: the world where none is given."""


def load(path: str) -> World:
    """Read a world file.

    Raises:
        WorldError: it is missing, unreadable or has a mistake; says where.
    """
    lean.import_yaml()
    from robo.text.tree import Map, Problem, convert
    from robo.text.yaml_tree import parse  # a node without a world file carries no YAML

    try:
        text = read_text(path)
    except UnreadableFile as error:
        raise WorldError(f"world file {path} cannot be read: {error}") from None
    problems: list[Problem] = []
    tree = parse(text, path, problems)
    world = ROOM
    if isinstance(tree, Map):
        for entry in tree:
            if entry.key not in World.__struct_fields__:
                known = ", ".join(World.__struct_fields__)
                problems.append(Problem(entry.position, f"unknown key {entry.key!r}; a world has {known}"))
        if not problems:
            world = convert(tree, World, problems) or ROOM
    elif tree is not None:
        problems.append(Problem(tree.position, "expected a map with walls, boxes, circles"))
    if problems:
        raise WorldError("\n".join(map(str, problems)))
    return world


class Laser:
    """A planar laser that looks all around."""

    def __init__(self, world: World, *, rays: int, range_min: float, range_max: float, noise: float, seed: int) -> None:
        """`noise` is the standard deviation of a range, m; the same seed gives the same noise."""
        self.rays = rays
        self.range_min = range_min
        self.range_max = range_max
        self.angle_min = -math.pi
        self.angle_increment = math.tau / rays
        self._segments = world.segments()
        self._circles = world.circles
        self._noise = noise
        self._random = random.Random(seed)
        angles = [self.angle_min + i * self.angle_increment for i in range(rays)]
        self._directions = [(math.cos(a), math.sin(a)) for a in angles]

    def scan(self, pose: Pose2) -> list[float]:
        """The ranges seen from a pose, m; REP-117: -inf too close, +inf no return.

        Everything is moved into the laser's frame, where the rays never change; then each thing only
        meets the rays between its two edges.
        """
        ranges = [math.inf] * self.rays
        cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
        for x1, y1, x2, y2 in self._segments:
            dx1, dy1, dx2, dy2 = x1 - pose.x, y1 - pose.y, x2 - pose.x, y2 - pose.y
            self._cast_segment(
                ranges, cos * dx1 + sin * dy1, cos * dy1 - sin * dx1, cos * dx2 + sin * dy2, cos * dy2 - sin * dx2
            )
        for circle in self._circles:
            dx, dy = circle.center[0] - pose.x, circle.center[1] - pose.y
            self._cast_circle(ranges, cos * dx + sin * dy, cos * dy - sin * dx, circle.radius)
        return [self._measured(r) for r in ranges]

    def _cast_segment(self, ranges: list[float], ax: float, ay: float, bx: float, by: float) -> None:
        cross = ax * by - ay * bx
        if cross < 0:
            ax, ay, bx, by, cross = bx, by, ax, ay, -cross
        if cross < 1e-12:
            return  # seen edge-on
        ex, ey = bx - ax, by - ay
        start = math.atan2(ay, ax)
        span = (math.atan2(by, bx) - start) % math.tau
        for i in self._between(start, start + span):
            c, s = self._directions[i]
            closing = c * ey - s * ex  # how steeply this ray meets the wall
            if closing > 0:
                distance = cross / closing
                if distance < ranges[i]:
                    ranges[i] = distance

    def _cast_circle(self, ranges: list[float], cx: float, cy: float, radius: float) -> None:
        square = cx * cx + cy * cy
        if square <= radius * radius:
            ranges[:] = [0.0] * self.rays
            return
        middle, half = math.atan2(cy, cx), math.asin(radius / math.sqrt(square))
        for i in self._between(middle - half, middle + half):
            c, s = self._directions[i]
            along = c * cx + s * cy
            inside = radius * radius - (square - along * along)
            if inside >= 0:
                distance = along - math.sqrt(inside)
                if distance < ranges[i]:
                    ranges[i] = distance

    def _between(self, start: float, end: float) -> list[int]:
        first = math.ceil((start - self.angle_min) / self.angle_increment - 1e-9)
        last = math.floor((end - self.angle_min) / self.angle_increment + 1e-9)
        return [i % self.rays for i in range(first, last + 1)]

    def _measured(self, distance: float) -> float:
        if distance > self.range_max:
            return math.inf
        if self._noise:
            distance += self._random.gauss(0.0, self._noise)
        return -math.inf if distance < self.range_min else min(distance, self.range_max)


def clearance(world_segments: tuple[Segment, ...], circles: tuple[Circle, ...], x: float, y: float) -> float:
    """The distance from a point to the nearest thing, m; negative inside a circle, inf in the void."""
    nearest = math.inf
    for x1, y1, x2, y2 in world_segments:
        ex, ey = x2 - x1, y2 - y1
        square = ex * ex + ey * ey
        t = max(0.0, min(1.0, ((x - x1) * ex + (y - y1) * ey) / square)) if square else 0.0
        nearest = min(nearest, math.hypot(x - x1 - t * ex, y - y1 - t * ey))
    for circle in circles:
        nearest = min(nearest, math.hypot(x - circle.center[0], y - circle.center[1]) - circle.radius)
    return nearest
