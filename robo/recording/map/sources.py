"""What a recording, or a log of CARMEN, says of a robot's way."""

import math
from collections.abc import Iterator
from typing import NamedTuple

from robo import bag
from robo.bag.forms import carmen
from robo.bag.forms.choice import form_of_input
from robo.bag.forms.left_out import LeftOut
from robo.bag.of_robot import robots_among, robots_of
from robo.bag.progress import Tell, counted
from robo.bag.read.readable import Readable
from robo.bag.read.reader import Bag
from robo.bag.read.topics import BagMessage
from robo.errors import UsageError
from robo.recording.map.walk import Frames, Walk
from robo.text.suggestions import suggest
from robo_messages import Header, LaserScan, Message, Odometry, TFMessage, Transform, TransformStamped, Vector3

_SCAN, _ODOMETRY, _TF = "sensor/LaserScan", "nav/Odometry", "tf2/TFMessage"
_RANGE_MAX = 80.0
"""What a log of CARMEN says for no return is longer, m."""
_BASES = ("base_link", "base_footprint")
_EACH = 1_000
"""Lines from one time to the next that it is told how far it is."""


class Wanted(NamedTuple):
    """What is asked for."""

    robot: str | None = None
    """Whose way; None where there is one."""
    frame: str | None = None
    """Of the picture; None for `map`, or what all stands in."""
    corrected: bool = False
    """Whether a log's own corrected poses count, rather than its odometry."""


def walk_of(path: str, wanted: Wanted, tell: Tell) -> Walk:
    """Read it.

    Raises:
        UsageError: it has no such robot or frame, or it is of neither form.
        BagError: it cannot be read.
        LogError: the log cannot be opened.
    """
    form = form_of_input(path)
    if form == "carmen":
        return _of_log(path, wanted, tell)
    if form != "mcap":
        raise UsageError(f"{path}: make a recording of it first: robo bag convert {path} -o NEW.mcap")
    if wanted.corrected:
        raise UsageError("--corrected is for logs of CARMEN; in a recording a mapping tool's poses are those of tf")
    with bag.open(path) as recording:
        return _of_recording(recording, wanted, tell)


def _of_recording(recording: Bag, wanted: Wanted, tell: Tell) -> Walk:
    topics = _topics(recording, wanted.robot)
    transforms = [name for name in topics if recording.topics[name].type == _TF]
    frames = _Tree(recording, transforms)
    odometry = "" if frames.base_moves(topics) else frames.add_odometry(topics)
    walk = Walk(frames.chosen(wanted.frame, topics, f"by the odometry {odometry}" if odometry else ""))
    names = [name for name in topics if recording.topics[name].type in (_SCAN, _TF) or name == odometry]
    latched = recording.latched(recording.begin) if transforms else []
    for message, value in Readable().of(latched):
        if isinstance(value, TFMessage) and message.topic.name in transforms:
            walk.transforms(value.transforms, static=True)
    total = sum(recording.topics[name].count for name in names)
    readable = Readable()
    for message, value in readable.of(counted(recording.messages(names), total, tell)):
        if isinstance(value, LaserScan):
            walk.scan(value)
        elif isinstance(value, Odometry):
            walk.odometry(value)
        elif isinstance(value, TFMessage):
            walk.transforms(value.transforms, static=_is_static(message.topic.name))
    walk.end()
    walk.malformed, walk.notes = readable.left_out, readable.notes()
    return walk


def _topics(recording: Bag, robot: str | None) -> list[str]:
    """The topics of the robot that is meant, where it has any that count."""
    names = [name for name, topic in recording.topics.items() if topic.known and topic.type in (_SCAN, _ODOMETRY, _TF)]
    robots = robots_among(names, robots_of(recording))
    if robot is None and len(robots) > 1:
        others = ", ".join(robots[1:])
        raise UsageError(f"{recording.path} has several robots: say --robot-name {robots[0]}, or {others}")
    if robot is not None:
        names = [name for name in names if name.startswith(f"{robot}/")]
        if not names:
            raise UsageError(f"{recording.path} has no robot {robot}; {suggest(robot, robots, 'it has')}")
    if not names:
        raise UsageError(f"{recording.path} has neither transforms nor odometry, of which a way could be drawn")
    return names


