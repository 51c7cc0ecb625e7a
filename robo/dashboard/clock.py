"""The server's time: that of the machine when it began, and from then on one that never jumps.

By it pages tell how old everything is, whatever their own clocks say, and whatever becomes of this machine's.
"""

import time

_STEADY = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)
"""A command that was said before this machine slept is old when it wakes: Linux counts that by this one alone."""


def steady() -> float:
    """By a clock that never goes back, s."""
    return time.clock_gettime(_STEADY)


_BEGIN = time.time_ns() - time.clock_gettime_ns(_STEADY)


def now() -> int:
    """What time it is, ns since the epoch."""
    return _BEGIN + time.clock_gettime_ns(_STEADY)
