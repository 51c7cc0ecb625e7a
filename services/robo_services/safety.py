"""Whether a velocity command is safe to pass on: pure decisions, without Zenoh and without a clock.

Whatever is unknown counts as dangerous. Distances are measured from the laser's origin.
"""

import math
from collections.abc import Sequence
from typing import Literal

import msgspec

from robo_messages import LaserScan, Twist, Vector3
from robo_services.collision import Body, Sighting, free_share
from robo_services.contact import STANDING, Velocity
from robo_services.zones import Zone, ZoneAction, verdicts

Action = Literal["clear", "slow", "limit", "approach", "stop"]
_ACTIONS: dict[ZoneAction, Action] = {"stop": "stop", "slow_down": "slow", "limit": "limit", "approach": "approach"}

NO_LASER = "no_laser"
"""The reason where there is none, and nothing else looks either."""
FOOTPRINT = "footprint"
"""What is said for a zone where the robot could not stop in time."""


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
    """Whether there is one on `scan`. False says that it is not waited for; everything else still counts."""
    body: Body | None = None
    """The robot, which is to stop before it touches anything; None where that is not looked at."""
    zones: tuple[Zone, ...] = ()
    timeouts: tuple[tuple[str, float], ...] = ()
    """Of all sources of obstacles by name, s: one whose last word is older stops the robot."""


class Situation(msgspec.Struct, frozen=True, kw_only=True):
    """What is known at the moment of a decision; ages by the receiver's monotonic clock, s."""

    command: Twist | None = None
    command_age: float = math.inf
    scan: LaserScan | None = None
    scan_age: float = math.inf
    scan_yaw: float = 0.0
    """Where the laser looks, in the base's frame, rad."""
    speed: float | None = None
    """Measured, m/s; None before the first odometry."""
    velocity: Velocity = STANDING
    """How the base moves, as far as it is known."""
    sightings: Sequence[Sighting] = ()
    """What sources of obstacles have said; one that is silent so far is missing."""
    rival: str = ""
    """Who commands the base too, where that is to stop the robot."""
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
    zone: str = ""
    """Which zone says so; empty where it is none."""
    source: str = ""
    """Which source has seen what is in the way; empty where it is none."""
    distance: float = math.inf
    """How far that is, m: from the laser, for a zone from its shape; infinite where nothing is in the way."""
    time_to_collision: float = math.inf
    """In which a zone's shape, or the footprint, would touch it if the command were obeyed, s."""


SLOWEST = 0.05
"""Below this share of the wanted speed the robot stops: a crawl to the last millimetre helps nobody."""
OVERSPEED = 1.1
"""A measured speed beyond this multiple of `max_speed` means that the base does not obey."""
MOST_TURNS = 4
"""A scan that goes round more often is looked at ray by ray."""
LEAST_STEP = 1e-6
"""Likewise one whose rays are nearer to each other, rad."""
ROUNDING = 1e-9
"""Of a ray's number."""


def decide(situation: Situation, limits: Limits) -> Decision:
    """Pass a command on, slow it down, or stop: whatever restricts it the most."""
    command = situation.command
    doubt = _doubt_of_sensors(situation, limits) or _doubt_of_command(situation, limits)
    if doubt is not None or command is None:
        return doubt or _stop("no_command", "no command so far")
    speed = math.hypot(command.linear.x, command.linear.y)
    if speed > limits.max_speed:
        command = _scaled(command, limits.max_speed / speed)
    found = [*_by_distance(command, situation, limits), *_by_zones(command, situation, limits)]
    if found:
        share, decision = min(found, key=lambda each: each[0])
        if share == 0.0:
            return decision
        return msgspec.structs.replace(decision, twist=_scaled(command, share))
    if not limits.laser and not limits.timeouts:
        return Decision("clear", NO_LASER, "no laser: nobody looks for obstacles", command)
    return Decision("clear", "clear", "nothing in the way" if speed else "no linear motion", command)


def _doubt_of_sensors(situation: Situation, limits: Limits) -> Decision | None:
    scan = situation.scan
    if situation.emergency_stop:
        return _stop("emergency_stop", "emergency stop, until reset_emergency_stop is called")
    if situation.rival:
        return _stop("rival", f"{situation.rival} commands the base too")
    if limits.laser:
        if scan is None:
            return _stop("no_scan", "no laser scan so far")
        if not situation.scan_age <= limits.scan_timeout:  # so that NaN is stale too
            return _stop("stale_scan", f"the last laser scan is {situation.scan_age:.2f} s old")
        if not is_usable(scan):
            return _stop("invalid_scan", "the laser scan holds no valid range")
    heard = {sighting.source: sighting.age for sighting in situation.sightings}
    for source, timeout in limits.timeouts:
        age = heard.get(source)
        if age is None:
            return _stop("no_source", f"nothing from the source {source} so far", source)
        if not age <= timeout:
            return _stop("stale_source", f"the last word of the source {source} is {age:.2f} s old", source)
    return None


def _doubt_of_command(situation: Situation, limits: Limits) -> Decision | None:
    if situation.command is None:
        return _stop("no_command", "no command so far")
    if not is_finite(situation.command):
        return _stop("invalid_command", "the command holds NaN or an infinity")
    if not situation.command_age <= limits.command_timeout:
        return _stop("stale_command", f"the last command is {situation.command_age:.2f} s old")
    if situation.speed is not None and not situation.speed <= limits.max_speed * OVERSPEED:
        return _stop("overspeed", f"measured {situation.speed:.2f} m/s, more than max_speed = {limits.max_speed:g} m/s")
    return None


