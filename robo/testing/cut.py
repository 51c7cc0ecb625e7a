"""Cutting a process off its network without any rights over it, and letting it join again.

Its connections are shut down, and while its limit of open files is low it can open no new ones.
"""

from __future__ import annotations

import ctypes
import os
import socket
import sys
from contextlib import suppress
from pathlib import Path

import psutil

from robo.errors import RoboError

_PIDFD_GETFD = 438
"""The system call that duplicates another process's descriptor; the same number on all of Linux's machines."""


class CannotCut(RoboError):
    """This system does not let one process cut another one off."""


class Cut:
    """A process that is cut off."""

    def __init__(self, pid: int) -> None:
        """
        Args:
            pid: the process.

        Raises:
            CannotCut: the system does not allow it.
        """
        if sys.platform != "linux":
            raise CannotCut("only Linux lets a test cut a node off; robot.pause() works everywhere")
        self._pid = pid
        self._process = psutil.Process(pid)
        self._limit = self._process.rlimit(psutil.RLIMIT_NOFILE)
        self._process.rlimit(psutil.RLIMIT_NOFILE, (0, self._limit[1]))
        try:
            self._shut_down()
        except BaseException:
            self.mend()
            raise

    def mend(self) -> None:
        """Let it open connections again."""
        with suppress(psutil.Error):
            self._process.rlimit(psutil.RLIMIT_NOFILE, self._limit)

    def _shut_down(self) -> None:
        handle = os.pidfd_open(self._pid)
        try:
            for name in os.listdir(f"/proc/{self._pid}/fd"):
                with suppress(FileNotFoundError):
                    target = os.readlink(Path(f"/proc/{self._pid}/fd/{name}"))
                    if target.startswith("socket:") and int(name) > 2:
                        _shut_down(handle, int(name))
        finally:
            os.close(handle)


def _shut_down(handle: int, descriptor: int) -> None:
    """Shut down a connection of another process; what listens, or is connected with nobody, is left alone."""
    ours = ctypes.CDLL(None, use_errno=True).syscall(_PIDFD_GETFD, handle, descriptor, 0)
    if ours < 0:
        reason = os.strerror(ctypes.get_errno())
        raise CannotCut(f"the system does not let this process cut another one off: {reason}")
    with socket.socket(fileno=ours) as connection, suppress(OSError):
        connection.getpeername()
        if connection.type == socket.SOCK_STREAM:  # the heartbeat to the supervisor is none: it is no network
            connection.shutdown(socket.SHUT_RDWR)
