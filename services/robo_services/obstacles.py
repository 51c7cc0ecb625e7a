"""Obstacles as points in the robot's base frame, out of what sensors say; and how the base has moved since: pure."""

import math
from bisect import bisect_right
from collections import deque
from collections.abc import Iterable
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

from robo_services.contact import STANDING, STRAIGHT, Velocity
from robo_services.kinematics import Pose2
from robo_services.planar import normalize_angle

if TYPE_CHECKING:
    from robo_messages import LaserScan, PointCloud2, Range

TOGETHER = 0.01
"""Points of a scan or a cloud that are nearer to each other than this may be taken as one, m."""

NEAREST = 1e-3
"""Where something is that is too near to be measured, by a sensor that does not say from where on it measures, m."""

REMEMBERED = 2.0
"""How long it is known how the base has moved, s."""


class Obstacle(NamedTuple):
    """A point that is not to be touched."""

    distance: float
    """From the base's origin, when it was measured, m."""
    x: float
    """m, forward."""
    y: float
    """m, to the left."""
    points: int = 1
    """How many of the sensor's points it stands for."""


def from_scan(scan: "LaserScan", place: Pose2, min_range: float = 0.0, max_range: float = math.inf) -> list[Obstacle]:
    """What a laser sees, the nearest first.

    REP-117: -inf is too near, +inf and what is beyond `range_max` is free, NaN says nothing. What is nearer than the
    scan's `range_min` is an obstacle all the same, anywhere between there and the laser: at both ends of that.

    Args:
        scan: with angles that are finite.
        place: of the laser in the base's frame.
        min_range: what is nearer is the robot itself, m; but not -inf, as that may be a hand on the lens.
        max_range: what is further is not looked at, m.
    """
    ranges = scan.ranges
    far = min(scan.range_max, max_range)
    too_near = scan.range_min if 0.0 < scan.range_min < math.inf else NEAREST
    directions = _directions(len(ranges), scan.angle_min + place.yaw, scan.angle_increment)
    at_x, at_y = place.x, place.y
    points = [
        (math.hypot(x := at_x + r * c, y := at_y + r * s), x, y)
        for value, (c, s) in zip(ranges, directions, strict=True)
        if value <= far and (r := value if value > too_near else max(value, too_near)) >= min_range
    ]
    points += [
        (math.hypot(x := at_x + r * c, y := at_y + r * s), x, y)
        for value, (c, s) in zip(ranges, directions, strict=True)
        if value < too_near and ((r := max(value, NEAREST)) >= min_range or value == -math.inf)
    ]
    return thinned(points)


def from_range(reading: "Range", place: Pose2, min_range: float = 0.0, max_range: float = math.inf) -> list[Obstacle]:
    """What a range sensor sees, the nearest first: an arc across its cone, of points that are up to 2 cm apart.

    Its `range` and `max_range` are no NaN. A reading beyond `max_range` is free, as is +inf. What is too near to be
    measured is anywhere between the sensor and `min_range`: at both ends of that.
    """
    far = min(reading.max_range, max_range)
    near = reading.min_range if 0.0 < reading.min_range < math.inf else NEAREST
    if not reading.range <= far or (max(reading.range, near) < min_range and reading.range != -math.inf):
        return []
    here = [(place.x, place.y)] if reading.range < near else []
    distance = max(reading.range, near)
    half = min(max(reading.field_of_view, 0.0), math.tau) / 2 if math.isfinite(reading.field_of_view) else math.pi
    count = min(2 + int(2 * half * distance / 0.02), 720)
    angles = [place.yaw - half + 2 * half * i / (count - 1) for i in range(count)]
    points = here + [(place.x + distance * math.cos(a), place.y + distance * math.sin(a)) for a in angles]
    return sorted(Obstacle(math.hypot(x, y), x, y) for x, y in points)


class Place(NamedTuple):
    """Where a sensor stands in the base's frame: what takes a point (x, y, z) there to the base's frame."""

    x: tuple[float, float, float, float]
    """The base's x of a point is the sum of the first three times its x, y, z, and the fourth, m."""
    y: tuple[float, float, float, float]
    z: tuple[float, float, float, float]

    @classmethod
    def planar(cls, pose: Pose2) -> "Place":
        """Of a sensor that stands upright, at height 0."""
        cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
        return cls((cos, -sin, 0.0, pose.x), (sin, cos, 0.0, pose.y), (0.0, 0.0, 1.0, 0.0))

    @property
    def pose(self) -> Pose2 | None:
        """In the plane; None of a sensor that is tilted or upside down."""
        if not self.z[2] >= UPRIGHT:
            return None
        return Pose2(self.x[3], self.y[3], self.yaw)

    @property
    def yaw(self) -> float:
        """Where the sensor's x axis leads in the plane, rad."""
        return math.atan2(self.y[0], self.x[0])


UPRIGHT = math.cos(math.radians(5.0))
"""The cosine of the tilt up to which a sensor counts as upright."""


