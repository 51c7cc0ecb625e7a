"""The smoother beside its model, nav2's velocity smoother: the same commands, step by step, where they mean the same.

The model is written here from what nav2 documents and does: each axis changes by at most its acceleration where it
gains speed in its direction, and by its deceleration elsewhere; with scale_velocities all changes are scaled by that of
the axis that is cut most. Deliberately different, and so left out here: limits of velocity under scale_velocities,
where nav2 cuts each axis by itself; a reversal, which nav2 makes within one step; the deadband, at which nav2's ramp
begins anew; jerk (docs/driving.md).
"""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo_messages import Twist, Vector3
from robo_services.smoothing import STANDING, AxisLimits, Limits, step

RATE = 20.0
Velocities = tuple[float, float, float]

ACCELERATION: Velocities = (2.5, 1.0, 3.2)
DECELERATION: Velocities = (1.5, 2.0, 3.2)
HIGHEST: Velocities = (0.5, 0.3, 2.5)

# As a joystick gave them: full ahead, a curve, let go, ahead again, slower, let go.
RECORDED: list[Velocities] = [
    *20 * [(0.5, 0.0, 0.0)], *20 * [(0.4, 0.0, 1.2)], *6 * [(0.4, 0.0, 0.3)], *12 * [(0.0, 0.0, 0.0)],
    *9 * [(0.5, 0.2, 2.0)], *7 * [(0.1, 0.2, 2.5)], *5 * [(0.1, 0.0, 0.4)], *15 * [(0.0, 0.0, 0.0)],
]  # fmt: skip


def limits(*, scaled: bool) -> Limits:
    x, y, z = (
        AxisLimits(max_velocity=v, min_velocity=-v, max_acceleration=a, max_deceleration=d)
        for v, a, d in zip(HIGHEST, ACCELERATION, DECELERATION, strict=True)
    )
    return Limits(linear=x, lateral=y, angular=z, scale_velocities=scaled)


def model(now: Velocities, command: Velocities, *, scaled: bool) -> Velocities:
    """One step of nav2's smoother, open loop."""
    wanted = [max(-most, min(most, v)) for v, most in zip(command, HIGHEST, strict=True)]
    steps = [
        (a if abs(target) >= abs(v) and v * target >= 0.0 else d) / RATE
        for v, target, a, d in zip(now, wanted, ACCELERATION, DECELERATION, strict=True)
    ]
    factor = 1.0
    if scaled:
        for v, target, most in zip(now, wanted, steps, strict=True):
            change = target - v
            own = most / abs(change) if abs(change) > most else -1.0
            if own > 0.0 and abs(1.0 - own) > abs(1.0 - factor):
                factor = own
    x, y, z = (
        v + max(-most, min(most, factor * (target - v))) for v, target, most in zip(now, wanted, steps, strict=True)
    )
    return x, y, z


def compare(commands: list[Velocities], *, scaled: bool) -> None:
    ours, theirs = STANDING, (0.0, 0.0, 0.0)
    for x, y, z in commands:
        theirs = model(theirs, (x, y, z), scaled=scaled)
        ours = step(ours, Twist(Vector3(x, y), Vector3(z=z)), limits(scaled=scaled), 1.0 / RATE)
        velocities = ours.linear.velocity, ours.lateral.velocity, ours.angular.velocity
        assert velocities == pytest.approx(theirs, abs=1e-9)


@pytest.mark.parametrize("scaled", [False, True])
def test_a_recorded_drive_is_smoothed_as_by_nav2(scaled: bool) -> None:
    compare(RECORDED, scaled=scaled)


directions = st.tuples(*3 * [st.sampled_from([-1.0, 1.0])])
shares = st.lists(st.tuples(*3 * [st.floats(0.0, 1.0)]), max_size=60)


@given(directions, shares, st.booleans())
def test_so_is_every_drive_without_a_reversal(signs: Velocities, driven: list[Velocities], scaled: bool) -> None:
    compare(
        [(a * HIGHEST[0] * u, b * HIGHEST[1] * v, c * HIGHEST[2] * w) for a, b, c in [signs] for u, v, w in driven],
        scaled=scaled,
    )


@given(st.lists(st.tuples(*3 * [st.floats(-3.0, 3.0)]), max_size=60))
def test_a_reversal_is_the_same_but_for_the_step_through_zero(driven: list[Velocities]) -> None:
    """Both come to the same command; ours gains speed behind zero by its acceleration."""
    ours, theirs = STANDING, (0.0, 0.0, 0.0)
    last = driven[-1] if driven else (0.0, 0.0, 0.0)
    for x, y, z in [*driven, *200 * [last]]:
        theirs = model(theirs, (x, y, z), scaled=False)
        ours = step(ours, Twist(Vector3(x, y), Vector3(z=z)), limits(scaled=False), 1.0 / RATE)
    assert math.isclose(ours.linear.velocity, theirs[0], abs_tol=1e-9)
    assert math.isclose(ours.angular.velocity, theirs[2], abs_tol=1e-9)
