"""When the timers of a node that was recorded alive ticked: from the times of what they have said. Pure."""

import math
from collections.abc import Sequence
from statistics import median

LEAST = 3
"""So many messages tell a phase."""


def phase(times: Sequence[int], period: float) -> tuple[int, int] | None:
    """By how much ticks come after multiples of their period, and how far they scatter, ns.

    Args:
        times: when messages were published, ns.
        period: of the timer, s.

    Returns:
        Phase and scatter; None where there are too few, or they scatter over all of the period: then they come
        from another clock, or the timer's period was another one.
    """
    whole = round(period * 1e9)
    if len(times) < LEAST or whole <= 0:
        return None
    angles = [time % whole / whole * math.tau for time in times]
    mean = math.atan2(math.fsum(map(math.sin, angles)), math.fsum(map(math.cos, angles))) / math.tau * whole
    off = [(time - round(mean) + whole // 2) % whole - whole // 2 for time in times]
    middle = round(median(off))
    scatter = round(median(abs(one - middle) for one in off))
    if scatter > whole // 5:  # what is even scatters by a quarter
        return None
    return (round(mean) + middle) % whole, scatter


def start_before(begin: int, phase_: int, period: float) -> int:
    """The last time up to `begin` at which a node starts whose timer then ticks in that phase, ns."""
    whole = round(period * 1e9)
    return begin - (begin - phase_) % whole
