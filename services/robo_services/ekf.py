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

The covariance is kept in factors (`factors`): symmetric and positive by construction. What a gyro's bias errs by does
not average out as noise does: it is the same in all readings. So beside the covariance of all that is noise an estimate
says how far one standard deviation of that error has moved it (`drift`), as Schmidt's consider covariance does (Bierman
1977, ch. VIII). Gains go by the noise alone.
"""

import math
from collections.abc import Sequence
from operator import add, mul
from typing import NamedTuple

from robo_services.factors import Changes, Factors, Matrix, NotPositive
from robo_services.planar import normalize_angle

QUANTITIES = ("x", "y", "yaw", "vx", "vy", "vyaw", "ax", "ay")
X, Y, YAW, VX, VY, VYAW, AX, AY = range(8)
POSE, TWIST, ACCELERATION = (X, Y, YAW), (VX, VY, VYAW), (AX, AY)

MEMORY = 0.3
"""An acceleration that nobody measures again is down to 1/e after this time, s."""
LEAST_VARIANCE = 1e-9
"""No measurement is surer."""
LOST = 1e3
"""Nobody is less sure than that of how far a base has driven meanwhile, m: then it may be anywhere."""
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
    """Of the covariance of their errors, as far as those are noise."""
    drift: tuple[float, ...] = ()
    """By how much more one standard deviation of what sensors err by all the time makes each err; empty for nothing."""

    def variance(self, index: int) -> float:
        """Of one quantity, in its unit squared."""
        return self.factors.variance(index) + (self.drift[index] ** 2 if self.drift else 0.0)

    def covariance(self) -> list[list[float]]:
        """Of all errors, row by row."""
        noise = self.factors.matrix()
        if not self.drift:
            return noise
        return [
            [a + one * b for a, b in zip(row, self.drift, strict=True)]
            for row, one in zip(noise, self.drift, strict=True)
        ]


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
    drift: float = 0.0
    """The standard deviation of an error that stays the same from one to the next, as of a gyro's bias; in its unit."""
    assumed: bool = False
    """Nobody has measured it: it is how the base is built."""


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
    fades = math.exp(-dt / MEMORY)
    gains = MEMORY * (1.0 - fades)  # the integral of what is left of an acceleration
    reaches = MEMORY * (dt - gains)  # and the integral of that
    ahead, aside = vx * dt + ax * reaches, vy * dt + ay * reaches
    shrink = math.sin(half) / half if abs(half) > SMALL else 1.0 - half * half / 6
    bend = (half * math.cos(half) - math.sin(half)) / (half * half) if abs(half) > SMALL else -half / 3
    cos, sin = math.cos(yaw + half), math.sin(yaw + half)
    along, across = ahead * cos - aside * sin, ahead * sin + aside * cos
    way_x, way_y = shrink * along, shrink * across
    moved = [
        *(mean[X] + way_x, mean[Y] + way_y, normalize_angle(yaw + turning * dt)),
        *(vx + ax * gains, vy + ay * gains, turning),
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
        share, late = reaches / dt, gains / (1.0 + fades)
        errors[AX], errors[AY] = (*(0.0,) * VX, late, 0.0, 0.0, 1.0), (*(0.0,) * VY, late, 0.0, 0.0, 1.0)
        row_x += [(AX, cos * share), (AY, -sin * share)]
        row_y += [(AX, sin * share), (AY, cos * share)]
        changes += [(VX, [(AX, gains)]), (VY, [(AY, gains)]), (AX, [(AX, fades - 1.0)]), (AY, [(AY, fades - 1.0)])]
    n, lasting = len(mean), MEMORY / 2 * (1.0 - fades * fades)
    added = [
        (_padded(errors.get(i) or (*(0.0,) * i, 1.0), n), noise[i] * (dt if i < AX else lasting))
        for i in range(n)
        if noise[i] > 0.0
    ]
    drift = _moved(now.drift, changes) if now.drift else ()
    return Estimate(now.time + dt, tuple(moved), now.factors.moved(changes, added), drift)


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
    _check_numbers(measured)
    if not kept:
        return now, 0.0
    n = len(now.mean)
    errors = _errors_of([[measured.covariance[a][b] for b in kept] for a in kept])
    rows = []
    for k in kept:
        value, row = _expected(now.mean, measured.indices[k])
        gap = measured.values[k] - value
        row.append(math.remainder(gap, math.tau) if measured.indices[k] == YAW else gap)
        if now.drift or measured.drift:
            row.append(measured.drift - sum(map(mul, row, now.drift)))
        rows.append(row)
    factors = now.factors
    change, drift = [0.0] * n, list(now.drift) or [0.0] * n
    change_of_drift = [0.0] * n
    squares = along = common = 0.0
    for row, variance in zip(errors.correlate(rows), errors.d, strict=True):
        h, gap = row[:n], row[n]
        left = gap - sum(map(mul, h, change))
        factors, gain, total = factors.measured(h, variance)
        squares += left * left / total
        change = [old + k * left for old, k in zip(change, gain, strict=True)]
        if len(row) > n + 1:
            shift = row[n + 1] - sum(map(mul, h, change_of_drift))
            along, common = along + left * shift / total, common + shift * shift / total
            change_of_drift = [old + k * shift for old, k in zip(change_of_drift, gain, strict=True)]
    # Of a gap in which a common error has its share (Sherman, Morrison 1950).
    distance = math.sqrt(max(0.0, squares - along * along / (1.0 + common)))
    if distance > measured.threshold:
        return now, distance
    mean = [old + new for old, new in zip(now.mean, change, strict=True)]
    if not all(map(math.isfinite, mean)):
        raise Unusable("it leads to what is not finite")
    mean[YAW] = normalize_angle(mean[YAW])
    moved = tuple(map(add, drift, change_of_drift)) if now.drift or measured.drift else ()
    return Estimate(now.time, tuple(mean), factors, moved), distance


def check(measured: Measurement) -> None:
    """Refuse what no base does, and what says nothing.

    Raises:
        Unusable: says what is wrong.
    """
    _check_numbers(measured)
    _errors_of([list(row) for row in measured.covariance])


def _check_numbers(measured: Measurement) -> None:
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
    way, turn = min(math.hypot(mean[VX], mean[VY]) * dt, LOST), min(abs(mean[VYAW]) * dt, math.pi)
    found = [[*row] for row in now.factors.matrix()]
    n = len(mean)
    for i in range(VX, n):
        for j in range(n):
            found[i][j] = found[j][i] = 0.0
        found[i][i] = unsure[i - VX]
    for index, error in ((X, way), (Y, way), (YAW, turn)):
        found[index][index] += error * error + found[index][index] * JITTER + LEAST_VARIANCE * JITTER
    still = (*mean[:VX], *(0.0,) * (n - VX))
    drift = (*now.drift[:VX], *(0.0,) * (n - VX)) if now.drift else ()
    return Estimate(now.time + dt, still, Factors.of(found), drift)


def _moved(drift: tuple[float, ...], changes: Changes) -> tuple[float, ...]:
    """By how much a constant error makes each quantity err after a step; of the heading no more than all round."""
    moved = list(drift)
    for i, added in changes:
        moved[i] += sum(share * drift[k] for k, share in added)
    moved[YAW] = max(-math.pi, min(math.pi, moved[YAW]))
    return tuple(moved)


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
    if len(covariance) == 1:
        return Factors([[1.0]], covariance[0])
    try:
        return Factors.of(covariance)
    except NotPositive:
        raise Unusable("its covariance is none: the errors are more alike than they can be") from None


def _padded(values: Sequence[float], n: int) -> tuple[float, ...]:
    return (*values, *(0.0,) * (n - len(values)))
