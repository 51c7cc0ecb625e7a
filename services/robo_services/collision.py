"""How fast a robot may go on the arc that is commanded, so that it can stop before it touches anything: pure.

The rule: from now on the robot drives on for as long as a new command takes to have an effect, and then brakes; on that
way its footprint touches nothing. With a share s of the commanded velocities, which are for the same arc, it covers in
the time of reaction r what takes s·r at full speed, and while it brakes s²·b/2, where b is the time in which it stops
from full speed. So with a time to contact t on the arc

    s·r + s²·b/2 ≤ t                                                                                       (1)

and the largest s is a root. A robot that holds this at every moment can stop at every moment. It has to hold as well
for the way on which it really is, as measured, and for those between that and the commanded one, which it takes
meanwhile.

Where obstacles may move, each may be nearer by their speed times the time until the robot stands, r + s·b: the faster
the robot, the more room it leaves.
"""

import math
from bisect import bisect_right
from collections.abc import Sequence
from typing import NamedTuple

import msgspec

from robo_services.contact import Shape, Sweep, Velocity, closing_speed
from robo_services.kinematics import Pose2
from robo_services.obstacles import Obstacle

TOLERANCE = 1e-3
"""How much nearer to what it is beside already a robot may come by rounding, m."""

NEGLIGIBLE = 2e-3
"""A measured motion that ends within this way is none, m: odometry trembles."""

TURN_STEP = 0.75
"""Between the arcs that are looked at on the way to another one, rad/s: within 0.4 s 3 cm apart at 1 m/s."""

ALIKE = 0.02
"""Velocities that differ by less are the same, m/s or rad/s."""

_MOST_ARCS = 12
_HALVINGS = 6

_Near = tuple[float, float, float]
"""How far an obstacle is from the footprint, m, and its x and y."""


class Body(msgspec.Struct, frozen=True, kw_only=True):
    """The robot as something that may bump."""

    footprint: Shape
    """In the base's frame."""
    margin: float = 0.05
    """How far from everything its surface is to stay, m; half of it where it is nearer already."""
    reaction_time: float = 0.2
    """From a decision until the base does what it says, s."""
    deceleration: float = 2.0
    """How the base brakes at the least, m/s²."""
    angular_deceleration: float = 3.0
    """How it stops turning, rad/s²."""
    obstacle_speed: float = 0.0
    """How fast obstacles may be, m/s."""

    def stopping_time(self, velocity: Velocity) -> float:
        """How long it brakes, s. Where a robot that is round around its origin looks does not matter."""
        braking = velocity.speed / self.deceleration
        if self.footprint.corners == ((0.0, 0.0),):
            return braking
        return max(braking, abs(velocity.turn) / self.angular_deceleration)


class Sighting(msgspec.Struct, frozen=True, kw_only=True):
    """What a source has said last."""

    source: str
    obstacles: Sequence[Obstacle] = ()
    """In the base's frame when it was measured, the nearest first."""
    age: float = 0.0
    """s."""
    moved: Pose2 = Pose2()
    """Where the base is by now, in its frame when it was measured."""

    def within(self, reach: float) -> list[Obstacle]:
        """What may be within `reach` m of the base's origin now, in its present frame."""
        dx, dy, yaw = self.moved
        end = bisect_right(self.obstacles, (reach + math.hypot(dx, dy), math.inf, math.inf, math.inf))
        near = self.obstacles[:end]
        if not dx and not dy and not yaw:
            return list(near)
        cos, sin = math.cos(yaw), math.sin(yaw)
        return [
            Obstacle(distance, cos * (x - dx) + sin * (y - dy), cos * (y - dy) - sin * (x - dx), points)
            for distance, x, y, points in near
        ]


class Finding(NamedTuple):
    """What speaks against a command."""

    share: float
    """Of the commanded velocities that is free, 0 to 1."""
    source: str = ""
    distance: float = math.inf
    """From the footprint to what is touched first, now, m."""
    time: float = math.inf
    """Until that is touched, if the command were obeyed, s."""


FREE = Finding(1.0)


def free_share(command: Velocity, measured: Velocity, body: Body, sightings: Sequence[Sighting]) -> Finding:
    """How much of a command may be passed on.

    Args:
        command: what is wanted; finite.
        measured: how the robot moves; finite.
        body: the robot.
        sightings: what there is around it.
    """
    worst = FREE
    for sighting in sightings:
        around = _Around(body, sighting, command, measured)
        if not around.obstacles:
            continue
        found = around.share_of(command)
        if found.share == 1.0 and _leads_there(measured, command):
            continue
        if found.share > 0.0 and not all(around.stops_in_time(*way) for way in ways_to(command, measured, body)):
            found = Finding(0.0, sighting.source, around.nearest, found.time)
        if found.share < worst.share:
            worst = found
    return worst


