"""Which frame stands in which, of all robots; whose base moves, and who says so. Pure."""

import math
from collections.abc import Iterable, Iterator
from typing import Final

from robo.bridges.rerun.marks import Axes, Colour, Mark, Moved, Place, Strips
from robo_messages import Odometry, TFMessage

WORLD: Final = "world"
"""The frame in which the outermost frames of all robots stand."""
TRAIL: Final = "trail"

Turn = tuple[float, float, float, float]
"""A quaternion: x, y, z, w."""

_BASES = ("base_link", "base_footprint")
_TF, _TF_STATIC = "tf", "tf_static"
_STEP = 0.05
"""By which a base has moved where its trail goes on, m."""
_MOST_FRAMES = 2_000
_FARTHEST = 1e9
"""What is further away is no place, m."""
_TRAIL: Colour = (80, 160, 255)
_UNTURNED: Turn = (0.0, 0.0, 0.0, 1.0)


class Frames:
    """Knows what has been said of frames and bases.

    A frame has its name within a namespace: that of the nearest `tf` or `tf_static` above a topic, or else the
    topic's own. So `r1/front/scan` and `r1/tf` mean the same `laser`.
    """

    def __init__(self, topics: Iterable[str] = ()) -> None:
        """
        Args:
            topics: those that will come, where they are known before.
        """
        self._spaces: set[str] = set()
        self._parents: dict[str, str] = {}
        self._roots: set[str] = set()
        self._trails: dict[str, tuple[str, Place]] = {}
        """Of each robot the frame in which its base moves, and where it was."""
        self._bases: dict[str, str] = {}
        """Of each robot the frame whose way is its trail."""
        self._seen: set[str] = set()
        """Robots whose base is to be seen."""
        self._odometry: dict[str, str] = {}
        """Frames that odometry moves, and its topic."""
        for topic in topics:
            self._learn(topic)

    @property
    def trails(self) -> list[str]:
        """Where the ways of robots are drawn."""
        return [f"{robot or 'robot'}/{TRAIL}" for robot in self._trails]

    def named(self, key: str, frame: str) -> str:
        """A frame that a topic names, among those of all robots."""
        return _within(self._space(key), frame)

    def transforms(self, key: str, message: TFMessage) -> Iterator[Mark]:
        """Transforms have come."""
        self._learn(key)
        always = key.rpartition("/")[2] == _TF_STATIC
        robot = self._space(key)
        for one in message.transforms:
            child = _within(robot, one.child_frame_id)
            if self._odometry.pop(child, None) is not None:  # from now on it is told by transforms
                self._bases.pop(robot, None)
            at, q = one.transform.translation, one.transform.rotation
            names = (one.header.frame_id, one.child_frame_id)
            yield from self._moved(robot, names, (at.x, at.y, at.z), (q.x, q.y, q.z, q.w), always)

    def odometry(self, key: str, message: Odometry) -> Iterator[Mark]:
        """Odometry has come: it moves what no transform does; of several that called `odom`, or the first."""
        robot, name = self._space(key), message.child_frame_id or _BASES[0]
        child = _within(robot, name)
        by = self._odometry.get(child)
        if by is None and child in self._parents:
            return
        if by is not None and by != key and not (_is_odom(key) and not _is_odom(by)):
            return
        self._odometry[child] = key
        if by != key:
            self._trails.pop(robot, None)  # another one says another place
        pose = message.pose.pose
        at, q = pose.position, pose.orientation
        names = (message.header.frame_id or "odom", name)
        yield from self._moved(robot, names, (at.x, at.y, at.z), (q.x, q.y, q.z, q.w), False)

    def _learn(self, key: str) -> None:
        space, _, name = key.rpartition("/")
        if name in (_TF, _TF_STATIC):
            self._spaces.add(space)

    def _space(self, key: str) -> str:
        above = here = key.rpartition("/")[0]
        while above not in self._spaces:
            if not above:
                return here
            above = above.rpartition("/")[0]
        return above

    def _moved(self, robot: str, names: tuple[str, str], at: Place, turned: Turn, always: bool) -> Iterator[Mark]:
        parent, child = (_within(robot, name) for name in names)
        if not all(map(math.isfinite, (*at, *turned))) or max(map(abs, at)) > _FARTHEST or parent == child:
            return
        if child not in self._parents and len(self._parents) >= _MOST_FRAMES:
            return
        self._parents[child] = parent
        self._roots.discard(child)
        # Some drivers send zeros, and mean no turn.
        yield Moved(_place_of(robot, child), parent, child, at, turned if any(turned) else _UNTURNED, always)
        if parent not in self._parents and parent not in self._roots and len(self._roots) < _MOST_FRAMES:
            self._roots.add(parent)
            yield Moved(_place_of(robot, parent), WORLD, parent, (0.0, 0.0, 0.0), _UNTURNED)
        outer, inner = (name.lstrip("/") for name in names)
        if inner in _BASES:
            if robot not in self._seen:
                self._seen.add(robot)
                yield Axes(f"{robot or 'robot'}/base", child, 0.3)
            # A robot often has both bases, one in the other: the outer one goes through the world.
            if not always and outer not in _BASES and self._bases.setdefault(robot, child) == child:
                yield from self._trail(robot, parent, at)

    def _trail(self, robot: str, frame: str, at: Place) -> Iterator[Mark]:
        in_frame, before = self._trails.get(robot, ("", at))
        way = math.dist(before, at)
        if in_frame == frame and way < _STEP:
            return
        self._trails[robot] = (frame, at)
        if in_frame == frame and way < 20 * _STEP:  # further it was put, or somebody has not looked for long
            yield Strips(f"{robot or 'robot'}/{TRAIL}", frame, [[before, at]], _TRAIL, 0.015)


def _within(robot: str, name: str) -> str:
    name = name.lstrip("/")
    return f"{robot}/{name}" if robot else name


def _place_of(robot: str, frame: str) -> str:
    return f"{robot or 'robot'}/tf/{frame.removeprefix(f'{robot}/')}"


def _is_odom(key: str) -> bool:
    return key.rpartition("/")[2] == "odom"
