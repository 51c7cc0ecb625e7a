"""Whether a process was killed for want of memory, as far as the kernel tells."""

from collections.abc import Callable
from pathlib import Path

VMSTAT = Path("/proc/vmstat")

_PERIOD = 1.0
"""How often the kernel is asked, s."""


def oom_kills(file: Path = VMSTAT) -> int | None:
    """How many processes the kernel has killed for want of memory since it began; None where it does not tell.

    It counts those that were over the limit of a control group or container as well.
    """
    try:
        lines = file.read_text().splitlines()
    except (OSError, UnicodeDecodeError):
        return None
    counts = [line.removeprefix("oom_kill ") for line in lines if line.startswith("oom_kill ")]
    return int(counts[0]) if counts and counts[0].isdecimal() else None


class MemoryKills:
    """What the kernel has killed lately for want of memory: it says how many, and not which."""

    def __init__(self, now: float, count: Callable[[], int | None] = oom_kills) -> None:
        """`now` is of the monotonic clock, s."""
        self._count = count
        self._before = self._last = count()
        self._at = now

    def look(self, now: float) -> None:
        """To be called often."""
        if now - self._at >= _PERIOD:
            self._before, self._last, self._at = self._last, self._count(), now

    def hint(self) -> str:
        """What is to be said of a process that has just been ended by a SIGKILL that nobody here has sent."""
        count = self._count()
        if count is None or self._before is None:
            return ", by somebody or by the kernel for want of memory"
        if count <= self._before:
            return ""
        self._before += 1  # each of them ends one process
        return ", most likely by the kernel, for want of memory"
