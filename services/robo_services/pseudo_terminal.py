"""A pseudo-terminal that plays a device on a serial port: for emulations."""

import errno
import os
import tty
from contextlib import suppress
from pathlib import Path

from robo_services.serial_port import PSEUDO_TERMINALS


class PseudoTerminal:
    """A pseudo-terminal with a link to it, where others look for the device."""

    def __init__(self, link: Path) -> None:
        """
        Plug it in.

        Args:
            link: where the device is to be found; a link to a pseudo-terminal, as a process has left that was killed,
                is replaced.

        Raises:
            OSError: the link cannot be made, or something else is there.
        """
        self._link = link
        self.fd, self._slave = os.openpty()
        """Whoever plays the device waits for it to be readable."""
        try:
            tty.setraw(self._slave)
            os.set_blocking(self.fd, False)
            self.path = os.ttyname(self._slave)
            self._point_there()
        except BaseException:
            self._close()
            raise

    def write(self, data: bytes) -> int:
        """Say something. Returns how many bytes were taken: what nobody reads is lost, as on a cable."""
        try:
            return os.write(self.fd, data)
        except BlockingIOError:
            return 0

    def read(self) -> bytes:
        """What was said to it; nothing where nothing was."""
        try:
            return os.read(self.fd, 65_536)
        except BlockingIOError:
            return b""

    def unplug(self) -> None:
        """Take it away from whoever has it open."""
        with suppress(OSError):
            if os.readlink(self._link) == self.path:
                self._link.unlink()
        self._close()

    def _point_there(self) -> None:
        """Make the link, at once: whoever looks finds the one before or this one."""
        is_left = self._link.is_symlink() and os.readlink(self._link).startswith(PSEUDO_TERMINALS)
        if os.path.lexists(self._link) and not is_left:
            raise FileExistsError(errno.EEXIST, "something else is there", str(self._link))
        new = self._link.with_name(f"{self._link.name}.{os.getpid()}")
        new.unlink(missing_ok=True)
        new.symlink_to(self.path)
        new.replace(self._link)

    def _close(self) -> None:
        os.close(self._slave)
        os.close(self.fd)
