"""When a shape that moves on an exact arc touches a point: pure geometry in the plane, in the robot's base frame.

Seen from the robot it is the point that moves. With constant velocities (vx, vy, ω) it turns by -ω·t around the centre
of the arc c = (-vy/ω, vx/ω), which is the same for all points, or, where ω is 0, along a line. A shape is a point or a
polygon, with everything within a radius of it: its surface consists of arcs around its corners and of lines beside its
edges. So each time of contact is where a circle meets a circle or a line, and has a closed form: nothing is sampled.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

STRAIGHT = 1e-4
"""Below so many rad/s an arc is taken for a line: within 2 s at 1 m/s it leaves that by 0.2 mm."""


ROUNDING = 1e-9
"""What meets a corner meets one of its sides, though by rounding it is beside both, m."""


class Velocity(NamedTuple):
    """How the base moves."""

    x: float = 0.0
    """Forward, m/s."""
    y: float = 0.0
    """To the left, m/s."""
    turn: float = 0.0
    """Around z, to the left, rad/s."""

    @property
    def speed(self) -> float:
        """Of the base's origin, m/s."""
        return math.hypot(self.x, self.y)

    def scaled(self, share: float) -> "Velocity":
        """Slower on the same arc."""
        return Velocity(self.x * share, self.y * share, self.turn * share)


STANDING = Velocity()


class Edge(NamedTuple):
    """A side of a polygon, from a corner along a unit vector; outward is to the right of that."""

    x: float
    y: float
    ux: float
    uy: float
    length: float

    @property
    def normal(self) -> tuple[float, float]:
        """Outward."""
        return self.uy, -self.ux


class Shape(NamedTuple):
    """Everything within a radius of a point or a polygon. Made by `disc` and `polygon`."""

    corners: tuple[tuple[float, float], ...]
    """m; one for a disc, else counter-clockwise."""
    radius: float
    """m."""
    edges: tuple[Edge, ...] = ()

    @property
    def reach(self) -> float:
        """The distance of its furthest point from the base's origin, m."""
        return max(math.hypot(x, y) for x, y in self.corners) + self.radius

    def distance(self, x: float, y: float) -> float:
        """How far a point is from its surface, m; negative inside."""
        return self.nearest(x, y)[0]

    def nearest(self, x: float, y: float) -> tuple[float, float, float]:
        """How far a point is from its surface, m, negative inside; and the direction outward there."""
        if not self.edges:
            dx, dy = x - self.corners[0][0], y - self.corners[0][1]
            length = math.hypot(dx, dy)
            return (length - self.radius, dx / length, dy / length) if length > 0.0 else (-self.radius, 1.0, 0.0)
        inside, best, nx, ny = False, math.inf, 1.0, 0.0
        for edge in self.edges:
            dx, dy = x - edge.x, y - edge.y
            along = min(max(dx * edge.ux + dy * edge.uy, 0.0), edge.length)
            dx, dy = dx - along * edge.ux, dy - along * edge.uy
            length = math.hypot(dx, dy)
            if length < best:
                best = length
                nx, ny = (dx / length, dy / length) if length > 1e-12 else edge.normal
            above, was_above = edge.y + edge.length * edge.uy > y, edge.y > y
            if above != was_above and (y - edge.y) / edge.uy * edge.ux + edge.x > x:
                inside = not inside
        return (-best - self.radius, -nx, -ny) if inside else (best - self.radius, nx, ny)


def disc(radius: float, x: float = 0.0, y: float = 0.0) -> Shape:
    """A round shape.

    Raises:
        ValueError: a number is not finite, or the radius is negative.
    """
    if not (math.isfinite(radius) and math.isfinite(x) and math.isfinite(y) and radius >= 0.0):
        raise ValueError(f"a circle of {radius:g} m around {x:g}, {y:g}: these must be numbers, the radius at least 0")
    return Shape(((x, y),), radius)


def polygon(points: Sequence[tuple[float, float]]) -> Shape:
    """A shape with corners, in either order; it may have dents.

    Raises:
        ValueError: it has fewer than three corners, one is not finite or stands twice, its sides cross, or it is flat.
    """
    corners = [(float(x), float(y)) for x, y in points]
    if not all(math.isfinite(value) and abs(value) <= FURTHEST for corner in corners for value in corner):
        raise ValueError(f"a polygon with a corner that is no number, or further away than {FURTHEST:g} m")
    if len(corners) < 3:
        raise ValueError(f"a polygon has at least three corners, not {len(corners)}")
    following = corners[1:] + corners[:1]
    area = sum(ax * by - ay * bx for (ax, ay), (bx, by) in zip(corners, following, strict=True)) / 2
    if abs(area) < 1e-6:
        raise ValueError("a polygon that is flat")
    if area < 0.0:
        corners.reverse()
        following = corners[1:] + corners[:1]
    edges = []
    for (ax, ay), (bx, by) in zip(corners, following, strict=True):
        length = math.hypot(bx - ax, by - ay)
        if length < 1e-6:
            raise ValueError(f"a polygon with the corner {ax:g}, {ay:g} twice")
        edges.append(Edge(ax, ay, (bx - ax) / length, (by - ay) / length, length))
    sides = list(zip(corners, following, strict=True))
    for i, one in enumerate(sides):
        for other in sides[i + 2 : len(sides) - (i == 0)]:
            if _cross(*one, *other):
                raise ValueError("a polygon whose sides cross")
    return Shape(tuple(corners), 0.0, tuple(edges))


FURTHEST = 1e3
"""How far from the robot a corner may be, m."""