def _by_distance(command: Twist, situation: Situation, limits: Limits) -> list[tuple[float, Decision]]:
    """What the distance of the nearest obstacle in the direction of motion restricts, each with the share left."""
    scan = situation.scan
    if scan is None or not limits.laser or (command.linear.x == 0.0 and command.linear.y == 0.0):
        return []  # a turn on the spot leads nowhere
    direction = math.atan2(command.linear.y, command.linear.x) - situation.scan_yaw
    nearest = nearest_in_sector(scan, direction, limits.sector)
    if nearest is None:
        return [(0.0, _stop("blind", "the laser does not see in the direction of motion"))]
    if nearest >= limits.warning_distance and nearest > limits.min_distance:
        return []
    room = limits.warning_distance - limits.min_distance
    share = (nearest - limits.min_distance) / room if room > 0 else 0.0
    text = f"obstacle at {nearest:.2f} m in the direction of motion"
    if share < SLOWEST:
        return [(0.0, Decision("stop", "obstacle", text, Twist(), distance=nearest))]
    text += f", {share:.0%} of the wanted speed"
    return [(share, Decision("slow", "obstacle_near", text, Twist(), distance=nearest))]


def _by_zones(command: Twist, situation: Situation, limits: Limits) -> list[tuple[float, Decision]]:
    """What the footprint and zones restrict, each with the share that is left."""
    wanted, found = velocity_of(command), []
    if limits.body is not None:
        share, source, distance, time = free_share(wanted, situation.velocity, limits.body, situation.sightings)
        if share < 1.0:
            found.append(_restricted("approach", FOOTPRINT, source, share, distance, time))
    for share, zone, source, distance, time in verdicts(wanted, limits.zones, situation.sightings):
        found.append(_restricted(_ACTIONS[zone.action], zone.name, source, share, distance, time))
    return found


def _restricted(
    action: Action, zone: str, source: str, share: float, distance: float, time: float
) -> tuple[float, Decision]:
    what = zone if zone == FOOTPRINT else f"zone {zone}"
    text = f"obstacle {distance:.2f} m from the {what}" if distance > 0.0 else f"obstacle within the {what}"
    if 0.0 < time < math.inf:
        text += f", {time:.1f} s ahead"
    if share == 0.0 or (action == "approach" and share < SLOWEST):
        return 0.0, Decision("stop", "obstacle", text, Twist(), zone, source, distance, time)
    text += f", {share:.0%} of the wanted speed"
    return share, Decision(action, "obstacle_near", text, Twist(), zone, source, distance, time)


def velocity_of(twist: Twist) -> Velocity:
    """The velocity in the plane of a twist."""
    return Velocity(twist.linear.x, twist.linear.y, twist.angular.z)


def nearest_in_sector(scan: LaserScan, direction: float, sector: float) -> float | None:
    """The distance of the nearest obstacle within `sector` rad around `direction`, m.

    REP-117: -inf is an obstacle (at 0), +inf and ranges beyond `range_max` are free (inf), NaN says
    nothing. A finite range below `range_min` counts as an obstacle: too near beats not measured.

    Returns:
        None where no ray in the sector says anything.
    """
    nearest: float | None = None
    for part in _in_sector(scan, direction, sector):
        least = min((distance for distance in part if distance == distance), default=None)  # NaN is not itself
        if least is not None and (nearest is None or least < nearest):
            nearest = least
    if nearest is None:
        return None
    return math.inf if nearest > scan.range_max else max(nearest, 0.0)


def _in_sector(scan: LaserScan, direction: float, sector: float) -> list[Sequence[float]]:
    """The ranges of a scan within `sector` rad around a direction, in parts that lie side by side."""
    ranges, start, step, half = scan.ranges, scan.angle_min, scan.angle_increment, sector / 2
    if not MOST_TURNS * math.tau >= abs(step) * len(ranges) > 0.0 or abs(step) < LEAST_STEP:
        angles = (start + index * step for index in range(len(ranges)))
        off = (abs(math.remainder(angle - direction, math.tau)) for angle in angles)
        return [[distance for distance, each in zip(ranges, off, strict=True) if each <= half]]
    if half >= math.pi:
        return [ranges]
    # Ray i looks there if start + i·step is within half of direction + k·2π, for some k.
    ends = sorted((start, start + (len(ranges) - 1) * step))
    first = math.ceil((ends[0] - half - direction) / math.tau)
    last = math.floor((ends[1] + half - direction) / math.tau)
    parts: list[Sequence[float]] = []
    for k in range(first, last + 1):
        middle = direction + k * math.tau
        edges = sorted(((middle - half - start) / step, (middle + half - start) / step))
        begin, end = math.ceil(edges[0] - ROUNDING), math.floor(edges[1] + ROUNDING) + 1
        parts.append(ranges[max(0, begin) : max(0, end)])
    return parts


def is_usable(scan: LaserScan) -> bool:
    """Whether a scan says anything: its angles are numbers, it says how far it sees, and some range is not NaN."""
    last = scan.angle_min + len(scan.ranges) * scan.angle_increment
    return math.isfinite(last) and scan.range_max > 0.0 and any(r == r for r in scan.ranges)


def is_finite(twist: Twist) -> bool:
    """Whether every component of a velocity is a number."""
    a, b = twist.linear, twist.angular
    return all(map(math.isfinite, (a.x, a.y, a.z, b.x, b.y, b.z)))


def _scaled(twist: Twist, scale: float) -> Twist:
    """Slower along the same path: turning is scaled with driving."""
    if scale == 1.0:
        return twist
    a, b = twist.linear, twist.angular
    return Twist(Vector3(a.x * scale, a.y * scale, a.z * scale), Vector3(b.x * scale, b.y * scale, b.z * scale))


def _stop(reason: str, text: str, source: str = "") -> Decision:
    return Decision("stop", reason, text, Twist(), source=source)
