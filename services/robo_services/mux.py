"""Who of several commanders drives: pure decisions, without Zenoh and without a clock.

The one with the highest priority among those that have commanded lately, as in ROS's twist_mux. A lock that is closed
keeps out everybody with a lower priority than its own; one that is not heard is closed.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple


class Input(NamedTuple):
    """A commander. Among those with the same priority the first one counts."""

    priority: int
    timeout: float
    """An older command is none, s."""
    age: float = math.inf
    """How old its last command is, s; infinite before the first one, and where it is not known."""


class Lock(NamedTuple):
    """Something that may keep commanders out."""

    priority: int
    """Those of a lower priority are kept out."""
    timeout: float
    """Not heard for longer it is closed, s; 0 for one that is only closed when it says so."""
    closed: bool = False
    """What it last said."""
    age: float = math.inf
    """How long ago that was, s; infinite where it was never heard."""

    @property
    def is_silent(self) -> bool:
        """Whether it ought to have been heard."""
        return self.timeout > 0 and not self.age <= self.timeout  # so that NaN is silence too

    @property
    def holds(self) -> bool:
        """Whether it keeps others out."""
        return self.closed or self.is_silent


class Choice(NamedTuple):
    """Who drives, and why."""

    driver: str
    """The name of an input; empty for nobody."""
    reason: str
    """A short word: `commands`, `silence`, `locked`."""
    text: str
    """The cause in words."""
    lock: str = ""
    """The lock with the highest priority among those that hold, whoever drives."""


def choose(inputs: Mapping[str, Input], locks: Mapping[str, Lock]) -> Choice:
    """Who drives now."""
    holding = [name for name, lock in locks.items() if lock.holds]
    lock = max(holding, key=lambda name: locks[name].priority, default="")
    barrier = locks[lock].priority if lock else 0
    heard = [name for name, one in inputs.items() if one.age <= one.timeout]
    free = [name for name in heard if inputs[name].priority >= barrier]
    driver = max(free, key=lambda name: inputs[name].priority, default="")
    if driver:
        kept_out = f"; {_why(lock, locks[lock])} and keeps out what is below {barrier}" if lock else ""
        return Choice(driver, "commands", f"{driver} drives, priority {inputs[driver].priority}{kept_out}", lock)
    if heard:
        return Choice("", "locked", f"{_why(lock, locks[lock])}: {', '.join(heard)} must not drive", lock)
    also = f"; {_why(lock, locks[lock])}" if lock else ""
    return Choice("", "silence", f"nobody commands{also}", lock)


def _why(name: str, lock: Lock) -> str:
    if lock.closed:
        return f"lock {name} is closed"
    return f"lock {name} is not heard, so it counts as closed"
