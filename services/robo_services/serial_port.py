"""Serial ports: found by path or by USB id, opened for this process alone, read and written without waiting."""

import errno
import grp
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

from robo.errors import RunError

USB_ID = r"^([0-9A-Fa-f]{4}:[0-9A-Fa-f]{4}(:.+)?)?$"
"""`2341:0043`, maker and product in hexadecimal digits, or with the serial number behind them."""


class PortGone(OSError):
    """A port is not there, may not be opened, or was unplugged; the message says which."""


class FoundPort(NamedTuple):
    """A port on USB."""

    path: str
    usb_id: str
    """Maker, product and serial number, as `USB_ID` has them."""
    description: str

    def __str__(self) -> str:
        return f"{self.path} ({self.usb_id}, {self.description})"


class Port:
    """A port that is open; nobody else who asks politely opens it meanwhile."""

    def __init__(self, path: str, baud: int) -> None:
        """Open it; 8 data bits, no parity.

        Raises:
            PortGone: it cannot be opened.
            RunError: pyserial is not installed.
        """
        serial = import_serial()
        self.path = path
        try:
            self._port: Any = serial.Serial(path, baud, timeout=0, exclusive=True)
        except (OSError, ValueError) as error:  # pyserial's own errors are OSErrors
            raise PortGone(_why(path, error)) from None
        self.fd: int = self._port.fileno()

    def read(self) -> bytes:
        """What has come; to be called when `fd` can be read.

        Raises:
            PortGone: it was unplugged.
        """
        with _gone(self.path):
            try:
                data = os.read(self.fd, 4096)
            except BlockingIOError:
                return b""
            if not data:  # it could be read, and there is nothing: which is how a port says that it ends
                raise PortGone(f"{self.path} was unplugged")
            return data

    def write(self, data: bytes) -> None:
        """Say something, as much of it as goes out at once.

        Raises:
            PortGone: it was unplugged.
        """
        with _gone(self.path):
            try:
                os.write(self.fd, data)
            except BlockingIOError:  # who is there does not listen; what it does not answer is noticed
                return

    def close(self) -> None:
        """Give it back."""
        with _quiet():
            self._port.close()


def open_port(path: str, usb_id: str, baud: int) -> Port:
    """Open the port of a board.

    Args:
        path: such as /dev/ttyUSB0; "" to look for it.
        usb_id: as `USB_ID` says; "" for the only port on USB that there is.
        baud: bits per second.

    Raises:
        PortGone: it is not there, or there are several; says which there are.
        RunError: pyserial is not installed.
    """
    return Port(path or choose(usb_ports(), usb_id).path, baud)


def choose(there: list[FoundPort], usb_id: str) -> FoundPort:
    """The port that is meant.

    Raises:
        PortGone: there is none, or more than one.
    """
    wanted = usb_id.lower()
    fit = [one for one in there if f"{one.usb_id.lower()}:".startswith(f"{wanted}:" if wanted else "")]
    if len(fit) == 1:
        return fit[0]
    listed = ", ".join(map(str, fit or there)) or "none"
    if fit:
        raise PortGone(f"several ports may be meant, say port or usb_id with a serial number: {listed}")
    which = f"with the id {usb_id}" if usb_id else "on USB"
    raise PortGone(f"there is no serial port {which}; there is {listed}")


def usb_ports() -> list[FoundPort]:
    """The serial ports on USB, by their names.

    Raises:
        RunError: pyserial is not installed.
    """
    import_serial()
    from serial.tools import list_ports

    found = [port for port in list_ports.comports() if port.vid is not None]
    return sorted(FoundPort(port.device, _id_of(port), port.description or "no description") for port in found)


def import_serial() -> Any:
    """The module of pyserial.

    Raises:
        RunError: it is not installed; names the extra.
    """
    try:
        import serial
    except ImportError:
        raise RunError("serial ports need pyserial, which is not installed: pip install 'robo-zenoh[serial]'") from None
    return serial


def _id_of(port: Any) -> str:
    number = f":{port.serial_number}" if port.serial_number else ""
    return f"{port.vid:04x}:{port.pid:04x}{number}"


def _why(path: str, error: Exception) -> str:
    """Why a port cannot be opened, and what to do about it."""
    number = getattr(error, "errno", None)
    if number == errno.EACCES:
        return f"{path} may not be opened by this user{_group_hint(path)}"
    if number in (errno.EBUSY, errno.EAGAIN) or "exclusively lock" in str(error):
        return f"{path} is open elsewhere: one program at a time talks to a board"
    if number in (errno.ENOENT, errno.ENXIO, errno.ENODEV):
        return f"{path} is not there"
    if number is not None:
        return f"{path}: {os.strerror(number)}"
    found = re.search(r"\((\d+), '[^']*'\)", str(error))  # pyserial puts what the system said into its own text
    return f"{path} is no serial port: {os.strerror(int(found[1]))}" if found is not None else f"{path}: {error}"


def _group_hint(path: str) -> str:
    try:
        group = grp.getgrgid(os.stat(path).st_gid).gr_name
    except (OSError, KeyError):
        return ""
    return f": sudo usermod -aG {group} $USER, and log in again"


@contextmanager
def _gone(path: str) -> Iterator[None]:
    try:
        yield
    except PortGone:
        raise
    except OSError as error:
        what = "was unplugged" if error.errno in (errno.EIO, errno.ENXIO, errno.ENODEV) else error.strerror
        raise PortGone(f"{path} {what}") from None


@contextmanager
def _quiet() -> Iterator[None]:
    try:
        yield
    except OSError:
        return