class Sweep:
    """A shape, grown by a margin, that moves at constant velocities: what it touches, and when."""

    def __init__(self, shape: Shape, velocity: Velocity, margin: float = 0.0) -> None:
        """`margin` is in m; velocities are finite."""
        self._radius = shape.radius + margin
        self._corners, self._edges = shape.corners, shape.edges
        self._velocity = velocity
        self._turns = abs(velocity.turn) >= STRAIGHT
        if self._turns:
            self._x, self._y = -velocity.y / velocity.turn, velocity.x / velocity.turn
            away = [math.hypot(x - self._x, y - self._y) for x, y in shape.corners]
            self._far = max(away) + self._radius
            self._near = max(0.0, shape.distance(self._x, self._y) - margin)
            self.time: Callable[[float, float], float] = self._time_of_arc if shape.edges else self._time_of_round_arc
            """When a point (x, y) that is outside now is touched first, s; infinite where it never is."""
        elif velocity.speed > 0.0:
            ux, uy = velocity.x / velocity.speed, velocity.y / velocity.speed
            self._x, self._y = ux, uy
            beside = [ux * y - uy * x for x, y in shape.corners]
            self._far, self._near = max(beside) + self._radius, min(beside) - self._radius
            self.time = self._time_of_line
        else:
            self.time = _never

    def _time_of_round_arc(self, x: float, y: float) -> float:
        """As `_time_of_arc`, for the one corner that a round shape has."""
        qx, qy = x - self._x, y - self._y
        square = qx * qx + qy * qy
        if not self._near * self._near < square < self._far * self._far:
            return math.inf
        (wx, wy), radius, turn = self._corners[0], self._radius, self._velocity.turn
        cx, cy = self._x - wx, self._y - wy
        across = cx * cx + cy * cy
        share = (radius * radius - across - square) / (2 * math.sqrt(across * square)) if across else 2.0
        if abs(share) >= 1.0:
            return math.inf
        # The angle from the one to the other side of the centre of the arc, the way it turns.
        ahead = math.atan2(qx * cy - qy * cx, -qx * cx - qy * cy)
        ahead, half = ahead if turn > 0.0 else -ahead, math.acos(-share)
        return 0.0 if abs(ahead) < half else (ahead - half) % math.tau / abs(turn)

    def _time_of_arc(self, x: float, y: float) -> float:
        qx, qy = x - self._x, y - self._y
        away = math.hypot(qx, qy)
        if not self._near < away < self._far:
            return math.inf
        turn, radius = self._velocity.turn, self._radius
        sign, angle, first = math.copysign(1.0, turn), math.atan2(qy, qx), math.inf
        if radius > 0.0:
            for wx, wy in self._corners:
                cx, cy = self._x - wx, self._y - wy
                centre = math.hypot(cx, cy)
                share = (radius * radius - centre * centre - away * away) / (2 * centre * away) if centre else 2.0
                if abs(share) < 1.0:
                    # It is nearest to the corner after it has turned by `ahead`, and enters `half` before that.
                    ahead = sign * math.remainder(angle - math.atan2(cy, cx) - math.pi, math.tau)
                    half = math.acos(-share)
                    if abs(ahead) < half:
                        return 0.0
                    first = min(first, (ahead - half) % math.tau)
        for edge in self._edges:
            nx, ny = edge.normal
            over = (nx * (edge.x - self._x) + ny * (edge.y - self._y) + radius) / away
            if abs(over) < 1.0:
                ahead = (sign * (angle - math.atan2(ny, nx)) + math.acos(over)) % math.tau
                if ahead < first:
                    there = angle - sign * ahead
                    px, py = self._x + away * math.cos(there), self._y + away * math.sin(there)
                    if -ROUNDING <= (px - edge.x) * edge.ux + (py - edge.y) * edge.uy <= edge.length + ROUNDING:
                        first = ahead
        return first / abs(turn)

    def _time_of_line(self, x: float, y: float) -> float:
        ux, uy, radius = self._x, self._y, self._radius
        if not self._near < ux * y - uy * x < self._far:
            return math.inf
        first = math.inf
        if radius > 0.0:
            for wx, wy in self._corners:
                dx, dy = x - wx, y - wy
                beside = ux * dy - uy * dx
                if abs(beside) < radius:
                    ahead, half = ux * dx + uy * dy, math.sqrt(radius * radius - beside * beside)
                    if ahead > -half:
                        first = min(first, max(0.0, ahead - half))
        for edge in self._edges:
            nx, ny = edge.normal
            closing = nx * ux + ny * uy
            if closing > 0.0:
                ahead = (nx * (x - edge.x) + ny * (y - edge.y) - radius) / closing
                if 0.0 <= ahead < first:
                    px, py = x - ux * ahead, y - uy * ahead
                    if -ROUNDING <= (px - edge.x) * edge.ux + (py - edge.y) * edge.uy <= edge.length + ROUNDING:
                        first = ahead
        return first / self._velocity.speed


def closing_speed(shape: Shape, x: float, y: float, velocity: Velocity) -> float:
    """How quickly a shape that moves comes nearer to a point, m/s; negative where it goes away."""
    _, nx, ny = shape.nearest(x, y)
    return (velocity.x - velocity.turn * y) * nx + (velocity.y + velocity.turn * x) * ny


def _never(_x: float, _y: float) -> float:
    return math.inf


def _cross(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float], d: tuple[float, float]) -> bool:
    """Whether the segments a-b and c-d meet."""

    def side(p: tuple[float, float], q: tuple[float, float], r: tuple[float, float]) -> float:
        return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])

    for axis in (0, 1):  # two on one line, one behind the other, do not
        if max(a[axis], b[axis]) < min(c[axis], d[axis]) or max(c[axis], d[axis]) < min(a[axis], b[axis]):
            return False
    return side(a, b, c) * side(a, b, d) <= 0.0 and side(c, d, a) * side(c, d, b) <= 0.0
