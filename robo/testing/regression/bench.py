"""Nodes in lock step under the clock of a recording."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from robo.bag.regression.report import Trouble
from robo.testing.bench import Bench
from robo.testing.clock import Clock
from robo.text.brief import brief

if TYPE_CHECKING:
    import threading
    from collections.abc import Callable

    import zenoh

    from robo.testing.stepper import Stepper

MOST_TROUBLES = 20
"""That are told."""


class SimulatedTime(Clock):
    """The clock of nodes that follow `/clock`: stamps of messages and their ages go by the wall clock, as in life."""

    def __init__(self, stepper: Stepper, settle: Callable[[int], None], begin: int, wall: int) -> None:
        """
        Args:
            stepper, settle: as for a test.
            begin: the first time that `/clock` says, ns.
            wall: the time of the first message, ns since the epoch.
        """
        super().__init__(stepper, settle, begin)
        self.wall_ns = wall
        """The wall clock, which whoever feeds sets."""
        self.time_ns = lambda: self.wall_ns
        self.arrival_ns = lambda: self.wall_ns - wall

    def monotonic(self) -> float:
        """What `/clock` has said last, s."""
        return (self._begin + self._stepper.now) * 1e-9

    def wait(self, woken: threading.Event, until: float, jumps: int) -> bool:
        """Wait until `/clock` has said a time; as near as a float tells times of today."""
        slack = 1e-9 + 2 * math.ulp(until) if math.isfinite(until) else 0.0
        return super().wait(woken, until - self._begin * 1e-9 - slack, jumps)


class ReplayBench(Bench):
    """A bench that notes what nodes raise in the place of raising it."""

    def __init__(self, session: zenoh.Session, patience: float, begin: int) -> None:
        """
        Args:
            session: the network of all nodes.
            patience: how long a callback may take, s of the wall clock.
            begin: when time begins, ns since the epoch.
        """
        super().__init__(session, patience)
        self.begin = begin
        self.clock = Clock(self.stepper, self.settle, begin)
        self.troubles: list[Trouble] = []

    def follow_clock(self, begin: int, wall: int) -> SimulatedTime:
        """Let the time be what `/clock` says."""
        self.stepper.in_jumps = True
        self.clock = clock = SimulatedTime(self.stepper, self.settle, begin, wall)
        return clock

    @property
    def now(self) -> int:
        """The clock of stamps that messages leave with, ns since the epoch."""
        return self.clock.time_ns()

    def complain(self) -> None:
        """Note what callbacks have raised."""
        for seat in self.seats:
            for error in seat.errors:
                self.note(seat.node.full_name, f"raised {type(error).__name__}: {error}")
            seat.errors.clear()
            if seat.ended and not seat.end_known:
                seat.end_known = True
                if seat.node.exit_code:
                    self.note(seat.node.full_name, f"ended with exit code {seat.node.exit_code}")

    def note(self, node: str, text: str) -> None:
        """Note a trouble of a node."""
        if len(self.troubles) < MOST_TROUBLES:
            self.troubles.append(Trouble(node, self.now, brief(text, 2_000)))