def from_cloud(
    cloud: "PointCloud2", place: Place, heights: tuple[float, float], ranges: tuple[float, float]
) -> list[Obstacle]:
    """What a cloud has between two heights, the nearest first. Needs numpy.

    Args:
        cloud: with fields x, y, z; points that are not finite are left out. One of no points at all says that nothing
            is there.
        place: of its frame in the base's.
        heights: from and to which points count, in the base's frame, m.
        ranges: what is nearer to the sensor is the robot itself, what is further does not count, m.

    Raises:
        ModuleNotFoundError: numpy is not installed; names the extra.
        ValueError: its fields, steps and data do not fit, x, y or z is missing or no single number, or it has points
            and all of them hold NaN: a camera that is blind.
    """
    array = cloud.array
    import numpy as np

    missing = {"x", "y", "z"} - set(array.dtype.names or ())
    if missing or any(array.dtype[axis].shape for axis in "xyz"):
        raise ValueError("a cloud needs the fields x, y and z, each of one number")
    with np.errstate(all="ignore"):  # what is not finite fails the comparisons below
        sensed = np.stack([np.asarray(array[axis], np.float64).reshape(-1) for axis in "xyz"])
        away = np.sqrt((sensed * sensed).sum(axis=0))
        if away.size and np.isnan(away).all():
            raise ValueError("none of its points is a number")
        sensed = sensed[:, (away >= ranges[0]) & (away <= min(ranges[1], FURTHEST))]
    x, y, z = (np.asarray(row[:3]) @ sensed + row[3] for row in place)
    counts = (z >= heights[0]) & (z <= heights[1])
    x, y = x[counts], y[counts]
    away = np.hypot(x, y)
    order = away.argsort(kind="stable")
    cells = np.floor(np.stack((x, y))[:, order] / TOGETHER).astype(np.int64)
    _, first, numbers = np.unique(cells[0] * 2**32 + cells[1], return_index=True, return_counts=True)
    kept = order[first]
    return sorted(map(Obstacle, away[kept].tolist(), x[kept].tolist(), y[kept].tolist(), numbers.tolist()))


FURTHEST = 100.0
"""Points of a cloud that are further away are not looked at, m."""


def thinned(points: Iterable[tuple[float, float, float]]) -> list[Obstacle]:
    """Points (distance, x, y) in the order of a scan, the nearest first; of neighbours the nearer one stays."""
    kept: list[Obstacle] = []
    first_x = first_y = math.inf
    nearest, count = (math.inf, 0.0, 0.0), 0
    for point in points:
        if abs(point[1] - first_x) < TOGETHER and abs(point[2] - first_y) < TOGETHER:
            count += 1
            if point < nearest:
                nearest = point
            continue
        if count:
            kept.append(Obstacle(*nearest, count))
        first_x, first_y, nearest, count = point[1], point[2], point, 1
    if count:
        kept.append(Obstacle(*nearest, count))
    kept.sort()
    return kept


@lru_cache(maxsize=8)
def _directions(count: int, start: float, increment: float) -> list[tuple[float, float]]:
    """Of the rays of a laser, which are the same in every scan."""
    return [(math.cos(start + i * increment), math.sin(start + i * increment)) for i in range(count)]


class Track:
    """How the base has moved of late, put together from velocities."""

    def __init__(self) -> None:
        self._poses: deque[tuple[float, Pose2]] = deque()
        self.velocity = STANDING
        """The last one."""

    def add(self, moment: float, velocity: Velocity) -> None:
        """From a moment on, s, it moves so.

        One that is before the last one is left out; where time has stepped back by more than is remembered, all
        before it is forgotten.
        """
        if self._poses and moment < self._poses[-1][0]:
            if moment > self._poses[-1][0] - REMEMBERED:
                return
            self._poses.clear()
        self._poses.append((moment, self._at(moment)))
        self.velocity = velocity
        while len(self._poses) > 1 and self._poses[1][0] < moment - REMEMBERED:
            self._poses.popleft()

    def moved(self, since: float, now: float) -> Pose2:
        """Where the base is now, in its frame at an earlier moment; what is not known counts as standing still."""
        before, after = self._at(since), self._at(now)
        dx, dy = after.x - before.x, after.y - before.y
        cos, sin = math.cos(before.yaw), math.sin(before.yaw)
        return Pose2(cos * dx + sin * dy, cos * dy - sin * dx, normalize_angle(after.yaw - before.yaw))

    def _at(self, moment: float) -> Pose2:
        if not self._poses:
            return Pose2()
        last, pose = self._poses[-1]
        if moment >= last:
            return moved_by(pose, self.velocity, min(moment - last, REMEMBERED))
        after = bisect_right(self._poses, moment, key=lambda entry: entry[0])
        if after == 0:
            return self._poses[0][1]
        (start, a), (end, b) = self._poses[after - 1], self._poses[after]
        part = (moment - start) / (end - start)
        turn = math.remainder(b.yaw - a.yaw, math.tau)
        return Pose2(a.x + part * (b.x - a.x), a.y + part * (b.y - a.y), normalize_angle(a.yaw + part * turn))


def moved_by(pose: Pose2, velocity: Velocity, dt: float) -> Pose2:
    """Where a base is that moves at constant velocities for `dt` s: an exact arc, sideways motion included."""
    turn = velocity.turn * dt
    if abs(velocity.turn) < STRAIGHT:
        along, across = dt, 0.0
    else:
        along, across = math.sin(turn) / velocity.turn, (1.0 - math.cos(turn)) / velocity.turn
    dx, dy = velocity.x * along - velocity.y * across, velocity.x * across + velocity.y * along
    cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
    return Pose2(pose.x + cos * dx - sin * dy, pose.y + sin * dx + cos * dy, normalize_angle(pose.yaw + turn))
