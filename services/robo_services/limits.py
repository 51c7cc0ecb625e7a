"""Limits on velocity and acceleration."""

import math


def clamp(value: float, limit: float) -> float:
    """`value` within [-limit, limit]."""
    return max(-limit, min(limit, value))


def ramp(current: float, target: float, dt: float, acceleration: float, deceleration: float) -> float:
    """The next velocity on the way to `target`.

    Speeding up is limited by `acceleration`, slowing down and reversing by `deceleration`.

    Args:
        current: m/s or rad/s.
        target: likewise.
        dt: s since `current`.
        acceleration: m/s² or rad/s², positive.
        deceleration: likewise.
    """
    speeding_up = abs(target) > abs(current) and current * target >= 0
    step = (acceleration if speeding_up else deceleration) * dt
    change = target - current
    if abs(change) <= step:
        return target
    nxt = current + math.copysign(step, change)
    # A reversal passes through zero: the rest of this step belongs to the next one.
    return 0.0 if nxt * current < 0 else nxt
