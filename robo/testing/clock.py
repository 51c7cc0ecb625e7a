"""The time of a test: it stands still, and goes on when the test says so."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable

from robo.node import clock
from robo.testing.stage import Stage
from robo.testing.stepper import Barrier, Stepper
from robo_messages import Time

BEGIN = 1_000_000_000_000_000_000
"""What stamps begin with, ns since the Unix epoch: 2001-09-09, 01:46:40 UTC."""

LONGEST = 1e9
"""The most that a test can let pass at once, s."""


class Clock(clock.Clock):
    """What `clock` gives a test. Nodes' stamps, timers, `sleep` and the age of messages go by it."""

    def __init__(self, stepper: Stepper, settle: Callable[[int], None], begin: int = BEGIN) -> None:
        """
        Args:
            stepper: where nodes wait.
            settle: runs what is due until a time, ns.
            begin: what stamps begin with, ns since the epoch.
        """
        self._stepper = stepper
        self._settle = settle
        self._begin = begin
        self.time_ns = lambda: begin + stepper.now
        self.arrival_ns = lambda: stepper.now
        self.barrier = lambda: Barrier(stepper)
        self.stage = Stage(stepper)

    @property
    def patience(self) -> float:
        """How long a callback may take before the test fails, s of the wall clock."""
        return self._stepper.patience

    @patience.setter
    def patience(self, seconds: float) -> None:
        self._stepper.patience = seconds

    def advance(self, seconds: float) -> None:
        """Let time pass: what is due runs, each at its own time and in order, until all callbacks are done.

        Args:
            seconds: how much.

        Raises:
            ValueError: the time would step back, or that is more than a test can let pass.
            Hung: a callback does not come back.
            Exception: what a callback raised.
        """
        if not 0 <= seconds <= LONGEST:  # NaN is neither
            raise ValueError(f"advance({seconds!r}): time goes on by 0 to {LONGEST:g} s")
        self._settle(self._stepper.now + round(seconds * 1e9))

    def now(self) -> Time:
        """The time for stamps; it begins in 2001, unless it is that of a recording."""
        return Time.from_nanoseconds(self._begin + self._stepper.now)

    def monotonic(self) -> float:
        """How much time has passed in this test, s."""
        return self._stepper.now * 1e-9

    def expect(self, thread: threading.Thread, *, strict: bool = True) -> None:
        """Take note of a thread that is about to start."""
        self._stepper.expect(thread, strict=strict)

    def wait(self, woken: threading.Event, until: float, jumps: int) -> bool:
        """Wait until the test has let enough time pass."""
        del jumps  # it never does
        return self._stepper.sleep(min(round(until * 1e9), _NEVER) if until < math.inf else _NEVER, woken)

    def wake(self) -> None:
        """Let whoever waits look at its event."""
        self._stepper.look()


_NEVER = round(LONGEST * 1e9) * 1000
