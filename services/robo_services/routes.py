"""The way through waypoints: straight lines, and arcs that round their corners; by its length, in the plane.

A corner by an angle θ is rounded by an arc that touches both of its sides, at a distance t from the corner, and passes
the corner at a distance d:

    t = r·tan(θ/2),   d = r·(1/cos(θ/2) - 1)

So r follows from how far from the waypoint the way may be, and from the length of the sides: an arc takes at most
half of each, and the rest belongs to the next corner. Where the way turns back, or the robot is to stand, the corner
stays as it is.
"""

import math
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

from robo_services.kinematics import Pose2, advance
from robo_services.planar import angle_difference, normalize_angle

SAME = 1e-3
"""Waypoints that are nearer to each other, m, are one place."""
SHARPEST = 2.0
"""Corners that turn by more, rad, are not rounded: the robot stands there and turns."""
STRAIGHT = 1e-6
"""Corners that turn by less, rad, are none."""


class Goal(NamedTuple):
    """A waypoint, as far as the way goes by it."""

    x: float
    """m."""
    y: float
    """m."""
    slack: float
    """How far from it the way may pass, m."""
    stands: bool = False
    """Whether the robot is to stand there; then the way leads to the very point."""


class Piece(NamedTuple):
    """A part of the way: a line or an arc."""

    begin: Pose2
    length: float
    """m."""
    curvature: float
    """1/m, positive to the left; 0 of a line."""
    start: float
    """The length of the way before it, m."""
    goal: int
    """The number of the goal that it leads to, or by."""

    def at(self, along: float) -> Pose2:
        """The pose after `along` m of it."""
        return advance(self.begin, 1.0, self.curvature, along)

    def nearest(self, x: float, y: float) -> float:
        """How far along it is nearest to a point, m."""
        dx, dy = x - self.begin.x, y - self.begin.y
        cos, sin = math.cos(self.begin.yaw), math.sin(self.begin.yaw)
        ahead, left = cos * dx + sin * dy, cos * dy - sin * dx
        if self.curvature == 0.0:
            return max(0.0, min(self.length, ahead))
        # Seen from the arc's middle, the angle to the point, the same way round as the arc, from its beginning on.
        bend = math.copysign(1.0, self.curvature)
        angle = math.atan2(ahead, 1.0 / abs(self.curvature) - bend * left)
        whole = self.length * abs(self.curvature)
        if not 0.0 <= angle <= whole:
            before, behind = abs(angle), abs(angle_difference(angle, whole))
            angle = 0.0 if before <= behind else whole
        return min(self.length, angle / abs(self.curvature))


class Route(NamedTuple):
    """The whole way."""

    pieces: tuple[Piece, ...]
    """At least one."""
    starts: tuple[float, ...]
    """Of all pieces, m."""
    marks: tuple[float, ...]
    """Where the way is nearest to each goal, m."""
    stands: tuple[bool, ...]
    """At which goals the robot stands, those included where the way turns back."""
    halts: tuple[float, ...]
    """Where it stands next, for who goes to each goal, m; infinite where it does not any more."""

    @property
    def length(self) -> float:
        """Its length, m."""
        return self.pieces[-1].start + self.pieces[-1].length

    def at(self, along: float) -> Pose2:
        """The pose after `along` m, which may be any number: before the beginning and behind the end it is theirs."""
        piece = self.pieces[self.number(along)]
        return piece.at(max(0.0, min(piece.length, along - piece.start)))

    def number(self, along: float) -> int:
        """The number of the piece after `along` m."""
        return max(0, bisect_right(self.starts, along) - 1)

    def nearest(self, x: float, y: float, low: float, high: float) -> float:
        """Where between `low` and `high` the way is nearest to a point, m."""
        best, found = math.inf, low
        for piece in self.pieces[self.number(low) : self.number(high) + 1]:
            along = max(low, min(high, piece.start + piece.nearest(x, y)))
            pose = piece.at(along - piece.start)
            distance = math.hypot(pose.x - x, pose.y - y)
            if distance < best:
                best, found = distance, along
        return found

    def poses(self, step: float = 0.2) -> Iterator[Pose2]:
        """Poses that show the way: the ends of its lines, and on its arcs one at least each `step` rad."""
        for piece in self.pieces:
            count = max(1, math.ceil(piece.length * abs(piece.curvature) / step))
            yield from (piece.at(piece.length * i / count) for i in range(count))
        yield self.at(self.length)


