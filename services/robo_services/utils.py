"""Planar geometry: angles, distances, headings, quaternions, frames. SI units, REP-103 axes.

Every function is total on finite numbers, angles like 1e9 rad included, and none loops.
"""

import math

from robo_messages import Point, Pose, Quaternion


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


def distance(a: Point, b: Point) -> float:
    """The distance of two points in the plane (z is left out), m."""
    return math.hypot(b.x - a.x, b.y - a.y)


def heading(a: Point, b: Point) -> float:
    """The direction from `a` to `b`, in (-π, π], rad; 0 where they coincide."""
    direction = math.atan2(b.y - a.y, b.x - a.x)
    return math.pi if direction == -math.pi else direction


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


def to_parent(pose: Pose, point: Point) -> Point:
    """A point given in the frame that stands at `pose`, seen from the parent frame; planar, m."""
    yaw = yaw_from_quaternion(pose.orientation)
    cos, sin = math.cos(yaw), math.sin(yaw)
    return Point(
        pose.position.x + cos * point.x - sin * point.y,
        pose.position.y + sin * point.x + cos * point.y,
        pose.position.z + point.z,
    )


def to_child(pose: Pose, point: Point) -> Point:
    """A point of the parent frame, seen from the frame that stands at `pose`; planar, m."""
    yaw = yaw_from_quaternion(pose.orientation)
    cos, sin = math.cos(yaw), math.sin(yaw)
    dx, dy = point.x - pose.position.x, point.y - pose.position.y
    return Point(cos * dx + sin * dy, -sin * dx + cos * dy, point.z - pose.position.z)


def compose(parent: Pose, child: Pose) -> Pose:
    """A pose given in the frame that stands at `parent`, seen from `parent`'s own frame; planar."""
    yaw = yaw_from_quaternion(parent.orientation) + yaw_from_quaternion(child.orientation)
    return Pose(to_parent(parent, child.position), quaternion_from_yaw(yaw))
