"""Differential-drive kinematics, in the plane."""

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


def advance(pose: Pose2, linear: float, angular: float, dt: float) -> Pose2:
    """Where a robot is that drives an exact arc for `dt` s (Thrun, Burgard, Fox 2005, §5.3).

    Args:
        pose: where it starts.
        linear: forward velocity, m/s.
        angular: yaw rate, rad/s.
        dt: s.
    """
    turn = angular * dt
    if abs(turn) < 1e-6:  # the arc's radius would be lost to rounding; a chord is exact enough
        middle = pose.yaw + turn / 2
        return Pose2(
            pose.x + linear * dt * math.cos(middle),
            pose.y + linear * dt * math.sin(middle),
            normalize_angle(pose.yaw + turn),
        )
    radius = linear / angular
    yaw = pose.yaw + turn
    return Pose2(
        pose.x + radius * (math.sin(yaw) - math.sin(pose.yaw)),
        pose.y - radius * (math.cos(yaw) - math.cos(pose.yaw)),
        normalize_angle(yaw),
    )
