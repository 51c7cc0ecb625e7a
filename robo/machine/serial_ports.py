"""Serial ports of this machine: which there are, who may open them, who has, and, where it is wanted, who answers."""

import contextlib
import errno
import fcntl
import glob
import grp
import os
import re
import select
import termios
import time
import tty
from collections.abc import Iterator
from pathlib import Path

import msgspec

PATTERNS = (
    *("/dev/ttyUSB*", "/dev/ttyACM*", "/dev/ttyAMA*", "/dev/ttyTHS*", "/dev/rfcomm*"),
    "/dev/serial[0-9]*",
    "/dev/cu.usb*",
)
"""Where adapters, boards, the pins of small computers and Bluetooth are; at `serial0` a Raspberry Pi has its pins,
however they are called; the last one is on macOS.
"""
STARTING = 3.0
"""A board that is started by being opened, as many are, may take this time, s."""
_AGAIN = 0.25
_MOST = 200
STOCK_BAUD = 57_600
"""Bits per second of the firmware as it comes, and of `serial_base`."""
_BAUDS = {STOCK_BAUD: termios.B57600, 115_200: termios.B115200}
_READING = re.compile(rb"(?:^|[\r\n])(-?\d{1,10} -?\d{1,10})\r?\n")


class FoundPort(msgspec.Struct, frozen=True):
    """A serial port that is there."""

    path: str
    usb_id: str = ""
    """Maker and product, as `1a86:7523`; empty where it is on no USB."""
    name: str = ""
    """What it says of itself."""

    def __str__(self) -> str:
        known = ", ".join(filter(None, (self.usb_id, self.name)))
        return f"{self.path} ({known})" if known else self.path


class Answer(msgspec.Struct, frozen=True):
    """What was said at a port that was asked for the encoders of a base, as ros_arduino_bridge's firmware has them."""

    baud: int
    """Bits per second."""
    reading: str = ""
    """Left and right, where it answers so."""
    said: bytes = b""
    """All of it, or its beginning."""


def found() -> list[FoundPort]:
    """The ports that are there, by their names; of several names of one the first."""
    there: dict[str, str] = {}
    for path in (path for pattern in PATTERNS for path in sorted(glob.glob(pattern))):
        there.setdefault(os.path.realpath(path), path)
    return [_described(path) for path in there.values()]


def may_open(port: FoundPort) -> bool:
    """Whether this user may read and write it."""
    return os.access(port.path, os.R_OK | os.W_OK)


def group_of(port: FoundPort) -> str:
    """The group whose members may, such as dialout; empty where it has no name."""
    try:
        return grp.getgrgid(os.stat(port.path).st_gid).gr_name
    except (OSError, KeyError):
        return ""


def holders(port: FoundPort) -> list[int]:
    """The processes that have it open, as far as this user may see them."""
    device = os.path.realpath(port.path)
    held = set()
    for link in glob.iglob("/proc/[0-9]*/fd/*"):
        with contextlib.suppress(OSError):
            if os.readlink(link) == device:
                held.add(int(link.split("/")[2]))
    return sorted(held - {os.getpid()})


def ask(port: FoundPort, starting: float = STARTING) -> Answer | None:
    """Ask for the encoders of a base; whatever else is there gets these bytes too. None where somebody has the port.

    Args:
        port: is opened, which starts many boards anew.
        starting: how long it may take to answer, s; with other bits per second than the first less.

    Raises:
        OSError: it cannot be opened, or was unplugged.
    """
    heard = Answer(STOCK_BAUD)
    with _opened(port.path) as fd:
        if fd is None:
            return None
        for number, baud in enumerate(_BAUDS):
            _set_up(fd, _BAUDS[baud])
            said = _listen(fd, starting if number == 0 else min(starting, 1.0))
            reading = _READING.search(said)
            if reading is not None:
                return Answer(baud, reading[1].decode(), said[:_MOST])
            if said and not heard.said:
                heard = Answer(baud, said=said[:_MOST])
    return heard


def _listen(fd: int, limit: float) -> bytes:
    """Ask until it is answered, or `limit` s have passed."""
    said = b""
    end = time.monotonic() + limit
    while time.monotonic() < end and len(said) < 20 * _MOST and not _READING.search(said):
        with contextlib.suppress(BlockingIOError):
            os.write(fd, b"\re\r")
        if select.select([fd], [], [], _AGAIN)[0]:
            time.sleep(0.02)  # for the rest of the line
            said += os.read(fd, 4096)
    return said


@contextlib.contextmanager
def _opened(path: str) -> Iterator[int | None]:
    try:
        fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        if error.errno != errno.EBUSY:
            raise
        yield None
        return
    try:
        try:
            fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)  # whoever opens it politely has this lock
        except BlockingIOError:
            yield None
        else:
            fcntl.ioctl(fd, termios.TIOCEXCL)
            try:
                yield fd
            finally:
                with contextlib.suppress(OSError):
                    fcntl.ioctl(fd, termios.TIOCNXCL)
    finally:
        os.close(fd)


def _set_up(fd: int, speed: int) -> None:
    """8 data bits, no parity, nothing of what terminals do with letters."""
    try:
        tty.setraw(fd)
        modes = termios.tcgetattr(fd)
        modes[2] |= termios.CLOCAL | termios.CREAD
        modes[2] &= ~termios.HUPCL  # else who opens it next starts many boards anew once more
        modes[4] = modes[5] = speed
        termios.tcsetattr(fd, termios.TCSANOW, modes)
        termios.tcflush(fd, termios.TCIOFLUSH)
    except termios.error as error:
        raise OSError(*error.args) from None


def _described(path: str) -> FoundPort:
    """What Linux knows of the USB device behind it: the nearest folder above that has a maker."""
    place = Path(os.path.realpath(f"/sys/class/tty/{os.path.basename(os.path.realpath(path))}/device"))
    for folder in (place, *place.parents):
        if (folder / "idVendor").is_file():
            maker, product, name = (_text(folder / file) for file in ("idVendor", "idProduct", "product"))
            return FoundPort(path, f"{maker}:{product}", name)
    return FoundPort(path)


def _text(file: Path) -> str:
    try:
        return file.read_text(errors="replace").strip()
    except OSError:
        return ""
