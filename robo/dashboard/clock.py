"""The server's time: that of the machine when it began, and from then on one that never jumps.

By it pages tell how old everything is, whatever their own clocks say, and whatever becomes of this machine's.
"""

import time

_BEGIN = time.time_ns() - time.monotonic_ns()


def now() -> int:
    """What time it is, ns since the epoch."""
    return _BEGIN + time.monotonic_ns()
