"""What time it is, for stamps and for waiting: the wall clock, or a time that somebody publishes."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from robo.node.stage import Stage
from robo.node.turn import Barrier
from robo_messages import Time

_CLOCK: int = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)
"""It goes on while the machine is suspended: what was said before is old afterwards. So does macOS's
CLOCK_MONOTONIC, while Linux's stands still."""


def monotonic_ns() -> int:
    """Time since an arbitrary start, ns; nothing sets it, and it counts the time in which a machine sleeps."""
    return time.clock_gettime_ns(_CLOCK)


class Clock:
    """The wall clock. Stamps come from it; timers and timeouts use the monotonic clock, which no
    adjustment of the wall clock can move.

    Whoever brings a clock of its own (`robo.testing` does) says all of this by it.
    """

    time_ns: Callable[[], int] = staticmethod(time.time_ns)
    """What messages are stamped with as they leave, ns since the Unix epoch."""
    arrival_ns: Callable[[], int] = staticmethod(monotonic_ns)
    """What the age of messages is reckoned by where they arrive: time since an arbitrary start, ns."""
    barrier: Callable[[], Barrier] = staticmethod(threading.Lock)
    """Makes what a thread waits at for its turn."""

    stage: Stage = Stage()
    """Where threads meet the loop of async callbacks."""

    @property
    def wall(self) -> Clock:
        """The clock that goes on where simulated time stands still: itself, but for a `SimClock`."""
        return self

    def expect(self, thread: threading.Thread, *, strict: bool = True) -> None:
        """Take note of a thread that is about to start and will wait by this clock.

        Args:
            thread: which.
            strict: whether all it does between two waits are callbacks, which come to an end.
        """

    def now(self) -> Time:
        """The time for stamps."""
        return Time.from_nanoseconds(time.time_ns())

    def monotonic(self) -> float:
        """Time since an arbitrary start, s; only differences mean anything."""
        return time.clock_gettime(_CLOCK)

    @property
    def jumps(self) -> int:
        """How often `monotonic()` has been set instead of gone on. Whoever wants to wait reads it before the time."""
        return 0

    def wait(self, woken: threading.Event, until: float, jumps: int) -> bool:
        """Wait until `monotonic()` is `until`.

        Returns early, and true, once `woken` is set and `wake` called, or once there were more jumps than `jumps`:
        what `until` was reckoned from is no longer so.
        """
        left = max(0.0, until - time.clock_gettime(_CLOCK))
        return jumps != self.jumps or woken.wait(min(left, threading.TIMEOUT_MAX))

    def wake(self) -> None:
        """Let whoever waits look at its event."""


class SimClock(Clock):
    """The time that a simulator or a player says, from 0 until it first says one.

    It moves when `advance` is called, and whoever waits then looks at it.
    """

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._nanoseconds = 0
        self._jumps = 0

    @property
    def wall(self) -> Clock:
        """The wall clock."""
        return Clock()

    def now(self) -> Time:
        """The last time that was said."""
        return Time.from_nanoseconds(self._nanoseconds)

    def monotonic(self) -> float:
        """The same in s. It steps back where the time does: a log that is played again."""
        return self._nanoseconds * 1e-9

    @property
    def jumps(self) -> int:
        """How often the time stepped back; the first one that is said counts too."""
        return self._jumps

    def advance(self, nanoseconds: int) -> None:
        """Set the time, ns."""
        with self._changed:
            self._jumps += nanoseconds < self._nanoseconds or self._nanoseconds == 0
            self._nanoseconds = nanoseconds
            self._changed.notify_all()

    def wait(self, woken: threading.Event, until: float, jumps: int) -> bool:
        """Wait until the time is `until`, as the wall clock's."""
        with self._changed:
            self._changed.wait_for(lambda: woken.is_set() or self._jumps != jumps or self.monotonic() >= until - 1e-9)
            return woken.is_set() or self._jumps != jumps

    def wake(self) -> None:
        """Let whoever waits look at its event."""
        with self._changed:
            self._changed.notify_all()
