"""Courses: waypoints from a parameter, a file or messages, checked.

As YAML (m, rad, m/s):

    frame: odom                              # the frame of all; without it, that of odometry
    waypoints:
      - [2.5, 0.4]                           # x, y
      - [3.0, -2.4, -1.57]                   # x, y, yaw: it stands there and turns
      - {x: 3.0, y: -3.4, speed: 0.1, tolerance: 0.05, yaw: -1.57}
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Literal

import msgspec
from msgspec import Meta

from robo import RoboError
from robo.errors import UnreadableFile
from robo.process import lean
from robo.text.files import read_text
from robo.text.readable import readable
from robo_messages import PoseStamped, Quaternion
from robo_services.planar import yaw_from_quaternion

if TYPE_CHECKING:
    from robo.text.tree import Problem, Tree

FURTHEST = 1e6
"""No waypoint is further from the origin along an axis, m: beyond, it is a mistake."""
MOST = 10_000
"""The most waypoints of a course."""
LEAST_TOLERANCE = 0.01
"""m."""

Orientations = Literal["ignore", "goal", "all"]
"""Which poses of a message say how the robot is to stand there: none, the last one, or each of them."""

Coordinate = Annotated[float, Meta(ge=-FURTHEST, le=FURTHEST)]


class CourseError(RoboError, ValueError):
    """A course has mistakes; the message has a line for each."""


class Waypoint(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A place where the robot is to go."""

    x: Coordinate
    """m."""
    y: Coordinate
    """m."""
    yaw: Annotated[float, Meta(ge=-1e3, le=1e3)] | None = None
    """How it is to stand there, rad; None where it may drive on."""
    speed: Annotated[float, Meta(gt=0, le=100)] | None = None
    """The most on the way there, m/s; None where nothing else holds than everywhere."""
    tolerance: Annotated[float, Meta(ge=LEAST_TOLERANCE, le=100)] | None = None
    """How near is there, m; None as everywhere."""


class Course(msgspec.Struct, frozen=True):
    """Waypoints in the order in which they are to be reached."""

    waypoints: tuple[Waypoint, ...]
    """At least one."""
    frame: str = ""
    """Of all of them; empty: that of odometry."""
    laps: int = 1
    """How often; 0 for ever."""
    first: int = 0
    """The number of the waypoint with which the first lap begins."""

    def __post_init__(self) -> None:
        """Refuse what cannot be driven.

        Raises:
            CourseError: says what.
        """
        if not self.waypoints:
            raise CourseError("a course needs a waypoint")
        if len(self.waypoints) > MOST:
            raise CourseError(f"a course of {len(self.waypoints):,} waypoints: at most {MOST:,} are taken")
        a = self.waypoints[0]
        if self.laps != 1 and all(math.hypot(b.x - a.x, b.y - a.y) < LEAST_TOLERANCE for b in self.waypoints):
            raise CourseError("a course of several laps needs waypoints in more than one place")
        if not 0 <= self.first < len(self.waypoints):
            raise CourseError(
                f"there is no waypoint {self.first}: they are numbered from 0 to {len(self.waypoints) - 1}"
            )


def waypoint_of_numbers(numbers: object) -> Waypoint:
    """A waypoint written as `[x, y]` or `[x, y, yaw]`.

    Raises:
        ValueError: it is none; says why.
    """
    if not isinstance(numbers, (list, tuple)) or len(numbers) not in (2, 3):
        raise ValueError("expected [x, y] or [x, y, yaw]")
    try:
        return msgspec.convert(dict(zip(("x", "y", "yaw"), map(_finite, numbers), strict=False)), readable(Waypoint))
    except msgspec.ValidationError as error:
        raise ValueError(_plain(error)) from None


def _finite(number: object) -> float:
    if isinstance(number, bool) or not isinstance(number, (int, float)):
        raise ValueError(f"expected a number, not {str(number)[:30]!r}")
    if not math.isfinite(number):
        raise ValueError(f"expected a finite number, not {number}")
    return number


def _plain(error: msgspec.ValidationError) -> str:
    text, _, path = str(error).partition(" - at `$.")
    field = path.rstrip("`")
    return f"{field}: {text[:1].lower()}{text[1:]}".replace("`", "") if field else text.replace("`", "").lower()


def waypoints_of_rows(rows: Sequence[object]) -> tuple[Waypoint, ...]:
    """Waypoints written as lists of numbers.

    Raises:
        CourseError: names each that is wrong.
    """
    waypoints: list[Waypoint] = []
    mistakes: list[str] = []
    for index, row in enumerate(rows):
        try:
            waypoints.append(waypoint_of_numbers(row))
        except ValueError as error:
            mistakes.append(f"waypoints[{index}]: {error}")
    if mistakes:
        raise CourseError("\n".join(mistakes))
    return tuple(waypoints)


