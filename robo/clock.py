"""What time it is, for stamps and for waiting."""

import time

from robo_messages import Time


class Clock:
    """The wall clock. Stamps come from it; timers and timeouts use the monotonic clock, which no
    adjustment of the wall clock can move.
    """

    def now(self) -> Time:
        """The time for stamps."""
        return Time.from_nanoseconds(time.time_ns())

    def monotonic(self) -> float:
        """S since an arbitrary start; only differences mean anything."""
        return time.monotonic()
