"""Serial ports: found by path or USB id, opened raw, read and written. Whoever reads waits for `fd` to be readable."""

import errno
import fcntl
import grp
import importlib
import os
import re
import struct
import sys
import termios
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from robo.errors import RunError
from robo_services.waiting import is_readable

_USB_ID = re.compile(r"([0-9a-fA-F]{4}):([0-9a-fA-F]{4})(?::(.+))?")

_MOST_AT_ONCE = 65_536
"""Bytes of one read: a device that says more cannot take all memory."""
PSEUDO_TERMINALS = "/dev/pts/"
"""Where they are."""


class PortGone(OSError):
    """A port cannot be opened, was unplugged, or takes nothing any more; the message says why."""


class SerialPort:
    """A serial port that is open: 8 data bits, no parity, 1 stop bit, no flow control, nobody else's."""

    def __init__(self, place: str, baud: int) -> None:
        """Open it.

        Args:
            place: see `find_port`.
            baud: bits per second.

        Raises:
            PortGone: it is not there, may not be opened, is in use, or does not know this speed.
            RunError: pyserial is not installed.
        """
        serial = import_serial()
        self.path = find_port(place)
        try:
            self._port = serial.Serial(self.path, baud, timeout=0, write_timeout=0, exclusive=True)
        except (OSError, ValueError, termios.error) as error:  # a SerialException is an OSError
            raise PortGone(f"{self.path}: {_reason(error, self.path)}") from None
        self.fd: int = self._port.fileno()
        try:
            with self._gone():
                self._keep()
        except PortGone:
            self.close()
            raise

    def read(self) -> bytes:
        """What has come since; nothing where nothing has.

        Raises:
            PortGone: it was unplugged.
        """
        with self._gone():
            if not is_readable(self.fd, 0.0):
                return b""
            data = os.read(self.fd, _MOST_AT_ONCE)
        if not data:  # ready, and has nothing: so the system tells that a device has left
            raise PortGone(f"{self.path}: it says nothing any more")
        return data

    def write(self, data: bytes, *, backlog: int = sys.maxsize) -> None:
        """Send all of it, without waiting.

        Args:
            data: what to send.
            backlog: where more bytes than this are still to leave, all of them are thrown away: what is said too late
                is not to be said any more.

        Raises:
            PortGone: it was unplugged, or too little leaves it, or nothing.
        """
        unsent = self.unsent()
        if unsent > backlog:
            self.discard()
            raise PortGone(f"{self.path}: it takes too little, {unsent} bytes have not left")
        while data:
            with self._gone():
                try:
                    sent = os.write(self.fd, data)
                except BlockingIOError:
                    sent = 0
            if not sent:
                raise PortGone(f"{self.path}: it takes nothing any more")
            data = data[sent:]

    def unsent(self) -> int:
        """How many bytes have not left yet; 0 of a pseudo-terminal, which does not know.

        Raises:
            PortGone: it was unplugged.
        """
        with self._gone():
            return int(struct.unpack("i", fcntl.ioctl(self.fd, termios.TIOCOUTQ, bytes(4)))[0])

    def discard(self) -> None:
        """Throw away what has not left yet; the other side may have heard a part of it.

        Raises:
            PortGone: it was unplugged.
        """
        with self._gone():
            termios.tcflush(self.fd, termios.TCOFLUSH)

    def _keep(self) -> None:
        """Let nobody else open it, and have it leave the line as it is when it is closed: many boards begin anew where
        their port is opened and the line was down.
        """
        if not os.path.realpath(self.path).startswith(
            PSEUDO_TERMINALS
        ):  # of which it would outlive a process that is killed
            fcntl.ioctl(self.fd, termios.TIOCEXCL)
        modes = termios.tcgetattr(self.fd)
        modes[2] &= ~termios.HUPCL
        termios.tcsetattr(self.fd, termios.TCSANOW, modes)

    def close(self) -> None:
        """Give it back; safe to call twice, and where it is gone."""
        with suppress(OSError):
            fcntl.ioctl(self._port.fileno(), termios.TIOCNXCL)  # else it stays so as long as anybody has it open
        with suppress(OSError):
            self._port.close()

    @contextmanager
    def _gone(self) -> Iterator[None]:
        """What the system says of a port that has left."""
        try:
            yield
        except (OSError, ValueError, termios.error) as error:  # a ValueError of one that is closed
            raise PortGone(f"{self.path}: {_reason(error, self.path)}") from None


def find_port(place: str) -> str:
    """The path of a port.

    Args:
        place: a path, such as /dev/ttyUSB0; or a USB id, vendor:product as `lsusb` shows them, such as 10c4:ea60,
            with the serial number of one of several behind another colon.

    Raises:
        PortGone: no port has this USB id, or several have; says which there are.
        RunError: pyserial is not installed.
    """
    usb = _USB_ID.fullmatch(place)
    if usb is None:
        return place
    import_serial()
    vendor, product, number = int(usb[1], 16), int(usb[2], 16), usb[3]
    there = [one for one in _list_ports().comports() if one.vid is not None]
    found = [one for one in there if (one.vid, one.pid) == (vendor, product) and number in (None, one.serial_number)]
    if len(found) == 1:
        return str(found[0].device)
    named = ", ".join(f"{one.device} ({one.vid:04x}:{one.pid:04x}:{one.serial_number})" for one in found or there)
    what = "several ports have" if found else "no port has"
    raise PortGone(f"{what} the USB id {place}; there is {named or 'none on USB'}")


def import_serial() -> Any:
    """The module of pyserial.

    Raises:
        RunError: it is not installed; names the extra.
    """
    try:
        return importlib.import_module("serial")
    except ImportError:
        text = "a serial port needs pyserial, which is not installed: pip install 'robo-zenoh[serial]'"
        raise RunError(text) from None


def _list_ports() -> Any:
    return importlib.import_module("serial.tools.list_ports")


def _reason(error: Exception, path: str) -> str:
    """Why, and what to do where there is something."""
    number = error.args[0] if isinstance(error, termios.error) else getattr(error, "errno", None)
    if not isinstance(number, int):
        return str(error)
    if number in (errno.EACCES, errno.EPERM):
        return f"{os.strerror(number)}; {_right(path)}"
    if number in (errno.EAGAIN, errno.EBUSY):
        return "another program has it open"
    return os.strerror(number)


def _right(path: str) -> str:
    """How this user may get the right to open it."""
    try:
        group = grp.getgrgid(os.stat(path).st_gid).gr_name
    except (OSError, KeyError):
        return "give this user the right to read and write it"
    return f"sudo usermod -aG {group} $USER, and log in again"
