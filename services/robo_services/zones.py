"""Zones around a robot, and what happens to its commands while something is in one of them: pure."""

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import msgspec

from robo_services.collision import Sighting
from robo_services.contact import Shape, Sweep, Velocity
from robo_services.obstacles import Obstacle

ZoneAction = Literal["stop", "slow_down", "limit", "approach"]


class Zone(msgspec.Struct, frozen=True, kw_only=True):
    """A place around the robot, and what is done while something is in it."""

    name: str
    action: ZoneAction
    """`stop`; `slow_down` to a share of what is commanded; `limit` the speeds; `approach`: as slow as it takes for
    the time to contact with the zone's shape, along the commanded arc, to be at least `time`."""
    shape: Shape
    """In the base's frame."""
    time: float = 0.0
    """s. Of `approach` the least time to contact. Of others how far the zone grows with speed: it is also what the
    shape covers within this time on the commanded arc."""
    share: float = 0.5
    """`slow_down`: of the commanded velocities."""
    max_speed: float = math.inf
    """`limit`: m/s."""
    max_turn: float = math.inf
    """`limit`: rad/s."""
    min_points: int = 1
    """How many points, of all its sources together, make something; fewer are noise."""
    sources: tuple[str, ...] = ()
    """Whose points count; empty for those of all."""


class Verdict(NamedTuple):
    """What a zone makes of a command."""

    share: float
    """Of the commanded velocities that is passed on, 0 to 1."""
    zone: Zone
    source: str
    distance: float
    """From the zone's shape to the nearest of its points, m; 0 for one that is inside."""
    time: float
    """Until the shape touches enough points along the commanded arc, s."""


def verdicts(command: Velocity, zones: Sequence[Zone], sightings: Sequence[Sighting]) -> list[Verdict]:
    """What each zone in which something is makes of a command; zones that leave it as it is are left out."""
    found = []
    for zone in zones:
        reach = zone.shape.reach + command.speed * zone.time
        near = [
            (obstacle, sighting.source)
            for sighting in sightings
            if not zone.sources or sighting.source in zone.sources
            for obstacle in sighting.within(reach)
        ]
        if sum(obstacle.points for obstacle, _ in near) < zone.min_points:
            continue
        contact = _contact(command, zone, near)
        if contact is not None:
            time, distance, source = contact
            share = _share(command, zone, time)
            if share < 1.0:
                found.append(Verdict(share, zone, source, distance, time))
    return found


def _contact(command: Velocity, zone: Zone, near: Sequence[tuple[Obstacle, str]]) -> tuple[float, float, str] | None:
    """When the zone's shape has touched enough points, s; how far the nearest of these is from it, m; who sees that."""
    sweep = Sweep(zone.shape, command) if zone.time > 0.0 else None
    touched = []
    for obstacle, source in near:
        distance = zone.shape.distance(obstacle.x, obstacle.y)
        time = 0.0 if distance <= 0.0 else math.inf if sweep is None else sweep.time(obstacle.x, obstacle.y)
        if time <= zone.time:
            touched.append((time, max(0.0, distance), source, obstacle.points))
    touched.sort()
    count, nearest = 0, (math.inf, "")
    for time, distance, source, points in touched:
        count, nearest = count + points, min(nearest, (distance, source))
        if count >= zone.min_points:
            return time, *nearest
    return None


def _share(command: Velocity, zone: Zone, time: float) -> float:
    if zone.action == "stop":
        return 0.0
    if zone.action == "slow_down":
        return zone.share
    if zone.action == "limit":
        return min(_fraction(zone.max_speed, command.speed), _fraction(zone.max_turn, abs(command.turn)))
    return _fraction(time, zone.time)


def _fraction(limit: float, value: float) -> float:
    return 1.0 if value <= limit else limit / value
