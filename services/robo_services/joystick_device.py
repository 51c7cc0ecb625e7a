"""Game pads as devices: opened, named and read. Whoever reads waits for `fd` to be readable."""

import fcntl
import importlib
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Protocol

from robo.errors import RunError
from robo_services.joystick import BTN_JOYSTICK, AxisRange, Event, JsDecoder, button_numbers

INPUTS = Path("/dev/input")

# ioctls of linux/joystick.h: how many axes, how many buttons, the name.
_JSIOCGAXES, _JSIOCGBUTTONS = 0x80016A11, 0x80016A12
_NAME_LENGTH = 128
_JSIOCGNAME = 0x80006A13 + (_NAME_LENGTH << 16)

_EV_SYN, _EV_KEY, _EV_ABS = 0x00, 0x01, 0x03
_SYN_DROPPED = 3
"""So many events came that some were lost."""
_ABS_AXES = 0x40
"""Codes of axes are below."""


class DeviceGone(OSError):
    """A device cannot be opened or was unplugged; the message says why."""


class Device(Protocol):
    """A pad that is plugged in."""

    fd: int
    name: str
    axes: int
    """How many it says that it has; events may know of more."""
    buttons: int

    def read(self) -> list[Event]:
        """What has happened since; at first, what all axes and buttons are at.

        Raises:
            DeviceGone: it was unplugged.
        """

    def close(self) -> None:
        """Give it back."""


class JsDevice:
    """One of /dev/input/js*, or anything else that says `js_event`."""

    def __init__(self, path: Path) -> None:
        """Open it; raises DeviceGone."""
        with _gone():
            self.fd = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        self.name = ""
        self.axes = self.buttons = 0
        with suppress(OSError):  # it is none of the kernel's
            self.axes = self._ask(_JSIOCGAXES, 1)[0]
            self.buttons = self._ask(_JSIOCGBUTTONS, 1)[0]
            self.name = self._ask(_JSIOCGNAME, _NAME_LENGTH).split(b"\0")[0].decode(errors="replace")
        self._decoder = JsDecoder()

    def read(self) -> list[Event]:
        """See `Device`."""
        with _gone():
            try:
                data = os.read(self.fd, 4096)
            except BlockingIOError:
                return []
        if not data:
            raise DeviceGone("it says nothing any more")
        return self._decoder.feed(data)

    def close(self) -> None:
        """See `Device`."""
        os.close(self.fd)

    def _ask(self, request: int, length: int) -> bytes:
        return fcntl.ioctl(self.fd, request, bytes(length))


class EvdevDevice:
    """One of /dev/input/event*, by python-evdev."""

    def __init__(self, path: Path) -> None:
        """Open it; raises DeviceGone, or RunError where python-evdev is not installed."""
        evdev = import_evdev()
        with _gone():
            self._device: Any = evdev.InputDevice(str(path))
        self.fd = self._device.fd
        self.name = self._device.name
        there: dict[int, list[Any]] = self._device.capabilities(absinfo=True)
        infos = {code: info for code, info in there.get(_EV_ABS, []) if code < _ABS_AXES}
        self._axes = {code: number for number, code in enumerate(sorted(infos))}
        self._ranges = {code: AxisRange(info.min, info.max) for code, info in infos.items()}
        self._buttons = button_numbers(there.get(_EV_KEY, []))
        self.axes, self.buttons = len(self._axes), len(self._buttons)
        self._is_known = False

    @property
    def is_pad(self) -> bool:
        """Whether it has axes and buttons; keyboards, mice and lids are devices of evdev's too."""
        return self.axes > 0 and any(code >= BTN_JOYSTICK for code in self._buttons)

    def read(self) -> list[Event]:
        """See `Device`."""
        with _gone():
            if not self._is_known:
                self._is_known = True
                return self._state()
            try:
                said = list(self._device.read())
            except BlockingIOError:
                return []
            if any(event.type == _EV_SYN and event.code == _SYN_DROPPED for event in said):
                return self._state()  # else a button whose end was dropped would be held for ever
        events = []
        for event in said:
            if event.type == _EV_KEY and event.code in self._buttons:
                events.append(Event(True, self._buttons[event.code], float(event.value != 0)))
            elif event.type == _EV_ABS and event.code in self._axes:
                events.append(self._axis_event(event.code, event.value))
        return events

    def close(self) -> None:
        """See `Device`."""
        self._device.close()

    def _state(self) -> list[Event]:
        pressed = set(self._device.active_keys())
        buttons = [Event(True, number, float(code in pressed)) for code, number in self._buttons.items()]
        return buttons + [self._axis_event(code, self._device.absinfo(code).value) for code in self._axes]

    def _axis_event(self, code: int, value: int) -> Event:
        return Event(False, self._axes[code], self._ranges[code].normalized(value))


def open_device(interface: str, path: str, number: int, name: str) -> Device:
    """Open a pad.

    Args:
        interface: `js` or `evdev`.
        path: of its device; "" to look for it.
        number: which of those that are there, from 0.
        name: as the pad says it; "" for any. It goes before the number.

    Raises:
        DeviceGone: there is none, or it cannot be opened; says which there are.
        RunError: `evdev` is wanted, and is not installed.
    """
    if path:
        return _opened(interface, Path(path))
    found: list[str] = []
    index = 0
    for place in _places(interface):
        try:
            device = _opened(interface, place)
        except DeviceGone as error:
            found.append(f"{place} ({error})")
            continue
        if not (isinstance(device, EvdevDevice) and not device.is_pad):
            if (device.name == name) if name else (index == number):
                return device
            index += 1
            found.append(device.name or str(place))
        device.close()
    wanted = f"called {name!r}" if name else f"number {number}"
    raise DeviceGone(f"there is no pad {wanted}; there is {', '.join(found) or 'none'}")


def import_evdev() -> Any:
    """The module of python-evdev.

    Raises:
        RunError: it is not installed; names the extra.
    """
    try:
        return importlib.import_module("evdev")
    except ImportError:
        text = (
            "interface evdev needs python-evdev, which is not installed: pip install 'robo-zenoh[joy]'; js needs none"
        )
        raise RunError(text) from None


def _places(interface: str) -> list[Path]:
    """Where there may be pads, by their numbers."""
    prefix = "js" if interface == "js" else "event"
    numbered = [path for path in INPUTS.glob(f"{prefix}*") if path.name.removeprefix(prefix).isdigit()]
    return sorted(numbered, key=lambda one: int(one.name.removeprefix(prefix)))


def _opened(interface: str, path: Path) -> JsDevice | EvdevDevice:
    return JsDevice(path) if interface == "js" else EvdevDevice(path)


@contextmanager
def _gone() -> Iterator[None]:
    """What the system says of a device that is not there, may not be read, or was unplugged."""
    try:
        yield
    except BlockingIOError:
        raise
    except OSError as error:
        raise DeviceGone(f"{error.strerror or error}") from None
