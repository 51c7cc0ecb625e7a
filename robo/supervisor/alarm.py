"""A call at a time that may change."""

import asyncio
import time
from collections.abc import Callable


class Alarm:
    """Calls something at the time that it was last set to."""

    def __init__(self, ring: Callable[[], None], clock: Callable[[], float] = time.monotonic) -> None:
        """
        Args:
            ring: what is called.
            clock: the time, s, as fast as that of the loop.
        """
        self._ring = ring
        self._clock = clock
        self._handle: asyncio.TimerHandle | None = None

    def set(self, at: float | None) -> None:
        """Ring at a time of the clock, and at no other; None for never."""
        if self._handle is not None:
            self._handle.cancel()
            self._handle = None
        if at is not None:
            wait = max(0.0, at - self._clock())
            self._handle = asyncio.get_running_loop().call_later(wait, self._ring)