class _Corner:
    """A place that the way goes by: one goal, or several that are the same place."""

    def __init__(self, x: float, y: float) -> None:
        self.x = x
        self.y = y
        self.goals: list[int] = []
        self.slack = math.inf
        self.stands = False
        self.cut = 0.0
        """How far from it its arc begins and ends, m."""
        self.radius = 0.0
        """Of its arc, m, positive to the left; 0 where there is none."""


def route_through(begin: tuple[float, float], goals: Sequence[Goal]) -> Route:
    """The way from a point through all goals; it ends at the last one.

    Args:
        begin: where it begins, m.
        goals: at least one; finite numbers.
    """
    corners = _corners(begin, goals)
    sides = [(math.hypot(b.x - a.x, b.y - a.y), math.atan2(b.y - a.y, b.x - a.x)) for a, b in _pairs(corners)]
    for corner, (before, arrives), (after, leaves) in zip(corners[1:], sides, sides[1:], strict=False):
        _round_off(corner, angle_difference(leaves, arrives), min(before, after) / 2)
    marks = [0.0] * len(goals)
    pieces: list[Piece] = []
    along = 0.0
    for (a, b), (side, yaw) in zip(_pairs(corners), sides, strict=True):
        length = max(0.0, side - a.cut - b.cut)
        cos, sin = math.cos(yaw), math.sin(yaw)
        if length > 0.0:
            start = Pose2(a.x + a.cut * cos, a.y + a.cut * sin, normalize_angle(yaw))
            pieces.append(Piece(start, length, 0.0, along, b.goals[0]))
            along += length
        arc = 0.0
        if b.radius:
            arc = 2 * math.atan(b.cut / abs(b.radius)) * abs(b.radius)
            start = Pose2(b.x - b.cut * cos, b.y - b.cut * sin, normalize_angle(yaw))
            pieces.append(Piece(start, arc, 1.0 / b.radius, along, b.goals[0]))
        for goal in b.goals:
            marks[goal] = along + arc / 2
        along += arc
    pieces = pieces or [Piece(Pose2(*begin), 0.0, 0.0, 0.0, 0)]
    stands = [goal.stands for goal in goals]
    for corner in corners:
        for number in corner.goals:
            stands[number] |= corner.stands
    halts = [math.inf] * len(goals)
    for number in reversed(range(len(goals))):
        later = halts[number + 1] if number + 1 < len(goals) else math.inf
        halts[number] = marks[number] if stands[number] else later
    return Route(tuple(pieces), tuple(piece.start for piece in pieces), tuple(marks), tuple(stands), tuple(halts))


def _corners(begin: tuple[float, float], goals: Iterable[Goal]) -> list[_Corner]:
    corners = [_Corner(*begin)]
    for number, goal in enumerate(goals):
        if math.hypot(goal.x - corners[-1].x, goal.y - corners[-1].y) >= SAME:
            corners.append(_Corner(goal.x, goal.y))
        corner = corners[-1]
        corner.goals.append(number)
        corner.slack = min(corner.slack, goal.slack)
        corner.stands |= goal.stands
    return corners


def _pairs(corners: Sequence[_Corner]) -> list[tuple[_Corner, _Corner]]:
    return list(pairwise(corners))


def _round_off(corner: _Corner, turn: float, room: float) -> None:
    """Give a corner its arc, or have the robot stand there."""
    if abs(turn) > SHARPEST:
        corner.stands = True
    if corner.stands or abs(turn) < STRAIGHT:
        return
    half = math.tan(abs(turn) / 2)
    # 1/cos - 1 of a small angle is a difference of two numbers near 1: tan(θ/2)·tan(θ/4) is the same.
    radius = min(corner.slack / (half * math.tan(abs(turn) / 4)), room / half)
    corner.cut = radius * half
    corner.radius = math.copysign(radius, turn)
