"""Planar geometry: angles, and orientations as quaternions. SI units, REP-103 axes.

Every function is total on finite numbers, angles like 1e9 rad included, and none loops.
"""

import math

from robo_messages import Quaternion


def normalize_angle(angle: float) -> float:
    """The same direction in (-π, π], rad.

    Raises:
        ValueError: the angle is NaN or infinite.
    """
    if not math.isfinite(angle):
        raise ValueError(f"angle {angle} is not finite")
    # IEEE remainder is exact and lies in [-π, π]: only the lower end has to move.
    wrapped = math.remainder(angle, math.tau)
    return math.pi if wrapped <= -math.pi else wrapped


def angle_difference(target: float, source: float) -> float:
    """The shortest turn from `source` to `target`, in (-π, π], rad."""
    return normalize_angle(normalize_angle(target) - normalize_angle(source))


def quaternion_from_yaw(yaw: float) -> Quaternion:
    """A turn about z by `yaw` rad, as a unit quaternion."""
    half = normalize_angle(yaw) / 2
    return Quaternion(0.0, 0.0, math.sin(half), math.cos(half))


def yaw_from_quaternion(q: Quaternion) -> float:
    """The turn about z of an orientation, in (-π, π], rad (z-y-x Euler angles, Diebel 2006, eq. 290).

    The quaternion need not be normalized; roll and pitch are left out.
    """
    yaw = math.atan2(2 * (q.w * q.z + q.x * q.y), q.w * q.w + q.x * q.x - q.y * q.y - q.z * q.z)
    return math.pi if yaw == -math.pi else yaw
