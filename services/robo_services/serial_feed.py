"""What a node's `main` reads of a serial port that may be unplugged and come back."""

import os
import select
from collections.abc import Callable, Generator
from contextlib import suppress

from robo_services.serial_port import PortGone, SerialPort

RETRY = 0.5
"""How long it waits before it looks for a port again, s."""

SILENCE = 1.0
"""It gives a sign at least this often while nothing comes, s."""


class SerialFeed:
    """Reads a port, and opens it again after it was unplugged; says once that it is not there."""

    def __init__(self, place: str, baud: int, warn: Callable[[str], None], opened: Callable[[str], None]) -> None:
        """
        Args:
            place: as of `serial_port.find_port`.
            baud: bits per second.
            warn: is told why there is no port, once however long it stays away.
            opened: is told the path of a port that is open now: what came before belongs to another stream.
        """
        self._place, self._baud, self._warn, self._opened = place, baud, warn, opened
        self.missed = ""
        """Why there is no port; nothing while there is one."""
        self._wake = os.pipe()
        for end in self._wake:
            os.set_blocking(end, False)

    def chunks(self, stopping: Callable[[], bool]) -> Generator[bytes, None, None]:
        """What the port says, in pieces as they come, until it is to stop.

        A piece is empty where nothing has come for `SILENCE`, and while there is no port.
        """
        while not stopping():
            try:
                port = SerialPort(self._place, self._baud)
            except PortGone as error:
                if str(error) != self.missed:
                    self.missed = str(error)
                    self._warn(f"no port: {error}; it is waited for")
                self._waits_for([], RETRY)
                yield b""
                continue
            self.missed = ""
            self._opened(port.path)
            try:
                while not stopping():
                    self._waits_for([port.fd], SILENCE)
                    yield port.read()
            except PortGone as error:
                self.missed = str(error)
                self._warn(f"the port is gone: {error}; it is waited for")
            finally:
                port.close()

    def wake(self) -> None:
        """Let it look at once whether it is to stop."""
        with suppress(OSError):
            os.write(self._wake[1], b"\0")

    def close(self) -> None:
        """Give back what woke it."""
        for end in self._wake:
            with suppress(OSError):
                os.close(end)

    def _waits_for(self, fds: list[int], timeout: float) -> None:
        select.select([*fds, self._wake[0]], [], [], timeout)


def shown(data: bytes, most: int = 16) -> str:
    """Bytes for a log, the first ones: `54 2c … (47 bytes)`."""
    text = data[:most].hex(" ")
    return text if len(data) <= most else f"{text} … ({len(data)} bytes)"
