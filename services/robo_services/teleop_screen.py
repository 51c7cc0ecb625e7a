"""What somebody who drives by keys sees: text from what is known, without a terminal and without a clock."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import msgspec

from robo.text import colours
from robo.text.terminal import visible
from robo_messages import DiagnosticStatus, LaserScan, Twist
from robo_services.teleop import Speeds

OLD = 2.5
"""What was said longer ago is told with its age, s: the monitor says its state once a second."""

_NARROW = 60
"""Columns; with fewer the keys are told in short."""

HELP = (
    "  drive     w s or up, down    forward, back       a d or left, right   turn",
    "  curves    u o                forward             m .                  back",
    "  sideways  J L                left, right         (as i , j l around k)",
    "  speed     + - all            r f driving         t g turning",
    "  stop      space, or any other key                end   q, Ctrl-C",
)
SHORT_HELP = (
    "  w s a d, arrows  drive",
    "  u o m .          curves",
    "  J L              sideways",
    "  + -, r f, t g    faster, slower",
    "  space            stop",
    "  q, Ctrl-C        end",
)


class Nearest(NamedTuple):
    """The nearest thing that a laser sees."""

    distance: float
    """m, from the laser; infinite where it sees nothing."""
    bearing: float
    """To the left of where the laser looks, in [-π, π], rad."""


class View(msgspec.Struct, frozen=True, kw_only=True):
    """All that is shown. Ages in s, infinite for what has never come."""

    name: str
    topic: str
    command: Twist
    """What was said last."""
    held: bool = False
    """Whether a key is."""
    speeds: Speeds
    robot: Twist | None = None
    """As odometry has it."""
    robot_age: float = math.inf
    safety: DiagnosticStatus | None = None
    safety_age: float = math.inf
    nearest: Nearest | None = None
    """None without a laser, or where its scan says nothing."""
    scan_age: float = math.inf
    notes: Sequence[str] = ()
    """Lines of the log, the newest last."""


class Line(NamedTuple):
    """One line, which may have a colour."""

    text: str
    colour: str = ""


def nearest_of(scan: LaserScan) -> Nearest | None:
    """The nearest obstacle of a scan, wherever it is.

    As for the safety monitor (REP-117): a range that is too short to be measured is an obstacle, -inf is one at 0, NaN
    says nothing, +inf and ranges beyond `range_max` are free.

    Returns:
        None where no range says anything, or its angle is no number.
    """
    nearest: Nearest | None = None
    for index, measured in enumerate(scan.ranges):
        if measured != measured:  # NaN
            continue
        distance = math.inf if measured > scan.range_max else max(measured, 0.0)
        if nearest is None or distance < nearest.distance:
            angle = scan.angle_min + index * scan.angle_increment
            if math.isfinite(angle):
                nearest = Nearest(distance, math.remainder(angle, math.tau))
    return nearest


def lines_of(view: View, width: int, height: int) -> list[Line]:
    """The lines of a screen: what changes first, then the keys; what does not fit is left out.

    Args:
        view: what is known.
        width: of the screen, columns.
        height: likewise, lines.
    """
    state = [
        Line(f"{view.name} commands {view.topic}", colours.BOLD),
        Line(""),
        _command_line(view),
        Line(f"  speeds    {view.speeds.linear:.2f} m/s, {view.speeds.angular:.2f} rad/s"),
        _robot_line(view),
        _safety_line(view),
        _nearest_line(view),
    ]
    keys = [Line(""), *map(Line, HELP if width >= _NARROW else SHORT_HELP)]
    notes = [Line(text) for text in view.notes]
    room = height - len(state)
    # The newest note goes before the keys, which one may know by now; the others have what is left.
    kept = keys[: max(0, room - (2 if notes else 0))]
    left = room - len(kept) - 1
    below = [Line(""), *notes[-left:]] if notes and left > 0 else []
    return [Line(_cut(visible(text), width), colour) for text, colour in [*state, *kept, *below][: max(0, height)]]


def drawn(lines: Sequence[Line], *, colour: bool) -> str:
    """What makes a terminal show these lines and nothing else, from its upper left corner."""
    shown = [colours.painted(line.text, line.colour) if colour and line.colour else line.text for line in lines]
    return "\x1b[H" + "\r\n".join(f"{text}\x1b[K" for text in shown) + "\x1b[J"


def velocity_text(twist: Twist) -> str:
    """A velocity in words: `forward 0.50 m/s, turning left 1.00 rad/s`; empty for 0."""
    parts = [
        _part(twist.linear.x, "forward", "back", "m/s"),
        _part(twist.linear.y, "sideways left", "sideways right", "m/s"),
        _part(twist.angular.z, "turning left", "turning right", "rad/s"),
    ]
    return ", ".join(part for part in parts if part)


def bearing_text(bearing: float) -> str:
    """A direction in words: `ahead`, `90 deg to the left`."""
    degrees = round(math.degrees(bearing))
    if abs(degrees) <= 2:
        return "ahead"
    if abs(degrees) >= 178:
        return "behind"
    return f"{abs(degrees)} deg to the {'left' if degrees > 0 else 'right'}"


def _command_line(view: View) -> Line:
    said = velocity_text(view.command)
    if said:
        return Line(f"  command   {said}", colours.GREEN)
    return Line(f"  command   stand{'' if view.held else ', no key is held'}")


def _robot_line(view: View) -> Line:
    if view.robot is None:
        return Line("  robot     nobody tells its odometry")
    moves = f"{math.hypot(view.robot.linear.x, view.robot.linear.y):.2f} m/s, {view.robot.angular.z:+.2f} rad/s"
    return _aged(f"  robot     {moves}", view.robot_age)


def _safety_line(view: View) -> Line:
    if view.safety is None:
        return Line("  safety    nobody tells a safety_state", colours.YELLOW)
    values = {value.key: value.value for value in view.safety.values}
    action = values.get("action", "")
    text = f"{action}: {view.safety.message}" if action else view.safety.message
    colour = {DiagnosticStatus.OK: "", DiagnosticStatus.WARN: colours.YELLOW}.get(view.safety.level, colours.RED)
    return _aged(f"  safety    {text}", view.safety_age, colour)


def _nearest_line(view: View) -> Line:
    if view.scan_age == math.inf:
        return Line("  nearest   no laser scan")
    if view.nearest is None:
        return _aged("  nearest   the laser says nothing", view.scan_age, colours.YELLOW)
    if view.nearest.distance == math.inf:
        return _aged("  nearest   nothing in sight", view.scan_age)
    where = f"{view.nearest.distance:.2f} m, {bearing_text(view.nearest.bearing)}"
    return _aged(f"  nearest   {where}", view.scan_age)


def _aged(text: str, age: float, colour: str = "") -> Line:
    """A line that says so where what it tells is old."""
    return Line(text, colour) if age <= OLD else Line(f"{text} ({_age_text(age)})", colours.YELLOW)


def _age_text(age: float) -> str:
    return f"{age:.0f} s ago" if age < 1e6 else "long ago"


def _part(value: float, positive: str, negative: str, unit: str) -> str:
    return f"{positive if value > 0 else negative} {abs(value):.2f} {unit}" if value else ""


def _cut(text: str, width: int) -> str:
    return text if len(text) <= width else text[: max(0, width)]
