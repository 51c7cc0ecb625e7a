"""Messages to what is drawn of them: frames, scans, the trail, paths, maps, pictures, curves, the log. Pure."""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final

from robo.bridges.rerun.marks import (
    Axes,
    Colour,
    Encoded,
    Grid,
    Mark,
    Moved,
    Numbers,
    Picture,
    Place,
    Points,
    Said,
    Strips,
)
from robo.text.paths import unnested
from robo_messages import LaserScan, Log, Message, OccupancyGrid, Odometry, Path, TFMessage, Twist
from robo_messages.diagnostic import DiagnosticStatus
from robo_messages.sensor import CompressedImage, Image
from robo_messages.visualization import Marker, MarkerArray

WORLD: Final = "world"
"""The frame in which the outermost frames of all robots stand."""
TRAIL: Final = "trail"
PLOTS: Final = "plots"
SPEED: Final = f"{PLOTS}/speed"
VALUES: Final = f"{PLOTS}/values"
LOG: Final = "log"

_BASES = ("base_link", "base_footprint")
_STEP = 0.05
"""By which a base has moved where its trail goes on, m."""
_MOST_CURVES = 12
"""Of a topic."""
_MOST_FRAMES = 2_000
_SCAN, _TRAIL, _PATH = (255, 110, 80), (80, 160, 255), (110, 220, 120)
_LEVELS = {Log.DEBUG: "DEBUG", Log.INFO: "INFO", Log.WARN: "WARN", Log.ERROR: "ERROR", Log.FATAL: "CRITICAL"}
_STATES = {0: "INFO", 1: "WARN", 2: "ERROR", 3: "WARN"}
"""Of diagnostic status: OK, WARN, ERROR, STALE."""


