"""An extended Kalman filter of a base in the plane: where it is, how it moves, and how sure that is.

    now = begin((1e-6, 1e-6, 1e-6, 1.0, 1.0, 1.0))
    now = predict(now, 0.02, NOISE)                                     # s
    now, distance = correct(now, Measurement(0.02, "wheels", (VX, VYAW), (0.5, 0.1), ((1e-4, 0.0), (0.0, 1e-4))))

Pure: no network, no clock; an estimate never changes, a step makes another one. The quantities are those of
robot_localization in two dimensions, in this order: x, y, yaw in the world; the velocities vx, vy, vyaw in the base;
and, where somebody measures them, the accelerations ax, ay in the base.

Motion (`predict`): between two measurements the base drives an arc, with the velocities constant as it sees them,
forward and sideways alike: exact for what wheels do (CTRV; Schubert, Richter, Wanielik 2008). Accelerations die away
with `MEMORY`: what was measured a while ago says nothing of now. Errors of velocities come in the middle of a step, so
that a velocity that is measured again corrects the way between the two as the trapezoid rule would.

Measurements (`correct`): each quantity by itself, but for accelerations. What an IMU feels on a base that turns is not
how its velocity grows but also that it goes round: ax - vyaw vy ahead, ay + vyaw vx to the left. Errors that belong
together, as those of a pose, are taken as such.

The covariance is kept in factors (`factors`): symmetric and positive by construction.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

from robo_services.factors import Factors, Matrix, NotPositive
from robo_services.planar import angle_difference, normalize_angle

QUANTITIES = ("x", "y", "yaw", "vx", "vy", "vyaw", "ax", "ay")
X, Y, YAW, VX, VY, VYAW, AX, AY = range(8)
POSE, TWIST, ACCELERATION = (X, Y, YAW), (VX, VY, VYAW), (AX, AY)

MEMORY = 0.3
"""An acceleration that nobody measures again is down to 1/e after this time, s."""
LEAST_VARIANCE = 1e-9
"""No measurement is surer."""
FURTHEST = 1e7
"""No base is further away, m, moves faster, m/s, or accelerates more, m/s²."""
JITTER = 1e-9
"""By so much more, in proportion, a covariance is made larger before it is factored anew: its rounding does no harm."""
SMALL = 1e-4
"""rad; below it the sine of an angle is a polynomial."""


class Estimate(NamedTuple):
    """What is known at a time."""

    time: float
    """s."""
    mean: tuple[float, ...]
    """The most likely values: six or, with accelerations, eight; m, rad, m/s, rad/s, m/s²."""
    factors: Factors
    """Of their covariance."""

    def variance(self, index: int) -> float:
        """Of one quantity, in its unit squared."""
        return self.factors.variance(index)


class Measurement(NamedTuple):
    """Some of the quantities, measured at a time."""

    time: float
    """s."""
    source: str
    """By whom."""
    indices: tuple[int, ...]
    """Which quantities; those that an estimate does not have are left out."""
    values: tuple[float, ...]
    """m, rad, m/s, rad/s, m/s²."""
    covariance: Matrix
    """Of their errors."""
    threshold: float = math.inf
    """One further away than so many standard deviations is not believed (Mahalanobis)."""


class Unusable(ValueError):
    """A measurement says nothing: it is not finite, absurd, or its covariance is none."""


def begin(variances: Sequence[float], *, time: float = 0.0) -> Estimate:
    """At the origin, standing.

    Args:
        variances: how sure that is, of six quantities or of eight.
        time: s.
    """
    return Estimate(time, (0.0,) * len(variances), Factors.diagonal(variances))


def predict(now: Estimate, dt: float, noise: Sequence[float]) -> Estimate:
    """What is known a while later, where nothing was measured.

    Args:
        now: what is known now.
        dt: s; the estimate stays as it is where it is not more than 0.
        noise: what is added to the variance of each quantity in a second.
    """
    if not dt > 0.0:
        return now
    mean = now.mean
    yaw, vx, vy, turning = mean[YAW : VYAW + 1]
    ax, ay = mean[AX:] or (0.0, 0.0)
    half = turning * dt / 2
    ahead, aside = vx * dt + ax * dt * dt / 2, vy * dt + ay * dt * dt / 2
    shrink = math.sin(half) / half if abs(half) > SMALL else 1.0 - half * half / 6
    bend = (half * math.cos(half) - math.sin(half)) / (half * half) if abs(half) > SMALL else -half / 3
    cos, sin = math.cos(yaw + half), math.sin(yaw + half)
    along, across = ahead * cos - aside * sin, ahead * sin + aside * cos
    way_x, way_y = shrink * along, shrink * across
    fades = math.exp(-dt / MEMORY)
    moved = [
        *(mean[X] + way_x, mean[Y] + way_y, normalize_angle(yaw + turning * dt)),
        *(vx + ax * dt, vy + ay * dt, turning),
        *(one * fades for one in mean[AX:]),
    ]
    cos, sin = shrink * cos * dt, shrink * sin * dt
    turned_x, turned_y = (bend * along - way_y) * dt / 2, (bend * across + way_x) * dt / 2
    row_x = [(YAW, -way_y), (VX, cos), (VY, -sin), (VYAW, turned_x)]
    row_y = [(YAW, way_x), (VX, sin), (VY, cos), (VYAW, turned_y)]
    changes = [(X, row_x), (Y, row_y), (YAW, [(VYAW, dt)])]
    # Errors of a velocity that come in the middle of the step move the pose for half of it.
    errors = {VX: (cos / 2, sin / 2, 0.0, 1.0), VY: (-sin / 2, cos / 2, 0.0, 0.0, 1.0)}
    errors[VYAW] = (turned_x / 2, turned_y / 2, dt / 2, 0.0, 0.0, 1.0)
    if len(mean) > AX:
        row_x += [(AX, cos * dt / 2), (AY, -sin * dt / 2)]
        row_y += [(AX, sin * dt / 2), (AY, cos * dt / 2)]
        changes += [(VX, [(AX, dt)]), (VY, [(AY, dt)]), (AX, [(AX, fades - 1.0)]), (AY, [(AY, fades - 1.0)])]
    n = len(mean)
    added = [(_padded(errors.get(i) or (*(0.0,) * i, 1.0), n), noise[i] * dt) for i in range(n) if noise[i] > 0.0]
    return Estimate(now.time + dt, tuple(moved), now.factors.moved(changes, added))


def correct(now: Estimate, measured: Measurement) -> tuple[Estimate, float]:
    """What is known with a measurement of now.

    Numbers are taken one after the other, made independent of each other first; all of them are compared with what was
    expected before any was taken.

    Args:
        now: what is known at the measurement's time.
        measured: what was measured then.

    Returns:
        The estimate, as it was where the measurement is further away than its threshold, and how many standard
        deviations it is away.

    Raises:
        Unusable: the measurement says nothing.
    """
    kept = [k for k, index in enumerate(measured.indices) if index < len(now.mean)]
    check(measured)
    if not kept:
        return now, 0.0
    errors = _errors_of([[measured.covariance[a][b] for b in kept] for a in kept])
    expected = [_expected(now.mean, measured.indices[k]) for k in kept]
    gaps = [
        angle_difference(measured.values[k], value) if measured.indices[k] == YAW else measured.values[k] - value
        for k, (value, _) in zip(kept, expected, strict=True)
    ]
    rows = errors.correlate([[*row, gap] for (_, row), gap in zip(expected, gaps, strict=True)])
    factors, change = now.factors, [0.0] * len(now.mean)
    squares = 0.0
    for row, variance in zip(rows, errors.d, strict=True):
        h, gap = row[:-1], row[-1]
        left = gap - sum(a * b for a, b in zip(h, change, strict=True))
        factors, gain, total = factors.measured(h, variance)
        squares += left * left / total
        change = [old + k * left for old, k in zip(change, gain, strict=True)]
    distance = math.sqrt(squares)
    if distance > measured.threshold:
        return now, distance
    mean = [old + new for old, new in zip(now.mean, change, strict=True)]
    if not all(map(math.isfinite, mean)):
        raise Unusable("it leads to what is not finite")
    mean[YAW] = normalize_angle(mean[YAW])
    return Estimate(now.time, tuple(mean), factors), distance


def check(measured: Measurement) -> None:
    """Refuse what no base does.

    Raises:
        Unusable: says what is wrong.
    """
    if not math.isfinite(measured.time):
        raise Unusable("its time is not finite")
    for index, value in zip(measured.indices, measured.values, strict=True):
        if not abs(value) <= FURTHEST:
            raise Unusable(f"{QUANTITIES[index]} = {value:g}")
    for index, row in zip(measured.indices, measured.covariance, strict=True):
        if not all(map(math.isfinite, row)):
            raise Unusable(f"the covariance of {QUANTITIES[index]} is not finite")


def after_gap(now: Estimate, dt: float, unsure: Sequence[float]) -> Estimate:
    """What is known after a time in which nobody said anything of the motion: nothing but about how far it may be.

    It stands where it was; it may have gone on as it did, to anywhere.

    Args:
        now: what was known last.
        dt: how long ago, s.
        unsure: the variances of the velocities and accelerations now.
    """
    mean = now.mean
    way, turn = math.hypot(mean[VX], mean[VY]) * dt, min(abs(mean[VYAW]) * dt, math.pi)
    found = [[*row] for row in now.factors.matrix()]
    n = len(mean)
    for i in range(VX, n):
        for j in range(n):
            found[i][j] = found[j][i] = 0.0
        found[i][i] = unsure[i - VX]
    for index, error in ((X, way), (Y, way), (YAW, turn)):
        found[index][index] += error * error + found[index][index] * JITTER + LEAST_VARIANCE * JITTER
    still = (*mean[:VX], *(0.0,) * (n - VX))
    return Estimate(now.time + dt, still, Factors.of(found))


def _expected(mean: Sequence[float], index: int) -> tuple[float, list[float]]:
    """What a sensor of a quantity says, and how that depends on all of them."""
    row = [0.0] * len(mean)
    row[index] = 1.0
    if index == AX:
        row[VY], row[VYAW] = -mean[VYAW], -mean[VY]
        return mean[AX] - mean[VYAW] * mean[VY], row
    if index == AY:
        row[VX], row[VYAW] = mean[VYAW], mean[VX]
        return mean[AY] + mean[VYAW] * mean[VX], row
    return mean[index], row


def _errors_of(covariance: list[list[float]]) -> Factors:
    for i, row in enumerate(covariance):
        if row[i] < 0.0:
            raise Unusable("a variance is negative")
        row[i] = max(row[i], LEAST_VARIANCE)
    try:
        return Factors.of(covariance)
    except NotPositive:
        raise Unusable("its covariance is none: the errors are more alike than they can be") from None


def _padded(values: Sequence[float], n: int) -> tuple[float, ...]:
    return (*values, *(0.0,) * (n - len(values)))
