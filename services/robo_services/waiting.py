"""Waiting for files to be readable, until a node is told to stop."""

import os
import select
from collections.abc import Sequence
from contextlib import suppress


class Waiting:
    """What a thread waits with that reads a device; whoever ends the node wakes it."""

    def __init__(self) -> None:
        self._read, self._write = os.pipe()
        for end in (self._read, self._write):
            os.set_blocking(end, False)

    def wake(self) -> None:
        """End every wait from now on."""
        with suppress(OSError):
            os.write(self._write, b"\0")

    def wait(self, fds: Sequence[int], timeout: float) -> list[int]:
        """Those of some files that can be read, once one can, or `timeout` s have passed, or it was woken."""
        ready = select.select([*fds, self._read], [], [], max(0.0, timeout))[0]
        return [fd for fd in fds if fd in ready]

    def close(self) -> None:
        """Give it back."""
        for end in (self._read, self._write):
            os.close(end)


def is_readable(fd: int, timeout: float) -> bool:
    """Whether a file can be read, within `timeout` s; also where the node is told to stop."""
    return bool(select.select([fd], [], [], max(0.0, timeout))[0])
