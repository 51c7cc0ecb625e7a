"""Messages to what is drawn of them: frames, scans, the trail, paths, maps, pictures, curves, the log. Pure."""

import math
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Final

from robo.bridges.rerun.frames import Frames
from robo.bridges.rerun.markers import Markers
from robo.bridges.rerun.marks import Encoded, Grid, Mark, Numbers, Picture, Points, Said, Strips
from robo.text.paths import unnested
from robo_messages import LaserScan, Log, Message, OccupancyGrid, Odometry, Path, TFMessage, Twist
from robo_messages.diagnostic import DiagnosticStatus
from robo_messages.sensor import CompressedImage, Image
from robo_messages.visualization import MarkerArray

PLOTS: Final = "plots"
SPEED: Final = f"{PLOTS}/speed"
VALUES: Final = f"{PLOTS}/values"
LOG: Final = "log"

_MOST_CURVES = 12
"""Of a topic."""
_SCAN, _PATH = (255, 110, 80), (110, 220, 120)
_LEVELS = {Log.DEBUG: "DEBUG", Log.INFO: "INFO", Log.WARN: "WARN", Log.ERROR: "ERROR", Log.FATAL: "CRITICAL"}
_STATES = {0: "INFO", 1: "WARN", 2: "ERROR", 3: "WARN"}
"""Of diagnostic status: OK, WARN, ERROR, STALE."""


class Scene:
    """Knows what has been said."""

    def __init__(self, topics: Iterable[str] = ()) -> None:
        """
        Args:
            topics: those that will come, where they are known before.
        """
        self.pictures: list[str] = []
        """Where there are any."""
        self._frames = Frames(topics)
        self._markers_there = Markers()
        self._states: dict[str, tuple[int, str]] = {}
        self._draw: dict[type, Callable[[str, Any], Iterator[Mark]]] = {
            TFMessage: self._frames.transforms,
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
        return self._frames.trails

    def _odometry(self, key: str, message: Odometry) -> Iterator[Mark]:
        twist = message.twist.twist
        yield from self._frames.odometry(key, message)
        yield Numbers(f"{SPEED}/{key}", {"linear.x": twist.linear.x, "angular.z": twist.angular.z})

    def _scan(self, key: str, scan: LaserScan) -> Iterator[Mark]:
        places = []
        for number, distance in enumerate(scan.ranges):
            angle = scan.angle_min + number * scan.angle_increment
            if math.isfinite(angle) and scan.range_min <= distance <= scan.range_max and distance < math.inf:
                places.append((distance * math.cos(angle), distance * math.sin(angle), 0.0))
        yield Points(key, self._frames.named(key, scan.header.frame_id), places, _SCAN, 0.03)

    def _path(self, key: str, path: Path) -> Iterator[Mark]:
        places = [(p.pose.position.x, p.pose.position.y, p.pose.position.z) for p in path.poses]
        yield Strips(
            key, self._frames.named(key, path.header.frame_id), [places] if len(places) > 1 else [], _PATH, 0.02
        )

    def _grid(self, key: str, grid: OccupancyGrid) -> Iterator[Mark]:
        if grid.info.width * grid.info.height == len(grid.data) > 0:
            yield Grid(key, self._frames.named(key, grid.header.frame_id), grid)

    def _markers(self, key: str, message: MarkerArray) -> Iterator[Mark]:
        return self._markers_there.take(key, message, self._frames.named)

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
        if self._states.get(key) != now:
            self._states[key] = now
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
