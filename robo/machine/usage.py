"""The processor time and the memory that a process uses."""

import math
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import psutil  # which a start does without

_LEAST_MEASURED = 0.5
"""Over how long processor time is measured at least, s: over a shorter time the figure would be noise."""


class Usage:
    """What one process uses; several may ask for it."""

    def __init__(self, pid: int, clock: Callable[[], float] = time.monotonic) -> None:
        self._pid = pid
        self._clock = clock
        self._process: psutil.Process | None = None
        self._found: tuple[float | None, int | None] = None, None
        self._measured_at = -math.inf

    def measure(self) -> tuple[float | None, int | None]:
        """The processor time since it was last measured, in percent of one core, and the resident memory, bytes.

        Both are None where the process is gone; the first processor time is 0.
        """
        import psutil

        try:
            if self._process is None:
                self._process = psutil.Process(self._pid)
            now = self._clock()
            if now - self._measured_at >= _LEAST_MEASURED:
                with self._process.oneshot():
                    self._found = self._process.cpu_percent(), self._process.memory_info().rss
                self._measured_at = now
            return self._found
        except psutil.Error:
            return None, None

    def begin(self) -> None:
        """Begin to measure, if that has not begun."""
        if self._process is None:
            self.measure()
