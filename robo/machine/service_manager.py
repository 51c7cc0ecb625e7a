"""What has started a run as a service, such as systemd: it hears how the run comes along, and that it does not hang.

The words are those of sd_notify(3): lines of `NAME=value` in a datagram to a unix socket. This module imports next to
nothing, since it is there before the run is.
"""

import os
import socket
from typing import NamedTuple

_VARIABLES = ("NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID")


class ServiceManager(NamedTuple):
    """How it is told."""

    address: str
    """Of its socket; an abstract one begins with a zero."""
    watchdog: float | None = None
    """Without a sign of life for so long it takes this process for one that hangs, s."""

    @classmethod
    def from_environment(cls) -> "ServiceManager | None":
        """Who has started this process as a service; None where it was not.

        The variables go out of the environment: whatever is started from here must not speak for this process.
        """
        where, period, pid = (os.environ.pop(name, "") for name in _VARIABLES)
        if where[:1] not in ("/", "@"):
            return None
        meant = period.isdecimal() and int(period) > 0 and pid in ("", str(os.getpid()))
        address = "\0" + where[1:] if where[0] == "@" else where
        return cls(address, int(period) / 1e6 if meant else None)

    def tell(self, *lines: str) -> bool:
        """Tell something, without waiting for anybody.

        Args:
            lines: each `NAME=value`.

        Returns:
            Whether that worked; a service manager that starts itself again hears nothing meanwhile.
        """
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as out:
            try:
                out.sendto("\n".join(lines).encode(), socket.MSG_DONTWAIT, self.address)
            except OSError:
                return False
        return True
