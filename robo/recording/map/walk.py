"""Where a robot went, and what its lasers hit on the way: of transforms and scans as they come. Pure."""

import math
from collections import deque
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from robo.errors import InTheFuture, TransformError
from robo.recording.map.cells import FARTHEST, Cells
from robo.tf.buffer import Buffer
from robo.tf.transform import Transform3
from robo_messages import LaserScan, Odometry, Transform, TransformStamped, Vector3

_KEPT = 30.0
"""For how long transforms are kept, s."""
_MOST_WAITING = 500
"""Scans that wait for the transforms of their time."""
_STEP = 0.02
"""By which the base has moved where its place is noted, m."""
_MOST_PLACES = 10_000


class Frames(NamedTuple):
    """What is seen from where."""

    fixed: str
    """The frame of the picture: `map`, or `odom`."""
    base: str
    """The frame whose way is drawn."""
    poses: str = ""
    """Where poses are from, in words; empty for the transforms of these frames."""


class Walk:
    """Gathers it."""

    def __init__(self, frames: Frames) -> None:
        self.frames = frames
        self.cells = Cells()
        self.track: list[tuple[float, float]] = []
        """Places of the base, m."""
        self.length = 0.0
        """Of its way, m."""
        self.scans = 0
        self.left_out = 0
        """Scans of whose time nobody knows where the laser was."""
        self.reason = ""
        """Why, of the first of them."""
        self.malformed = 0
        """Messages, or lines of a log, that make no sense."""
        self.notes: list[str] = []
        """What of those is left out, in words."""
        self._step = _STEP
        self._buffer = Buffer(_KEPT)
        self._waiting: deque[LaserScan] = deque()
        self._rays: dict[tuple[float, float, int], list[tuple[float, float]]] = {}

    def transforms(self, transforms: Iterable[TransformStamped], *, static: bool = False) -> None:
        """Transforms have come."""
        self._buffer.insert_all(transforms, static)
        if not static:
            self._moved()

    def odometry(self, message: Odometry) -> None:
        """Odometry has come, where no transforms say the same."""
        pose = message.pose.pose
        place = Vector3(pose.position.x, pose.position.y, pose.position.z)
        where = TransformStamped(message.header, message.child_frame_id, Transform(place, pose.orientation))
        self.transforms([where])

    def scan(self, scan: LaserScan) -> None:
        """A scan has come; it is drawn once it is known where its laser was."""
        self._waiting.append(scan)
        self._place(len(self._waiting) > _MOST_WAITING)

    def scan_at(self, scan: LaserScan, laser: tuple[float, float, float], base: tuple[float, float]) -> None:
        """A scan has come of a laser of which somebody says where it was, m and rad, and where the base was, m."""
        x, y, yaw = laser
        self._went_to(*base)
        self._draw(scan, (math.cos(yaw), -math.sin(yaw), x), (math.sin(yaw), math.cos(yaw), y))

    def end(self) -> None:
        """No more comes."""
        while self._waiting:
            self._place(True)

    def _moved(self) -> None:
        self._place(False)
        try:
            where = self._buffer.lookup(self.frames.fixed, self.frames.base)
        except TransformError:
            return
        self._went_to(where.x, where.y)

    def _went_to(self, x: float, y: float) -> None:
        if not (abs(x) < FARTHEST and abs(y) < FARTHEST):
            return
        way = math.dist(self.track[-1], (x, y)) if self.track else math.inf
        if way < self._step:
            return
        self.length += way if self.track else 0.0
        self.track.append((x, y))
        if len(self.track) > _MOST_PLACES:
            self._step *= 2.0
            self.track = self.track[::2]

    def _place(self, at_once: bool) -> None:
        """Draw scans in their order; `at_once` the first of them is drawn or left out, else it may wait."""
        while self._waiting:
            scan = self._waiting[0]
            try:
                where = self._buffer.lookup(self.frames.fixed, scan.header.frame_id, scan.header.stamp)
            except TransformError as error:
                if not at_once and isinstance(error, InTheFuture):
                    return
                if not at_once and not self.scans and len(self._waiting) <= _MOST_WAITING:
                    return  # what is static, or the first odometry, may still come
                self.left_out += 1
                self.reason = self.reason or str(error)
            else:
                self._draw(scan, *_in_plane(where))
            self._waiting.popleft()
            at_once = False

    def _draw(self, scan: LaserScan, first: tuple[float, float, float], second: tuple[float, float, float]) -> None:
        self.scans += 1
        self.cells.add(self._hits(scan, first, second))

    def _hits(
        self, scan: LaserScan, first: tuple[float, float, float], second: tuple[float, float, float]
    ) -> Iterator[tuple[float, float]]:
        xx, xy, x = first
        yx, yy, y = second
        low, high = scan.range_min, min(scan.range_max or math.inf, 1e6)
        for distance, (c, s) in zip(scan.ranges, self._directions(scan), strict=False):
            if low <= distance <= high:
                yield x + distance * (xx * c + xy * s), y + distance * (yx * c + yy * s)

    def _directions(self, scan: LaserScan) -> list[tuple[float, float]]:
        shape = scan.angle_min, scan.angle_increment, len(scan.ranges)
        found = self._rays.get(shape)
        if found is None:
            self._rays.clear()  # few lasers take turns; what says another shape each time takes no memory
            angles = (shape[0] + number * shape[1] for number in range(shape[2]))
            found = self._rays[shape] = [
                (math.cos(angle), math.sin(angle)) if math.isfinite(angle) else (math.nan, math.nan) for angle in angles
            ]
        return found


def _in_plane(where: Transform3) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    (xx, xy, _, x), (yx, yy, _, y), _, _ = where.matrix()
    return (xx, xy, x), (yx, yy, y)
