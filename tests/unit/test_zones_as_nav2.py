"""Zones beside a plain model of what nav2's collision monitor does with the same commands, where both mean the same.

nav2 (`CollisionMonitor::process`, `Polygon::getCollisionTime`) multiplies a command by 0 for `stop`, by the
`slowdown_ratio`, by the least of 1, linear_limit/|v| and angular_limit/|ω| for `limit`, and by the time to collision
divided by `time_before_collision` for `approach`; the smallest velocity wins. It finds that time in steps. It means the
points that are inside at one moment; here those count that are touched until then: with one point that is the same.
"""

import math
import random

import pytest

from robo_services.collision import Sighting
from robo_services.contact import Velocity, polygon
from robo_services.kinematics import Pose2
from robo_services.obstacles import Obstacle, moved_by
from robo_services.zones import Zone, verdicts

STEP = 0.01
"""nav2's simulation_time_step, s; by default it is 0.1, and what is brushed between two steps is not seen."""

Points = list[tuple[float, float]]


def box(front: float, side: float, back: float) -> Points:
    return [(front, side), (-back, side), (-back, -side), (front, -side)]


ZONES = [
    Zone(name="stop", action="stop", shape=polygon(box(0.4, 0.3, 0.3)), min_points=3),
    Zone(name="slow", action="slow_down", shape=polygon(box(0.8, 0.5, 0.5)), share=0.3, min_points=3),
    Zone(name="limit", action="limit", shape=polygon(box(1.2, 0.8, 0.8)), max_speed=0.4, max_turn=0.5, min_points=3),
    Zone(name="near", action="approach", shape=polygon(box(0.3, 0.25, 0.3)), time=2.0),
]


def inside(corners: Points, x: float, y: float) -> bool:
    xs, ys = [corner[0] for corner in corners], [corner[1] for corner in corners]
    return min(xs) <= x <= max(xs) and min(ys) <= y <= max(ys)


def collision_time(zone: Zone, command: Velocity, points: Points) -> float | None:
    """The time of the last step before the one in which enough points are inside."""
    for step in range(round(zone.time / STEP) + 1):
        at = moved_by(Pose2(), command, (step + 1) * STEP)
        cos, sin = math.cos(at.yaw), math.sin(at.yaw)
        moved = [(cos * (x - at.x) + sin * (y - at.y), cos * (y - at.y) - sin * (x - at.x)) for x, y in points]
        if sum(inside(list(zone.shape.corners), x, y) for x, y in moved) >= zone.min_points:
            return step * STEP
    return None


def share_of(zone: Zone, command: Velocity, points: Points) -> tuple[float, float]:
    """The least and the most that nav2's share may differ to, as it looks only at each step."""
    if zone.action == "approach":
        time = collision_time(zone, command, points)
        return (1.0, 1.0) if time is None else (min(1.0, time / zone.time), min(1.0, (time + STEP) / zone.time))
    share = 1.0
    if sum(inside(list(zone.shape.corners), x, y) for x, y in points) >= zone.min_points:
        limited = min(1.0, zone.max_speed / command.speed, zone.max_turn / max(abs(command.turn), 1e-9))
        share = {"stop": 0.0, "slow_down": zone.share, "limit": limited}[zone.action]
    return share, share


@pytest.mark.parametrize("seed", range(8))
def test_a_drive_is_slowed_down_as_by_nav2(seed: int) -> None:
    rng = random.Random(seed)
    pose, acted = Pose2(), set()
    wall = [(1.5 + rng.uniform(0.0, 0.02), y / 100) for y in range(-150, 151, 3)]
    for _ in range(30):
        command = Velocity(rng.uniform(0.1, 1.0), 0.0, rng.uniform(-1.0, 1.0))
        cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
        points = [(cos * (x - pose.x) + sin * (y - pose.y), cos * (y - pose.y) - sin * (x - pose.x)) for x, y in wall]
        seen = [Sighting(source="scan", obstacles=sorted(Obstacle(math.hypot(x, y), x, y) for x, y in points))]
        found = verdicts(command, ZONES, seen)
        share = min((verdict.share for verdict in found), default=1.0)
        low, high = (min(each) for each in zip(*(share_of(zone, command, points) for zone in ZONES), strict=True))
        assert low - 2 * STEP <= share <= high + 1e-9
        acted |= {verdict.zone.action for verdict in found}
        pose = moved_by(pose, command.scaled(share), 0.15)
    assert acted >= {"slow_down", "limit"}