class _Tree:
    """Which frame stands in which, of a look at all transforms."""

    def __init__(self, recording: Bag, names: list[str]) -> None:
        self._recording = recording
        self._parents: dict[str, str] = {}
        self._moving: set[str] = set()
        """Frames whose transforms are not static."""
        for message, value in self._values(names):
            if isinstance(value, TFMessage):
                self._parents |= {one.child_frame_id: one.header.frame_id for one in value.transforms}
                if not _is_static(message.topic.name):
                    self._moving.update(one.child_frame_id for one in value.transforms)

    def base_moves(self, names: list[str]) -> bool:
        """Whether transforms say where the base goes; wheels that turn, and the map under all, do not."""
        if not self._moving:
            return False
        if not any(self._recording.topics[name].type == _ODOMETRY for name in names):
            return True
        return not self._moving.isdisjoint(self._chain(self._base(names)))

    def add_odometry(self, names: list[str]) -> str:
        """Where transforms do not say where the base goes, odometry does: that called `odom`, or the first.

        Returns:
            its topic.
        """
        wanted = [name for name in names if self._recording.topics[name].type == _ODOMETRY]
        for topic in sorted(wanted, key=lambda name: name.rpartition("/")[2] != "odom"):
            for _, value in self._values([topic]):
                if isinstance(value, Odometry):
                    self._parents[value.child_frame_id] = value.header.frame_id
                    return topic
        raise UsageError(f"{self._recording.path} has neither transforms nor odometry, of which a way could be drawn")

    def chosen(self, frame: str | None, names: list[str], poses: str) -> Frames:
        """The frames of the picture and of the way, whose poses are from there."""
        every = {*self._parents, *self._parents.values()}
        if frame is not None and frame not in every:
            raise UsageError(f"--frame {frame}: there is no such frame; {suggest(frame, every, 'there are')}")
        base = self._base(names)
        return Frames(frame if frame is not None else self._chain(base)[-1], base, poses)

    def _base(self, names: list[str]) -> str:
        return (
            next((name for name in _BASES if name in self._parents), "")
            or self._scanner(names)
            or next(iter(self._parents))
        )

    def _chain(self, frame: str) -> list[str]:
        """A frame, and those in which it stands, up to `map`."""
        found = [frame]
        while found[-1] in self._parents and found[-1] != "map":
            parent = self._parents[found[-1]]
            if parent in found:
                break
            found.append(parent)
        return found

    def _scanner(self, names: list[str]) -> str:
        """The frame of the first scan."""
        for _, value in self._values([name for name in names if self._recording.topics[name].type == _SCAN]):
            if isinstance(value, LaserScan):
                return value.header.frame_id
        return ""

    def _values(self, names: list[str]) -> Iterator[tuple[BagMessage, Message]]:
        return Readable().of(self._recording.messages(names) if names else ())


def _is_static(name: str) -> bool:
    return name.rpartition("/")[2] == "tf_static"


def _of_log(path: str, wanted: Wanted, tell: Tell) -> Walk:
    odom, base, laser = "odom", "base_link", "base_laser"
    if wanted.robot is not None:
        raise UsageError("--robot-name: a log of CARMEN is of one robot, and does not name it")
    if wanted.frame not in (None, odom):
        raise UsageError(f"--frame {wanted.frame}: a log of CARMEN has odometry in the frame {odom} alone")
    walk = Walk(Frames(odom, base, "by the corrected poses of the log" if wanted.corrected else ""))
    offset = {"x": 0.0, "y": 0.0, "yaw": 0.0}
    walk.transforms([_mounted(offset, base, laser)], static=True)
    left_out = LeftOut()
    for record in _told(carmen.read(path), tell):
        if wanted.corrected and isinstance(record, carmen.Rewritten):
            continue  # of odometry nothing is wanted
        if left_out.takes(record):
            continue
        match record:
            case carmen.LaserOffset():
                offset[record.part] = record.value
                walk.transforms([_mounted(offset, base, laser)], static=True)
            case carmen.Motion() if not wanted.corrected:
                walk.odometry(carmen.odometry(record, odom, base))
            case carmen.Scan():
                scan = carmen.laser_scan(record, laser, _RANGE_MAX)
                if wanted.corrected:
                    walk.scan_at(scan, record.estimate, _base_of(record.estimate, offset))
                else:
                    walk.scan(scan)
    walk.end()
    walk.malformed, walk.notes = left_out.malformed, left_out.notes()
    return walk


def _told(records: Iterator[carmen.Record], tell: Tell) -> Iterator[carmen.Record]:
    for record in records:
        yield record
        if record.line % _EACH == 0:
            tell(record.line, 0)


def _mounted(offset: dict[str, float], base: str, laser: str) -> TransformStamped:
    where = Transform(Vector3(offset["x"], offset["y"]), carmen.turn(offset["yaw"]))
    return TransformStamped(Header(frame_id=base), laser, where)


def _base_of(laser: tuple[float, float, float], offset: dict[str, float]) -> tuple[float, float]:
    """Where the base is, of where its laser is, m and rad."""
    x, y, yaw = laser
    turned = yaw - offset["yaw"]
    if not math.isfinite(turned):
        return math.nan, math.nan
    c, s = math.cos(turned), math.sin(turned)
    return x - c * offset["x"] + s * offset["y"], y - s * offset["x"] - c * offset["y"]
