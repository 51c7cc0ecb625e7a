"""Transforms for tests of their buffer: a robot that drives a circle, and how far two transforms are apart."""

import math

from robo.tf import IDENTITY, Buffer, Transform3
from robo_messages import Header, Time, TransformStamped

SECOND = 1_000_000_000
"""ns."""


def ns(seconds: float) -> int:
    return round(seconds * SECOND)


def said(parent: str, child: str, time: float, where: Transform3 = IDENTITY) -> TransformStamped:
    return where.to_stamped(Header(Time.from_nanoseconds(ns(time)), parent), child)


def at_x(parent: str, child: str, time: float, x: float) -> TransformStamped:
    return said(parent, child, time, Transform3(x=x))


def robot() -> Buffer:
    """map → odom at 10 Hz, odom → base_link at 50 Hz, from 100 s to 104 s, and a laser that does not move."""
    buffer = Buffer()
    for i in range(41):
        buffer.insert(said("map", "odom", 100 + i / 10, Transform3.planar(0.1 * i, 0.0, 0.01 * i)), source="/amcl")
    for i in range(201):
        buffer.insert(said("odom", "base_link", 100 + i / 50, pose(i / 50)), source="/odometry")
    buffer.insert(said("base_link", "laser", 0.0, Transform3(x=0.2, z=0.3)), static=True, source="/description")
    return buffer


def pose(t: float) -> Transform3:
    """Where a body that drives a circle is after t s."""
    return Transform3.planar(2.0 * math.sin(0.5 * t), 2.0 * (1.0 - math.cos(0.5 * t)), 0.5 * t)


def apart(a: Transform3, b: Transform3) -> float:
    """The largest difference of two transforms; q and -q are one rotation."""
    sign = math.copysign(1.0, sum(p * q for p, q in zip(a[3:], b[3:], strict=True)))
    turned = [abs(p - sign * q) for p, q in zip(a[3:], b[3:], strict=True)]
    return max(*(abs(p - q) for p, q in zip(a[:3], b[:3], strict=True)), *turned)
