"""Game pads as Linux tells of them: what their events mean, without a device, Zenoh or a clock.

Two interfaces, by their documentation in the kernel: the joystick API (`struct js_event` of linux/joystick.h, read from
/dev/input/js*), and evdev, for systems without it. Axes and buttons have the same numbers by both: joydev counts a
pad's axes by their codes, and its buttons from BTN_JOYSTICK on, those below it last.
"""

import math
import struct
from collections.abc import Iterable
from typing import NamedTuple

AXIS_END = 32767
"""The largest value of an axis of the joystick API."""

_EVENT = struct.Struct("=IhBB")
"""`js_event`: time, ms; value; type; number. In the byte order of the machine."""
_BUTTON, _AXIS, _INIT = 0x01, 0x02, 0x80

BTN_MISC, BTN_JOYSTICK = 0x100, 0x120
"""Codes of evdev's (linux/input-event-codes.h)."""


class Event(NamedTuple):
    """An axis or a button that has moved, or what it is at as the device is opened."""

    is_button: bool
    number: int
    """From 0."""
    value: float
    """Of a button 1 or 0. Of an axis -1 to 1 as ROS has it: 1 is left and up, the other sign than the kernel's."""


class JsDecoder:
    """Makes events of what /dev/input/js* says, however it is cut into pieces."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> list[Event]:
        """The events that are complete; of a kind that nobody knows are left out."""
        data = self._rest + data
        whole = len(data) - len(data) % _EVENT.size
        self._rest = data[whole:]
        events = []
        for _time, value, kind, number in _EVENT.iter_unpack(data[:whole]):
            if kind & ~_INIT == _BUTTON:
                events.append(Event(True, number, float(value != 0)))
            elif kind & ~_INIT == _AXIS:
                events.append(Event(False, number, max(-1.0, min(-value / AXIS_END, 1.0)) + 0.0))
        return events


class AxisRange(NamedTuple):
    """What an axis of evdev says."""

    minimum: int
    maximum: int

    def normalized(self, value: int) -> float:
        """A value of it, -1 to 1, of the sign that ROS has; 0 for an axis that says nothing of its ends."""
        if self.maximum <= self.minimum:
            return 0.0
        share = (value - self.minimum) / (self.maximum - self.minimum)
        return max(-1.0, min(1.0 - 2.0 * share, 1.0))


def button_numbers(codes: Iterable[int]) -> dict[int, int]:
    """The numbers of buttons by their codes of evdev's."""
    pad = sorted(code for code in codes if code >= BTN_JOYSTICK)
    others = sorted(code for code in codes if BTN_MISC <= code < BTN_JOYSTICK)
    return {code: number for number, code in enumerate([*pad, *others])}


class Pad:
    """What all axes and buttons of a pad are at, as messages say it."""

    def __init__(self, axes: int = 0, buttons: int = 0, *, sticky: bool = False) -> None:
        """
        Args:
            axes: how many it has; it grows where a device says more.
            buttons: likewise.
            sticky: whether a button stays pressed until it is pressed again.
        """
        self._axes = [0.0] * axes
        self._buttons = [0] * buttons
        self._down = [False] * buttons
        self._sticky = sticky

    def take(self, event: Event) -> bool:
        """Take an event. Returns whether a button has changed by it."""
        if not event.is_button:
            self._axes += [0.0] * (event.number + 1 - len(self._axes))
            self._axes[event.number] = event.value
            return False
        more = event.number + 1 - len(self._buttons)
        self._buttons += [0] * more
        self._down += [False] * more
        before, was_down = self._buttons[event.number], self._down[event.number]
        self._down[event.number] = down = event.value != 0.0
        if not self._sticky:
            self._buttons[event.number] = int(down)
        elif down and not was_down:
            self._buttons[event.number] = 1 - before
        return self._buttons[event.number] != before

    def axes(self, deadzone: float) -> list[float]:
        """What the axes are at, -1 to 1, with a dead zone around 0, see `without_deadzone`."""
        return [without_deadzone(value, deadzone) for value in self._axes]

    @property
    def buttons(self) -> list[int]:
        """What the buttons are at, 1 pressed, 0 not."""
        return list(self._buttons)


def without_deadzone(value: float, deadzone: float) -> float:
    """0 within the dead zone, and from its edge on growing from 0 to the end of the axis without a step.

    Args:
        value: -1 to 1.
        deadzone: 0 to less than 1.
    """
    beyond = abs(value) - deadzone
    return math.copysign(beyond / (1.0 - deadzone), value) if beyond > 0.0 else 0.0
