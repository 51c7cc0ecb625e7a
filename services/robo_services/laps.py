"""The way of one lap of a course."""

import math
from typing import NamedTuple

from robo_services.courses import Course, Waypoint
from robo_services.routes import Goal, Route, route_through

ROUNDED = 0.5
"""How much of a waypoint's tolerance corners may be rounded off by."""
TAIL = 10.0
"""How much of the next lap is seen from this one, m: more than what is needed to slow down."""


class Lap(NamedTuple):
    """The way of one lap, and a little of the next one."""

    route: Route
    goals: tuple[Waypoint, ...]
    numbers: tuple[int, ...]
    """Of the goals in the course."""
    size: int
    """How many goals belong to this lap; those behind them to the next one."""


def lap_of(course: Course, lap: int, begin: tuple[float, float], tolerance: float) -> Lap:
    """The way of a lap: the first one begins where the robot is, another one at the last waypoint.

    Args:
        course: to be driven.
        lap: its number, from 0.
        begin: where the robot is, m; of no matter but for the first lap.
        tolerance: of waypoints that have none of their own, m.
    """
    total = len(course.waypoints)
    numbers = list(range(course.first, total)) if lap == 0 else [total - 1, *range(total)]
    size = len(numbers)
    last = course.laps and lap + 1 >= course.laps
    way = 0.0
    if not last:
        for number in range(total):
            a, b = course.waypoints[numbers[-1]], course.waypoints[number]
            way += math.hypot(b.x - a.x, b.y - a.y)
            numbers.append(number)
            if way >= TAIL:
                break
    goals = tuple(course.waypoints[number] for number in numbers)
    ends = size - 1 if last else -1
    before = course.waypoints[total - 2 if total > 1 else 0]
    start = begin if lap == 0 else (before.x, before.y)
    route = route_through(
        start,
        [
            Goal(one.x, one.y, ROUNDED * (one.tolerance or tolerance), one.yaw is not None or index == ends)
            for index, one in enumerate(goals)
        ],
    )
    return Lap(route, goals, tuple(numbers), size)
