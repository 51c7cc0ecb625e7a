"""What a node's `main` reads of a serial port that may be unplugged and come back."""

import math
import termios
from collections.abc import Callable, Generator
from contextlib import suppress

from robo.node.clock import Clock
from robo_services.serial_port import PortGone, SerialPort
from robo_services.waiting import Waiting

RETRY = 0.5
"""How long it waits before it looks for a port again, s."""

SILENCE = 1.0
"""It gives a sign at least this often while nothing comes, s."""

SETTLING = 0.03
"""What an adapter on USB has kept for a port whose buffer was full comes within this time, s."""

_MONOTONIC = Clock().monotonic


class SerialFeed:
    """Reads a port, and opens it again after it was unplugged; says once that it is not there.

    A port keeps what nobody reads, and when it is full it drops what is new: a process that was held up would take
    what is old for what is new. A feed with a limit leaves that out, and tells it.
    """

    def __init__(
        self,
        place: str,
        baud: int,
        warn: Callable[[str], None],
        opened: Callable[[str], None],
        *,
        stale_after: float = math.inf,
        held_up: Callable[[float], None] = lambda _: None,
        now: Callable[[], float] = _MONOTONIC,
    ) -> None:
        """
        Args:
            place: as of `serial_port.find_port`.
            baud: bits per second.
            warn: is told why there is no port, once however long it stays away.
            opened: is told the path of a port that is open now: what came before belongs to another stream.
            stale_after: what has waited for longer is left out, s: longer than what speaks all the time ever pauses.
            held_up: is told for how long, s, nothing was read: what comes next does not join on to what came before.
            now: s by a monotonic clock, which goes on while the machine sleeps.
        """
        self._place, self._baud, self._warn, self._opened = place, baud, warn, opened
        self._stale_after, self._held_up, self._now = stale_after, held_up, now
        self.missed = ""
        """Why there is no port; nothing while there is one."""
        self.read_at = now()
        """When the last piece was read, or a little sooner, s by the clock of `now`."""
        self._waiting = Waiting()

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
                self._waiting.wait([], RETRY)
                yield b""
                continue
            self.missed = ""
            self._opened(port.path)
            try:
                yield from self._said(port, stopping)
            except PortGone as error:
                self.missed = str(error)
                self._warn(f"the port is gone: {error}; it is waited for")
            finally:
                port.close()

    def wake(self) -> None:
        """Let it look at once whether it is to stop."""
        self._waiting.wake()

    def close(self) -> None:
        """Give back what woke it."""
        self._waiting.close()

    def _said(self, port: SerialPort, stopping: Callable[[], bool]) -> Generator[bytes, None, None]:
        self.read_at = self._now()
        while not stopping():
            self._waiting.wait([port.fd], min(SILENCE, self._stale_after / 2.0))  # so silence is no being held up
            before, begin = self.read_at, self._now()
            data = port.read()
            self.read_at = begin  # by then nothing older was left
            gap = self._now() - before
            if data and gap > self._stale_after:
                self._discard(port)
                self._held_up(gap)
                continue
            yield data

    def _discard(self, port: SerialPort) -> None:
        """Drop what waits in the port, and what an adapter still has for it."""
        for pause in (0.0, SETTLING):
            self._waiting.wait([], pause)
            self.read_at = self._now()
            with suppress(termios.error):  # it has left, which reading it says
                termios.tcflush(port.fd, termios.TCIFLUSH)


def shown(data: bytes, most: int = 16) -> str:
    """Bytes for a log, the first ones: `54 2c … (47 bytes)`."""
    text = data[:most].hex(" ")
    return text if len(data) <= most else f"{text} … ({len(data)} bytes)"
