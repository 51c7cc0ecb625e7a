"""What a game pad says to a robot: from its axes and buttons to a velocity, without Zenoh and without a clock.

Names and meanings are those of ROS's teleop_twist_joy, and so is the sign of axes: 1 to the left and forward.
"""

import math
from typing import Literal, NamedTuple

import msgspec

from robo_messages import Joy, Twist, Vector3

Mode = Literal["off", "normal", "turbo"]


class Scales(NamedTuple):
    """How fast an axis at its end drives."""

    x: float
    """m/s, forward; negative where the axis points the other way."""
    y: float
    """m/s, to the left."""
    yaw: float
    """rad/s, to the left."""


class Mapping(msgspec.Struct, frozen=True, kw_only=True):
    """What buttons and axes are for. Buttons and axes count from 0; -1 is none."""

    require_enable_button: bool = True
    enable_button: int
    enable_turbo_button: int
    axis_x: int
    axis_y: int
    axis_yaw: int
    normal: Scales
    turbo: Scales
    inverted_reverse: bool = False


def mode_of(joy: Joy, mapping: Mapping) -> Mode:
    """Whether somebody holds a button that lets the robot drive; turbo goes first, and needs no other."""
    if _is_pressed(joy, mapping.enable_turbo_button):
        return "turbo"
    if _is_pressed(joy, mapping.enable_button) or not mapping.require_enable_button:
        return "normal"
    return "off"


def twist_of(joy: Joy, mapping: Mapping, mode: Mode) -> Twist:
    """The velocity that the axes say, 0 where the mode is off.

    An axis that the pad does not have is at 0. No axis counts for more than 1, whatever it says.

    Raises:
        ValueError: an axis that is used is NaN or infinite.
    """
    if mode == "off":
        return Twist()
    scales = mapping.turbo if mode == "turbo" else mapping.normal
    x = _axis(joy, mapping.axis_x) * scales.x
    yaw = _axis(joy, mapping.axis_yaw) * scales.yaw
    if mapping.inverted_reverse and x < 0.0:
        yaw = -yaw
    return Twist(Vector3(x, _axis(joy, mapping.axis_y) * scales.y), Vector3(z=yaw))


def missing(joy: Joy, mapping: Mapping) -> list[str]:
    """What the mapping names and the pad does not have, in words."""
    lacks = []
    buttons = (("enable_button", mapping.enable_button), ("enable_turbo_button", mapping.enable_turbo_button))
    for name, button in buttons:
        if button >= len(joy.buttons) and not (name == "enable_button" and not mapping.require_enable_button):
            lacks.append(f"{name} is {button}, and it has {len(joy.buttons)} buttons")
    axes = (
        ("axis_linear.x", mapping.axis_x),
        ("axis_linear.y", mapping.axis_y),
        ("axis_angular.yaw", mapping.axis_yaw),
    )
    lacks += [f"{name} is {axis}, and it has {len(joy.axes)} axes" for name, axis in axes if axis >= len(joy.axes)]
    return lacks


def _is_pressed(joy: Joy, button: int) -> bool:
    return 0 <= button < len(joy.buttons) and joy.buttons[button] != 0


def _axis(joy: Joy, axis: int) -> float:
    if not 0 <= axis < len(joy.axes):
        return 0.0
    value = joy.axes[axis]
    if not math.isfinite(value):
        raise ValueError(f"axis {axis} is {value}")
    return max(-1.0, min(value, 1.0))


class DeadMan:
    """Decides whether what a pad says counts: only if its button was seen let go since it was last lost.

    A pad that comes back, or a node that starts, with the button held down would drive off at once: a stuck button, a
    pad that lies on its face. Times are of one clock that never steps back, s.
    """

    def __init__(self) -> None:
        self.driving = False
        """Whether the last thing said was a velocity, and not that the robot is to stand."""
        self._was_let_go = False

    def hear(self, mode: Mode, *, needs_button: bool) -> bool:
        """Hear whether the button is held. Returns whether the pad's velocity counts."""
        if mode == "off" or not needs_button:
            self._was_let_go = True
        return mode != "off" and self._was_let_go

    def lose(self) -> None:
        """Hear that the pad is silent, or says what makes no sense."""
        self._was_let_go = False
