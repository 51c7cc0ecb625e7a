"""Waiting for files to be readable, until a node is told to stop."""

import math
import os
import select
import threading
from collections.abc import Sequence
from contextlib import suppress


class Waiting:
    """What a thread waits with that reads a device; whoever ends the node wakes it."""

    def __init__(self) -> None:
        self._read, self._write = os.pipe()
        for end in (self._read, self._write):
            os.set_blocking(end, False)
        self._is_open = True
        self._lock = threading.Lock()
        """Its files may belong to somebody else as soon as they are closed."""

    def wake(self) -> None:
        """End every wait from now on; nothing where it was given back."""
        with self._lock, suppress(OSError):
            if self._is_open:
                os.write(self._write, b"\0")

    def wait(self, fds: Sequence[int], timeout: float) -> list[int]:
        """Those of some files that can be read, once one can, or `timeout` s have passed, or it was woken."""
        return [fd for fd in _readable([*fds, self._read], timeout) if fd != self._read]

    def close(self) -> None:
        """Give it back, once nobody waits; safe to call twice."""
        with self._lock:
            if self._is_open:
                self._is_open = False
                os.close(self._read)
                os.close(self._write)


def is_readable(fd: int, timeout: float) -> bool:
    """Whether a file can be read, within `timeout` s; also where the node is told to stop."""
    return bool(_readable([fd], timeout))


def _readable(fds: Sequence[int], timeout: float) -> list[int]:
    """Those that can be read, or have an end to be told of. By poll: select takes no file above the 1,024th."""
    poll = select.poll()
    for fd in fds:
        poll.register(fd, select.POLLIN)
    ready = {fd for fd, _ in poll.poll(math.ceil(1e3 * max(0.0, timeout)))}
    return [fd for fd in fds if fd in ready]