class Scene:
    """Knows what has been said of frames and bases."""

    def __init__(self) -> None:
        self.pictures: list[str] = []
        """Where there are any."""
        self._parents: dict[str, str] = {}
        self._roots: set[str] = set()
        self._trails: dict[str, Place] = {}
        self._told: dict[str, tuple[Any, ...]] = {}
        self._draw: dict[type, Callable[[str, Any], Iterator[Mark]]] = {
            TFMessage: self._transforms,
            Odometry: self._odometry,
            LaserScan: self._scan,
            Path: self._path,
            OccupancyGrid: self._grid,
            MarkerArray: self._markers,
            Image: self._image,
            CompressedImage: self._compressed,
            Log: self._log,
            DiagnosticStatus: self._status,
            Twist: self._twist,
        }

    def take(self, key: str, message: Message) -> list[Mark]:
        """What is drawn of a message; nothing of one that has nothing to see."""
        return list(self._draw.get(type(message), self._values)(key, message))

    @property
    def trails(self) -> list[str]:
        """Where the ways of robots are drawn."""
        return [f"{robot or 'robot'}/{TRAIL}" for robot in self._trails]

    def _transforms(self, key: str, message: TFMessage) -> Iterator[Mark]:
        robot = _robot(key)
        always = key.rpartition("/")[2] == "tf_static"
        for one in message.transforms:
            at, turned = one.transform.translation, one.transform.rotation
            yield from self._moved(
                robot,
                (one.header.frame_id, one.child_frame_id),
                (at.x, at.y, at.z),
                (turned.x, turned.y, turned.z, turned.w),
                always,
            )

    def _odometry(self, key: str, message: Odometry) -> Iterator[Mark]:
        robot, twist = _robot(key), message.twist.twist
        child = message.child_frame_id or _BASES[0]
        if _frame(robot, child) not in self._parents or self._by_odometry(robot, child):
            self._told[f"odometry of {robot}"] = (child,)
            pose = message.pose.pose
            at, turned = pose.position, pose.orientation
            frames = (message.header.frame_id or "odom", child)
            yield from self._moved(robot, frames, (at.x, at.y, at.z), (turned.x, turned.y, turned.z, turned.w), False)
        yield Numbers(f"{SPEED}/{key}", {"linear.x": twist.linear.x, "angular.z": twist.angular.z})

    def _by_odometry(self, robot: str, child: str) -> bool:
        return self._told.get(f"odometry of {robot}") == (child,)

    def _moved(
        self, robot: str, frames: tuple[str, str], at: Place, turned: tuple[float, float, float, float], always: bool
    ) -> Iterator[Mark]:
        parent, child = (_frame(robot, name) for name in frames)
        if not all(map(math.isfinite, (*at, *turned))) or parent == child:
            return
        if child not in self._parents and len(self._parents) >= _MOST_FRAMES:
            return
        is_new = child not in self._parents
        self._parents[child] = parent
        self._roots.discard(child)
        yield Moved(_place_of(robot, child), parent, child, at, turned, always)
        if parent not in self._parents and parent not in self._roots:
            self._roots.add(parent)
            yield Moved(_place_of(robot, parent), WORLD, parent, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
        if frames[1] in _BASES:
            if is_new:
                yield Axes(f"{robot or 'robot'}/base", child, 0.3)
            yield from self._trail(robot, parent, at)

    def _trail(self, robot: str, frame: str, at: Place) -> Iterator[Mark]:
        before = self._trails.get(robot)
        if before is None:
            self._trails[robot] = at
        elif (way := math.dist(before, at)) >= _STEP:
            self._trails[robot] = at
            if way < 20 * _STEP:  # further than that it was put, or somebody has not looked for long
                yield Strips(f"{robot or 'robot'}/{TRAIL}", frame, [[before, at]], _TRAIL, 0.015)

    def _scan(self, key: str, scan: LaserScan) -> Iterator[Mark]:
        places = []
        for number, distance in enumerate(scan.ranges):
            if scan.range_min <= distance <= scan.range_max and distance < math.inf:
                angle = scan.angle_min + number * scan.angle_increment
                places.append((distance * math.cos(angle), distance * math.sin(angle), 0.0))
        yield Points(key, _frame(_robot(key), scan.header.frame_id), places, _SCAN, 0.03)

    def _path(self, key: str, path: Path) -> Iterator[Mark]:
        places = [(p.pose.position.x, p.pose.position.y, p.pose.position.z) for p in path.poses]
        yield Strips(key, _frame(_robot(key), path.header.frame_id), [places] if len(places) > 1 else [], _PATH, 0.02)

    def _grid(self, key: str, grid: OccupancyGrid) -> Iterator[Mark]:
        if grid.info.width * grid.info.height == len(grid.data) > 0:
            yield Grid(key, _frame(_robot(key), grid.header.frame_id), grid)

    def _markers(self, key: str, message: MarkerArray) -> Iterator[Mark]:
        robot = _robot(key)
        for marker in message.markers:
            if marker.action == Marker.DELETE or marker.action == Marker.DELETEALL:
                continue
            path = f"{key}/{marker.ns or 'marker'}/{marker.id}"
            frame, colour = _frame(robot, marker.header.frame_id), _colour(marker)
            places = [_moved_by(marker, (p.x, p.y, p.z)) for p in marker.points]
            if marker.type == Marker.LINE_STRIP:
                yield Strips(path, frame, [places], colour, max(marker.scale.x / 2, 0.005))
            elif marker.type == Marker.LINE_LIST:
                pairs = [places[at : at + 2] for at in range(0, len(places) - 1, 2)]
                yield Strips(path, frame, pairs, colour, max(marker.scale.x / 2, 0.005))
            elif marker.type in (Marker.POINTS, Marker.SPHERE_LIST, Marker.CUBE_LIST):
                yield Points(path, frame, places, colour, max(marker.scale.x / 2, 0.01))
            elif marker.type in (Marker.SPHERE, Marker.CUBE, Marker.CYLINDER):
                yield Points(path, frame, [_moved_by(marker, (0.0, 0.0, 0.0))], colour, max(marker.scale.x / 2, 0.01))

    def _image(self, key: str, image: Image) -> Iterator[Mark]:
        self._seen(key)
        yield Picture(key, image)

    def _compressed(self, key: str, image: CompressedImage) -> Iterator[Mark]:
        kind = "png" if "png" in image.format.lower() else "jpeg"
        self._seen(key)
        yield Encoded(key, bytes(image.data), f"image/{kind}")

    def _seen(self, key: str) -> None:
        if key not in self.pictures:
            self.pictures.append(key)

    def _log(self, key: str, record: Log) -> Iterator[Mark]:
        del key  # the record says whose it is
        yield Said(f"{LOG}/{record.name.strip('/') or 'unnamed'}", record.msg, _LEVELS.get(record.level, "INFO"))

    def _status(self, key: str, status: DiagnosticStatus) -> Iterator[Mark]:
        """A line where it has changed."""
        now = (status.level, status.message)
        if self._told.get(key) != now:
            self._told[key] = now
            yield Said(f"{LOG}/{key}", status.message, _STATES.get(status.level, "INFO"))

    def _twist(self, key: str, twist: Twist) -> Iterator[Mark]:
        # What the base is told at the end is beside what it does; those who want to drive are many curves.
        where = SPEED if key.rpartition("/")[2] == "cmd_vel" else VALUES
        yield Numbers(f"{where}/{key}", {"linear.x": twist.linear.x, "angular.z": twist.angular.z})

    def _values(self, key: str, message: Message) -> Iterator[Mark]:
        """The numbers of any other type."""
        values = {
            path: float(value)
            for path, value in unnested(_plain(message), ".")
            if isinstance(value, (int, float)) and not path.startswith("header.")
        }
        if values:
            yield Numbers(f"{VALUES}/{key}", dict(list(values.items())[:_MOST_CURVES]))


def _plain(message: Message) -> dict[str, object]:
    """Its fields without what is long."""
    fields = {name: getattr(message, name) for name in message.__struct_fields__}
    return {
        name: _plain(value) if isinstance(value, Message) else value
        for name, value in fields.items()
        if isinstance(value, (Message, int, float))
    }


def _robot(key: str) -> str:
    return key.rpartition("/")[0]


def _frame(robot: str, name: str) -> str:
    """A frame's name among those of all robots."""
    name = name.lstrip("/")
    return f"{robot}/{name}" if robot else name


def _place_of(robot: str, frame: str) -> str:
    return f"{robot or 'robot'}/tf/{frame.removeprefix(f'{robot}/')}"


def _colour(marker: Marker) -> Colour:
    red, green, blue = (round(255 * min(max(part, 0.0), 1.0)) for part in _parts(marker))
    return red, green, blue


def _parts(marker: Marker) -> Sequence[float]:
    found = marker.color.r, marker.color.g, marker.color.b
    return found if all(map(math.isfinite, found)) else (1.0, 1.0, 1.0)


def _moved_by(marker: Marker, place: Place) -> Place:
    """A point of a marker in the frame of its header."""
    q, at = marker.pose.orientation, marker.pose.position
    x, y, z = place
    # v + 2 q × (q × v + w v), for a unit quaternion; zeros, which some send, turn nothing
    cx, cy, cz = q.y * z - q.z * y + q.w * x, q.z * x - q.x * z + q.w * y, q.x * y - q.y * x + q.w * z
    return (
        at.x + x + 2 * (q.y * cz - q.z * cy),
        at.y + y + 2 * (q.z * cx - q.x * cz),
        at.z + z + 2 * (q.x * cy - q.y * cx),
    )
