"""Whether a velocity command is safe to pass on: pure decisions, without Zenoh and without a clock.

Whatever is unknown counts as dangerous. Distances are measured from the laser's origin.
"""

import math
from typing import Literal

import msgspec

from robo_messages import LaserScan, Twist, Vector3

Action = Literal["clear", "slow", "stop"]


class Limits(msgspec.Struct, frozen=True, kw_only=True):
    """What is safe."""

    min_distance: float
    """Stop for an obstacle this near, m."""
    warning_distance: float
    """Slow down for one nearer than this, m."""
    max_speed: float
    """m/s."""
    sector: float
    """Full angle around the direction of motion in which obstacles count, rad."""
    scan_timeout: float
    """A scan older than this is as good as none, s."""
    command_timeout: float
    """A command older than this is as good as none, s."""
    laser: bool = True
    """Whether there is one. False says that nobody is to look for obstacles; everything else still counts."""


class Situation(msgspec.Struct, frozen=True, kw_only=True):
    """What is known at the moment of a decision; ages by the receiver's monotonic clock, s."""

    command: Twist | None = None
    command_age: float = math.inf
    scan: LaserScan | None = None
    scan_age: float = math.inf
    speed: float | None = None
    """Measured, m/s; None before the first odometry."""
    emergency_stop: bool = False
    """Whether somebody has called for it and nobody has released it."""


class Decision(msgspec.Struct, frozen=True):
    """What to do with a command."""

    action: Action
    reason: str
    """A short word for the cause: the same cause gives the same word."""
    text: str
    """The cause with its figures."""
    twist: Twist
    """What to pass on."""


SLOWEST = 0.05
"""Below this share of the wanted speed the robot stops: a crawl to the last millimetre helps nobody."""
OVERSPEED = 1.1
"""A measured speed beyond this multiple of `max_speed` means that the base does not obey."""


def decide(situation: Situation, limits: Limits) -> Decision:
    """Pass a command on, slow it down, or stop."""
    scan, command = situation.scan, situation.command
    if situation.emergency_stop:
        return _stop("emergency_stop", "emergency stop, until reset_emergency_stop is called")
    if limits.laser:
        if scan is None:
            return _stop("no_scan", "no laser scan so far")
        if not situation.scan_age <= limits.scan_timeout:  # so that NaN is stale too
            return _stop("stale_scan", f"the last laser scan is {situation.scan_age:.2f} s old")
        if not is_usable(scan):
            return _stop("invalid_scan", "the laser scan holds no valid range")
    if command is None:
        return _stop("no_command", "no command so far")
    if not is_finite(command):
        return _stop("invalid_command", "the command holds NaN or an infinity")
    if not situation.command_age <= limits.command_timeout:
        return _stop("stale_command", f"the last command is {situation.command_age:.2f} s old")
    if situation.speed is not None and not situation.speed <= limits.max_speed * OVERSPEED:
        return _stop("overspeed", f"measured {situation.speed:.2f} m/s, more than max_speed = {limits.max_speed:g} m/s")
    speed = math.hypot(command.linear.x, command.linear.y)
    if speed == 0.0:
        return Decision("clear", "clear", "no linear motion", command)  # a turn on the spot hits nothing
    if scan is None or not limits.laser:
        scale = min(1.0, limits.max_speed / speed)
        return Decision("clear", "no_laser", "no laser: nobody looks for obstacles", _scaled(command, scale))
    direction = math.atan2(command.linear.y, command.linear.x)
    nearest = nearest_in_sector(scan, direction, limits.sector)
    if nearest is None:
        return _stop("blind", "the laser does not see in the direction of motion")
    return _pass(command, speed, nearest, limits)


def nearest_in_sector(scan: LaserScan, direction: float, sector: float) -> float | None:
    """The distance of the nearest obstacle within `sector` rad around `direction`, m.

    REP-117: -inf is an obstacle (at 0), +inf and ranges beyond `range_max` are free (inf), NaN says
    nothing. A finite range below `range_min` counts as an obstacle: too near beats not measured.

    Returns:
        None where no ray in the sector says anything.
    """
    nearest: float | None = None
    half = sector / 2
    for index, distance in enumerate(scan.ranges):
        if distance != distance:  # NaN
            continue
        angle = scan.angle_min + index * scan.angle_increment
        if abs(math.remainder(angle - direction, math.tau)) > half:
            continue
        if distance > scan.range_max:
            distance = math.inf
        distance = max(distance, 0.0)
        if nearest is None or distance < nearest:
            nearest = distance
    return nearest


def is_usable(scan: LaserScan) -> bool:
    """Whether a scan says anything: its angles are numbers and some range is not NaN."""
    last = scan.angle_min + len(scan.ranges) * scan.angle_increment
    return math.isfinite(last) and not math.isnan(scan.range_max) and any(r == r for r in scan.ranges)


def is_finite(twist: Twist) -> bool:
    """Whether every component of a velocity is a number."""
    a, b = twist.linear, twist.angular
    return all(map(math.isfinite, (a.x, a.y, a.z, b.x, b.y, b.z)))


def _pass(command: Twist, speed: float, nearest: float, limits: Limits) -> Decision:
    scale = min(1.0, limits.max_speed / speed)
    if nearest >= limits.warning_distance and nearest > limits.min_distance:
        return Decision("clear", "clear", "nothing in the way", _scaled(command, scale))
    room = limits.warning_distance - limits.min_distance
    share = (nearest - limits.min_distance) / room if room > 0 else 0.0
    if share < SLOWEST:
        return _stop("obstacle", f"obstacle at {nearest:.2f} m in the direction of motion")
    text = f"obstacle at {nearest:.2f} m in the direction of motion, {share:.0%} of the wanted speed"
    return Decision("slow", "obstacle_near", text, _scaled(command, scale * share))


def _scaled(twist: Twist, scale: float) -> Twist:
    """Slower along the same path: turning is scaled with driving."""
    if scale == 1.0:
        return twist
    a, b = twist.linear, twist.angular
    return Twist(Vector3(a.x * scale, a.y * scale, a.z * scale), Vector3(b.x * scale, b.y * scale, b.z * scale))


def _stop(reason: str, text: str) -> Decision:
    return Decision("stop", reason, text, Twist())