def course_of_poses(
    poses: Sequence[PoseStamped], frame: str, orientations: Orientations, laps: int = 1, first: int = 0
) -> Course:
    """A course through the poses of a message; a quaternion of zeros says nothing.

    Args:
        poses: each may name its frame.
        frame: of those that name none.
        orientations: of which poses they count.
        laps: how often; 0 for ever.
        first: the number of the pose to begin with.

    Raises:
        CourseError: there are none, they are not finite, or in more than one frame.
    """
    mistakes: list[str] = []
    waypoints: list[Waypoint] = []
    frames = {pose.header.frame_id.removeprefix("/") or frame.removeprefix("/") for pose in poses}
    if len(frames) > 1:
        mistakes.append(f"the poses of a course are in one frame, and these are in {', '.join(sorted(frames))}")
    for index, stamped in enumerate(poses[: MOST + 1]):
        point, turn = stamped.pose.position, stamped.pose.orientation
        counts = orientations == "all" or (orientations == "goal" and index == len(poses) - 1)
        try:
            numbers = [point.x, point.y]
            if counts and (yaw := _yaw_of(turn)) is not None:
                numbers.append(yaw)
            waypoints.append(waypoint_of_numbers(numbers))
        except ValueError as error:
            mistakes.append(f"poses[{index}]: {error}")
    if mistakes:
        raise CourseError("\n".join(mistakes))
    return Course(tuple(waypoints), frames.pop() if frames else frame, laps, first)


def _yaw_of(turn: Quaternion) -> float | None:
    if not any((turn.x, turn.y, turn.z, turn.w)):
        return None
    yaw = yaw_from_quaternion(turn)
    if not math.isfinite(yaw):
        raise ValueError("its orientation is not finite")
    return yaw


def load(path: str, laps: int = 1) -> Course:
    """Read a course file.

    Raises:
        CourseError: it is missing, unreadable or has mistakes; says where each of them is.
    """
    lean.import_yaml()
    from robo.text.tree import Map, Problem, Scalar, kind
    from robo.text.yaml_tree import parse  # a node without a course file carries no YAML

    try:
        text = read_text(path)
    except UnreadableFile as error:
        raise CourseError(f"course file {path} cannot be read: {error}") from None
    problems: list[Problem] = []
    tree = parse(text, path, problems)
    waypoints: tuple[Waypoint, ...] = ()
    frame = ""
    if isinstance(tree, Map):
        for entry in tree:
            if entry.key == "waypoints":
                waypoints = _waypoints_of_tree(entry.value, problems)
            elif entry.key != "frame":
                text = f"unknown key {entry.key!r}; a course has waypoints, frame"
                problems.append(Problem(entry.position, text))
            elif isinstance(entry.value, Scalar) and isinstance(entry.value.value, str):
                frame = entry.value.value.removeprefix("/")
            else:
                text = f"frame: expected a name, not {kind(entry.value)}"
                problems.append(Problem(entry.value.position, text))
        if tree.get("waypoints") is None and not problems:
            problems.append(Problem(tree.position, "expected waypoints: a list of [x, y] or [x, y, yaw]"))
    elif tree is not None:
        problems.append(Problem(tree.position, "expected a map with waypoints"))
    if problems:
        raise CourseError("\n".join(map(str, problems)))
    try:
        return Course(waypoints, frame, laps)
    except CourseError as error:
        raise CourseError(f"course file {path}: {error}") from None


def _waypoints_of_tree(tree: "Tree", problems: "list[Problem]") -> tuple[Waypoint, ...]:
    from robo.text.tree import Items, Map, Problem, kind, locate, plain

    def waypoint(item: "Tree", name: str) -> Waypoint | None:
        if not isinstance(item, Map):
            try:
                return waypoint_of_numbers(plain(item))
            except ValueError as error:
                problems.append(Problem(item.position, f"{name}: {error}"))
                return None
        known = Waypoint.__struct_fields__
        unknown = [entry for entry in item if entry.key not in known]
        for entry in unknown:
            text = f"{name}: unknown key {entry.key!r}; a waypoint has {', '.join(known)}"
            problems.append(Problem(entry.position, text))
        if unknown:
            return None
        for entry in item:
            value = plain(entry.value)
            if isinstance(value, float) and not math.isfinite(value):
                problems.append(Problem(entry.value.position, f"{name}.{entry.key}: expected a finite number"))
                return None
        try:
            return msgspec.convert(plain(item), readable(Waypoint))
        except msgspec.ValidationError as error:
            path = str(error).partition(" - at `$")[2].rstrip("`")
            problems.append(Problem(locate(item, path), f"{name}: {_plain(error)}"))
            return None

    if not isinstance(tree, Items):
        problems.append(Problem(tree.position, f"waypoints: expected a list, not {kind(tree)}"))
        return ()
    found = [waypoint(item, f"waypoints[{index}]") for index, item in enumerate(tree.items)]
    return tuple(one for one in found if one is not None)
