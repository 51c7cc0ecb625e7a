"""How large the wheels of a base really are, and how far apart, from where it ended beside where odometry says.

    runs = [Run(odometry_of_straight, measured), Run(odometry_of_square_to_the_left, measured), …]
    found = calibrate(runs, wheel_separation=0.3)
    print(found.corrections, found.errors, found.left_over)

Wheels that differ in size bend what should be straight, and wheels that are further apart turn the base less than they
say. A square shows both, but mixed up; driven to the left and to the right they add up in one and take away from each
other in the other: that is UMBmark (Borenstein, Feng 1996, "Measurement and correction of systematic odometry errors in
mobile robots"). Its formulas hold for small errors and exact squares. Here what the wheels did is known step by step:
the same ways are driven again in thought, with wheels of other sizes, until they end where the base did (least squares
by Gauss and Newton). Any way will do that turns to both sides; a straight line says how large both wheels are together,
which a way that closes hardly does. How sure all that is follows from how exactly ends were measured, and from what is
left of the gaps: the covariance of least squares.

Pure: no network, no clock.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

from robo_services.kinematics import ORIGIN, Pose2, Twist2, advance
from robo_services.planar import angle_difference

SMALLEST, LARGEST = 0.5, 2.0
"""Of a correction; what is beyond is no error of wheels, but of the figures."""
CLOSE = 1e-7
"""Corrections that change by less are found."""
ROUNDS = 50
HALVINGS = 8
"""How often a step that makes it no better is halved."""
LEAST_SEEN = 0.5
"""What moves the ends of all runs by less, m per 1, is not seen in them: an error of measuring of 5 mm would be 1 %."""
MEASURING_ERROR = 0.005
"""Standard deviation of where a run was measured to end, m: a tape measure and a mark."""
MOST_UNSURE = 0.05
"""A correction with a larger standard deviation is worth nothing."""
YAW_COUNTS = 0.5
"""An error of the heading by 1 rad counts as one of this many m."""
DIFFERENCE = 1e-6

LONGEST_STEP, WIDEST_STEP = 0.1, 0.05
"""So long, m, and so wide, rad, a step of a track may be that takes in several messages."""
BENT = 2e-4
"""Its way times its turn is at most this, m: half of it is what it may lead away from where all of them led."""
JUMP = Twist2(0.5, 1.0)
"""No base drives further, m, or turns more, rad, from one message to the next: its odometry was set."""


class CalibrationError(ValueError):
    """The runs do not say how large the wheels are; says why."""


class Corrections(NamedTuple):
    """By what wheels and their separation are to be multiplied."""

    left: float = 1.0
    right: float = 1.0
    separation: float = 1.0


NONE = Corrections()


class Measured(NamedTuple):
    """Where a base ended, seen from where it began: x ahead of it, y to its left."""

    x: float
    """m."""
    y: float
    """m."""
    yaw: float | None = None
    """rad; None where nobody has measured it."""


class Run(NamedTuple):
    """One way, by odometry and in truth."""

    steps: Sequence[Twist2]
    """What odometry says, step by step: the way, m, and the turn, rad."""
    measured: Measured


class Calibration(NamedTuple):
    """What was found."""

    corrections: Corrections
    errors: Corrections
    """The standard deviation of each."""
    before: float
    """How far the runs ended from where odometry says, m: the root of the mean square."""
    left_over: float
    """The same with the corrections."""


class Track:
    """Odometry as steps, from its poses."""

    def __init__(self) -> None:
        self.way = 0.0
        """How far it has driven forward, m; backward it takes away."""
        self.turned = 0.0
        """By how much it has turned, to the left, rad."""
        self._steps: list[Twist2] = []
        self._newest = Twist2()
        self._last: Pose2 | None = None

    @property
    def steps(self) -> list[Twist2]:
        """All of it, in order; what is nearly one arc is one step."""
        return [*self._steps, self._newest] if self._newest != Twist2() else [*self._steps]

    def add(self, pose: Pose2) -> None:
        """Take the next pose; the base has driven an arc since the last one."""
        last, self._last = self._last, pose
        if last is None:
            return
        step = arc(last, pose)
        self.way += step.linear
        self.turned += step.angular
        both = Twist2(self._newest.linear + step.linear, self._newest.angular + step.angular)
        if (
            abs(both.linear) <= LONGEST_STEP
            and abs(both.angular) <= WIDEST_STEP
            and abs(both.linear * both.angular) <= BENT
        ):
            self._newest = both
        else:
            self._steps.append(self._newest)
            self._newest = step

    def is_jump(self, pose: Pose2) -> bool:
        """Whether no base drives so far at once as from the last pose to this one."""
        if self._last is None:
            return False
        way = math.hypot(pose.x - self._last.x, pose.y - self._last.y)
        turn = abs(angle_difference(pose.yaw, self._last.yaw))
        return way > JUMP.linear or turn > JUMP.angular


def arc(begin: Pose2, end: Pose2) -> Twist2:
    """The way and the turn of the arc that leads from one pose to another; what leads sideways does not count."""
    turn = angle_difference(end.yaw, begin.yaw)
    half = turn / 2
    x, y = end.x - begin.x, end.y - begin.y
    along = math.cos(begin.yaw + half) * x + math.sin(begin.yaw + half) * y
    return Twist2(along * (half / math.sin(half) if half else 1.0), turn)


def seen_from(begin: Pose2, end: Pose2) -> Measured:
    """Where one pose stands, seen from another."""
    x, y = end.x - begin.x, end.y - begin.y
    cos, sin = math.cos(begin.yaw), math.sin(begin.yaw)
    return Measured(cos * x + sin * y, cos * y - sin * x, angle_difference(end.yaw, begin.yaw))


def driven(steps: Sequence[Twist2], separation: float, corrections: Corrections = NONE) -> Pose2:
    """Where steps of odometry lead from the origin, if the wheels were so much larger and so much further apart.

    Args:
        steps: as odometry has them.
        separation: between the wheels, as odometry takes it, m.
        corrections: of its wheels.
    """
    pose, half = ORIGIN, separation / 2
    for way, turn in steps:
        left, right = (way - turn * half) * corrections.left, (way + turn * half) * corrections.right
        pose = advance(pose, (left + right) / 2, (right - left) / (separation * corrections.separation), 1.0)
    return pose


def calibrate(runs: Sequence[Run], wheel_separation: float, measuring_error: float = MEASURING_ERROR) -> Calibration:
    """How large the wheels are, and how far apart, by where the runs ended.

    Args:
        runs: a straight line, and squares to the left and to the right, or any others that say as much.
        wheel_separation: as odometry takes it, with its multiplier, m.
        measuring_error: standard deviation of where a run was measured to end, m.

    Raises:
        CalibrationError: the runs do not say it, or what they say cannot be.
    """
    _refuse_nonsense(runs, wheel_separation)
    before = _gaps(runs, wheel_separation, NONE)
    # Wheels that differ much wind a line up to where it says nothing of how to unwind it: it begins near the truth.
    found = min(_BEGINNINGS, key=lambda one: _size(_gaps(runs, wheel_separation, one), runs))
    gaps = _gaps(runs, wheel_separation, found)
    for _ in range(ROUNDS):
        basis, shares = _factors(_columns(runs, wheel_separation, found, gaps), gaps)
        change = _solved(basis, shares)
        # A longer step leaves the neighbourhood in which the derivative holds.
        scale = min(1.0, 0.2 / max(map(abs, change)) if any(change) else 1.0)
        for _ in range(HALVINGS):
            tried = Corrections(*(one - scale * step for one, step in zip(found, change, strict=True)))
            gaps_there = _gaps(runs, wheel_separation, tried)
            if _size(gaps_there, runs) <= _size(gaps, runs):
                break
            scale /= 2
        else:
            break  # no step makes it better: what is left are errors of measuring
        found, gaps = tried, gaps_there
        if not all(SMALLEST <= one <= LARGEST for one in found):
            raise CalibrationError(
                "no wheels lead from what odometry says to where it was measured: x counts ahead and y to the left, "
                "in m, from where each run began and how the base stood there"
            )
        if max(map(abs, change)) < CLOSE:
            break
    errors = _errors(basis, gaps, measuring_error)
    if max(errors) > MOST_UNSURE:
        raise CalibrationError(
            f"the runs say it to ± {max(errors):.0%} only: so corrected they still end {_size(gaps, runs):.3f} m from "
            "where they were measured; has the base slipped or been moved, or is a figure wrong?"
        )
    return Calibration(found, errors, _size(before, runs), _size(gaps, runs))


def doubt(found: Calibration, runs: Sequence[Run], measuring_error: float = MEASURING_ERROR) -> str:
    """Why what was found had better not be relied on; empty where nothing speaks against it.

    Args:
        found: from these runs.
        runs: all of them.
        measuring_error: as for `calibrate`, m.
    """
    if found.left_over <= 2 * measuring_error:
        return ""
    way = sum(abs(step.linear) for run in runs for step in run.steps) / len(runs)
    if found.left_over > 0.02 * way or found.left_over > 0.5 * found.before:
        return (
            f"so corrected the runs still end {found.left_over:.3f} m from where they were measured, of "
            f"{found.before:.3f} m before: has the base slipped or been moved, or is a figure wrong?"
        )
    return ""


_BEGINNINGS = [
    Corrections(1.0 - differ / 2, 1.0 + differ / 2, apart)
    for differ in (0.0, 0.05, -0.05, 0.1, -0.1, 0.15, -0.15, 0.2, -0.2)
    for apart in (1.0, 0.9, 1.1)
]


def _refuse_nonsense(runs: Sequence[Run], separation: float) -> None:
    if not 1e-3 <= separation <= 100.0:
        raise CalibrationError(f"wheel_separation = {separation:g} m: 0.001 to 100")
    if not runs:
        raise CalibrationError("there are no runs: drive " + NEEDED)
    for number, (steps, measured) in enumerate(runs, start=1):
        values = [measured.x, measured.y, measured.yaw or 0.0, *(one for step in steps for one in step)]
        if not all(map(math.isfinite, values)):
            raise CalibrationError(f"run {number} holds what is not finite")
        if not sum(abs(step.linear) for step in steps) > 0.1:
            raise CalibrationError(f"in run {number} the base has hardly moved")


def _gaps(runs: Sequence[Run], separation: float, corrections: Corrections) -> list[float]:
    """How far each run ends from where it was measured: x and y, m, and the heading where there is one."""
    found: list[float] = []
    for steps, measured in runs:
        there = driven(steps, separation, corrections)
        found += [there.x - measured.x, there.y - measured.y]
        if measured.yaw is not None:
            found.append(YAW_COUNTS * angle_difference(there.yaw, measured.yaw))
    return found


def _size(gaps: Sequence[float], runs: Sequence[Run]) -> float:
    return math.sqrt(sum(gap * gap for gap in gaps) / len(runs))


def _columns(runs: Sequence[Run], separation: float, found: Corrections, gaps: Sequence[float]) -> list[list[float]]:
    """How the gaps change with each correction, m per 1."""
    columns = []
    for k in range(3):
        shifted = Corrections(*(one + DIFFERENCE * (i == k) for i, one in enumerate(found)))
        moved = _gaps(runs, separation, shifted)
        columns.append([(new - old) / DIFFERENCE for new, old in zip(moved, gaps, strict=True)])
    return columns


def _factors(columns: Sequence[Sequence[float]], gaps: Sequence[float]) -> tuple[list[list[float]], list[float]]:
    """The columns as right angles times a triangle, by modified Gram-Schmidt.

    Returns:
        The triangle, its zeros below, and what of the gaps lies along each right angle.

    Raises:
        CalibrationError: something is not seen in the gaps.
    """
    columns, n = [list(column) for column in columns], len(columns)
    rest, basis = list(gaps), [[0.0] * n for _ in range(n)]
    shares = [0.0] * n
    for k in range(n):
        norm = math.sqrt(sum(one * one for one in columns[k]))
        if norm < LEAST_SEEN:
            raise CalibrationError("the runs do not tell the wheels' sizes and their separation apart: drive " + NEEDED)
        unit = [one / norm for one in columns[k]]
        basis[k][k] = norm
        shares[k] = sum(a * b for a, b in zip(unit, rest, strict=True))
        rest = [a - shares[k] * b for a, b in zip(rest, unit, strict=True)]
        for j in range(k + 1, n):
            basis[k][j] = sum(a * b for a, b in zip(unit, columns[j], strict=True))
            columns[j] = [a - basis[k][j] * b for a, b in zip(columns[j], unit, strict=True)]
    return basis, shares


def _solved(basis: Sequence[Sequence[float]], shares: Sequence[float]) -> list[float]:
    """What the triangle makes the shares of."""
    n = len(shares)
    found = [0.0] * n
    for k in reversed(range(n)):
        found[k] = (shares[k] - sum(basis[k][j] * found[j] for j in range(k + 1, n))) / basis[k][k]
    return found


def _errors(basis: Sequence[Sequence[float]], gaps: Sequence[float], measuring_error: float) -> Corrections:
    """Standard deviations, from the triangle R of least squares: the covariance is σ² R⁻¹ R⁻ᵀ."""
    n = len(basis)
    spare = len(gaps) - n
    sigma = max(measuring_error, math.sqrt(sum(gap * gap for gap in gaps) / spare) if spare > 0 else 0.0)
    inverse = [_solved(basis, [float(i == k) for i in range(n)]) for k in range(n)]  # by columns
    return Corrections(*(sigma * math.sqrt(sum(column[k] ** 2 for column in inverse)) for k in range(n)))


NEEDED = "a straight line, and a square to the left and one to the right, each of some metres"
"""What says all."""
