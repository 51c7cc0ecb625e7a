"""A pseudo-terminal that plays a device on a serial port: for emulations."""

import os
import tty
from contextlib import suppress
from pathlib import Path


class PseudoTerminal:
    """A pseudo-terminal with a link to it, where others look for the device."""

    def __init__(self, link: Path) -> None:
        """
        Plug it in.

        Args:
            link: where the device is to be found; a link that is there, as one that a process has left, is replaced.

        Raises:
            OSError: the link cannot be made, or something else is there.
        """
        self._link = link
        self._master, self._slave = os.openpty()
        try:
            tty.setraw(self._slave)
            os.set_blocking(self._master, False)
            self.path = os.ttyname(self._slave)
            with suppress(FileNotFoundError):
                if link.is_symlink():
                    link.unlink()
            link.symlink_to(self.path)
        except BaseException:
            self._close()
            raise

    def write(self, data: bytes) -> int:
        """Say something. Returns how many bytes were taken: what nobody reads is lost, as on a cable."""
        try:
            return os.write(self._master, data)
        except BlockingIOError:
            return 0

    def read(self) -> bytes:
        """What was said to it; nothing where nothing was."""
        try:
            return os.read(self._master, 65_536)
        except BlockingIOError:
            return b""

    def unplug(self) -> None:
        """Take it away from whoever has it open."""
        with suppress(OSError):
            if self._link.is_symlink() and os.readlink(self._link) == self.path:
                self._link.unlink()
        self._close()

    def _close(self) -> None:
        os.close(self._slave)
        os.close(self._master)