def _leads_there(measured: Velocity, command: Velocity) -> bool:
    """Whether a robot that moves so is on the commanded arc, and no faster: then that has been looked at."""
    along = command.x * measured.x + command.y * measured.y
    off = abs(measured.turn * command.speed - command.turn * measured.speed)
    return (
        measured.speed <= command.speed + ALIKE
        and abs(measured.turn) <= abs(command.turn) + ALIKE
        and along >= 0.0
        and off <= ALIKE * command.speed
    )


def ways_to(command: Velocity, measured: Velocity, body: Body) -> list[tuple[Velocity, float]]:
    """The motions between the present one and the commanded one, each with how long it may last before it is braked."""
    path = (measured.speed + abs(measured.turn) * body.footprint.reach) * body.stopping_time(measured) / 2
    if path < NEGLIGIBLE:
        return []  # it stands, and what it is commanded is looked at by itself
    ways = [(measured, 0.0)]
    change = abs(command.turn - measured.turn)
    along = command.x * measured.x + command.y * measured.y
    count = math.ceil(min(_MOST_ARCS, change / TURN_STEP)) if along > 0.0 else 0
    for i in range(1, count):
        part = i / count
        between = (a + part * (b - a) for a, b in zip(measured, command, strict=True))
        ways.append((Velocity(*between), part * body.reaction_time))
    return ways


class _Around:
    """What is near a robot, as one source sees it."""

    def __init__(self, body: Body, sighting: Sighting, command: Velocity, measured: Velocity) -> None:
        self._body, self._source = body, sighting.source
        reach = body.footprint.reach + body.margin
        for velocity in (command, measured):
            stops = body.reaction_time + body.stopping_time(velocity)
            reach = max(reach, body.footprint.reach + body.margin + (velocity.speed + body.obstacle_speed) * stops)
        footprint = body.footprint
        self.obstacles = [(footprint.distance(o.x, o.y), o.x, o.y) for o in sighting.within(reach)]
        outside = [distance for distance, _, _ in self.obstacles if distance >= 0.0]
        self.nearest = min(outside, default=math.inf)

    def share_of(self, command: Velocity) -> Finding:
        """How much of a command is free."""
        reaction, braking = self._body.reaction_time, self._body.stopping_time(command)
        obstacles, time, distance = self._touched(self.obstacles, command, reaction + braking, reaction + braking / 2)
        share = _within(time, reaction, braking)
        if share == 1.0:
            return FREE
        if not self._body.obstacle_speed:
            return Finding(share, self._source, distance, time)
        # A slower robot leaves less room for what may move, and what it would not touch at full speed it does not then.
        low, high = 0.0, 1.0
        for _ in range(_HALVINGS):
            tried = (low + high) / 2
            _, later, _ = self._touched(obstacles, command, reaction + tried * braking, reaction + braking / 2)
            low, high = (tried, high) if _within(later, reaction, braking) >= tried else (low, tried)
        return Finding(low, self._source, distance, time)

    def stops_in_time(self, velocity: Velocity, lasting: float) -> bool:
        """Whether the robot, when it moves so for a while and then brakes, touches nothing."""
        braking = self._body.stopping_time(velocity)
        needed = lasting + braking / 2
        _, time, _ = self._touched(self.obstacles, velocity, lasting + braking, needed)
        return time >= needed

    def _touched(
        self, obstacles: Sequence[_Near], velocity: Velocity, waiting: float, horizon: float
    ) -> tuple[list[_Near], float, float]:
        """What the footprint, or the margin around it, touches soon; when it does first, s; how far that is now, m.

        Args:
            obstacles: what may be touched.
            velocity: of the robot.
            waiting: how long obstacles may come nearer, s.
            horizon: what is touched later does not matter, s.
        """
        body = self._body
        moved = body.obstacle_speed * waiting
        inner = max(body.margin / 2, moved)
        margin = max(inner, min(body.margin + moved, self.nearest)) - TOLERANCE
        sweep = Sweep(body.footprint, velocity, margin)
        reach = margin + (velocity.speed + abs(velocity.turn) * body.footprint.reach) * horizon
        touched, first, at = [], math.inf, math.inf
        for obstacle in obstacles:
            distance, x, y = obstacle
            if distance > reach:
                continue
            if distance > margin:
                time = sweep.time(x, y)
            else:
                time = 0.0 if self._comes_nearer(distance, x, y, velocity) else math.inf
            if time <= horizon:
                touched.append(obstacle)
                if time < first:
                    first, at = time, distance
        return touched, first, at

    def _comes_nearer(self, distance: float, x: float, y: float, velocity: Velocity) -> bool:
        # Far within the footprint it is something of its own, or touched: away from it is that way. What is near the
        # outline may as well be outside, as far as a sensor can tell.
        if distance < -self._body.margin:
            return velocity.x * x + velocity.y * y > 0.0
        return closing_speed(self._body.footprint, x, y, velocity) > 0.0


def _within(time: float, reaction: float, braking: float) -> float:
    """The largest share s, up to 1, for which (1) holds."""
    if time >= reaction + braking / 2:
        return 1.0
    if braking <= 0.0:
        return time / reaction
    return (math.sqrt(reaction * reaction + 2 * braking * time) - reaction) / braking
