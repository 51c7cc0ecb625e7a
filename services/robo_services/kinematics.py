"""Motion in the plane: poses, velocities, and exact arcs."""

import math
from typing import NamedTuple

from robo_services.planar import normalize_angle


class Pose2(NamedTuple):
    """A pose in the plane."""

    x: float = 0.0
    """m."""
    y: float = 0.0
    """m."""
    yaw: float = 0.0
    """rad, in (-π, π]."""


ORIGIN = Pose2()


class Twist2(NamedTuple):
    """How a base moves that cannot move sideways; or, of the same shape, how far it has moved."""

    linear: float = 0.0
    """Forward, m/s; or the way along the arc, m."""
    angular: float = 0.0
    """To the left, rad/s; or the turn, rad."""


def advance(pose: Pose2, linear: float, angular: float, dt: float) -> Pose2:
    """Where a robot is that drives an exact arc for `dt` s (Thrun, Burgard, Fox 2005, §5.3).

    Args:
        pose: where it starts.
        linear: forward velocity, m/s.
        angular: yaw rate, rad/s.
        dt: s.

    Raises:
        ValueError: the robot turns by what is not a finite number.
    """
    turn = angular * dt
    x, y = chord(linear * dt, turn, pose.yaw)
    return Pose2(pose.x + x, pose.y + y, normalize_angle(pose.yaw + turn))


def chord(distance: float, turn: float, yaw: float) -> tuple[float, float]:
    """Where an arc leads from where it begins, x and y in m.

    The chord of an arc of radius r is 2 r sin(turn / 2) long and points to the middle of both headings. Written
    with distance / turn for r it is as exact for the widest arc, and for a straight line, as for a narrow one;
    a difference of r sin(yaw) loses there what r gains.

    Args:
        distance: along the arc, negative backward, m.
        turn: to the left, rad.
        yaw: where the robot looks at its beginning, rad.
    """
    half = turn / 2
    length = distance * (math.sin(half) / half) if half else distance
    return length * math.cos(yaw + half), length * math.sin(yaw + half)
