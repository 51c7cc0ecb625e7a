"""What a base's wheels and their separation truly are, by drives whose ends were measured.

A drive is what odometry took it for, step by step, and where the base truly came to stand. Sought are the radii of both
wheels and their separation with which odometry would have ended there: the least squares of what is missing (Gauss and
Newton, damped as Levenberg 1944 has it). A straight line says how large the wheels are and which one is the larger; a
square each way round how far they are apart (Borenstein, Feng 1996, "Measurement and correction of systematic odometry
errors in mobile robots", who show why one way round is not enough). What no drive tells stays as it was. Pure.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

from robo_services.kinematics import ORIGIN, Pose2, advance
from robo_services.planar import normalize_angle

TAPE = 0.01
"""How well people measure, m."""
DOUBT = 0.1
"""How far from 1 a correction is expected to be, before anything was measured."""
FARTHEST = 0.5
"""A correction is within 1 ± this: what is further off is a wrong parameter, not an error of some per cent."""
ROUNDS = 60
_NUDGE = 1e-6


class Step(NamedTuple):
    """An arc, as odometry had it."""

    distance: float
    """m."""
    turn: float
    """rad."""


class Drive(NamedTuple):
    """From a mark on the floor to where the base came to stand."""

    steps: Sequence[Step]
    x: float
    """Where it truly ended: ahead of the mark, m."""
    y: float
    """To the left of it, m."""


class Correction(NamedTuple):
    """By what the present values are to be multiplied."""

    left_radius: float = 1.0
    right_radius: float = 1.0
    separation: float = 1.0


class Found(NamedTuple):
    """What came of some drives."""

    correction: Correction
    before: float
    """How far odometry's ends were from the measured ones: root mean square, m."""
    after: float
    """How far they are with the correction, m."""


def step_between(before: Pose2, after: Pose2) -> Step:
    """The arc from one of odometry's poses to the next."""
    turn = normalize_angle(after.yaw - before.yaw)
    half = turn / 2
    x, y = after.x - before.x, after.y - before.y
    ahead = x * math.cos(before.yaw + half) + y * math.sin(before.yaw + half)
    return Step(ahead * (half / math.sin(half) if half else 1.0), turn)


def end_of(steps: Sequence[Step], separation: float, correction: Correction = Correction()) -> Pose2:  # noqa: B008
    """Where wheels that are corrected so have led, from the origin.

    Args:
        steps: as they were taken for.
        separation: with which they were, m.
        correction: of the radii and of the separation.
    """
    pose = ORIGIN
    for distance, turn in steps:
        left = (distance - turn * separation / 2) * correction.left_radius
        right = (distance + turn * separation / 2) * correction.right_radius
        pose = advance(pose, (left + right) / 2, (right - left) / (separation * correction.separation), 1.0)
    return pose


def calibrate(drives: Sequence[Drive], separation: float) -> Found:
    """The correction with which drives would have ended where they did.

    Args:
        drives: at least one.
        separation: with which odometry was made, m.
    """
    values, damping = [0.0, 0.0, 0.0], 1e-3
    errors = _errors(drives, separation, values)
    for _ in range(ROUNDS):
        slopes = [
            [
                (after - before) / _NUDGE
                for before, after in zip(errors, _nudged(drives, separation, values, i), strict=True)
            ]
            for i in range(3)
        ]
        square = [[_dot(slopes[i], slopes[j]) for j in range(3)] for i in range(3)]
        downhill = [-_dot(slope, errors) for slope in slopes]
        for i in range(3):
            square[i][i] *= 1.0 + damping
        moved = [_held(value + change) for value, change in zip(values, _solved(square, downhill), strict=True)]
        tried = _errors(drives, separation, moved)
        if _dot(tried, tried) < _dot(errors, errors):
            values, errors, damping = moved, tried, damping / 5
        else:
            damping *= 5
        if damping > 1e9:
            break
    correction = Correction(*(1.0 + value for value in values))
    return Found(correction, _distance(drives, separation, Correction()), _distance(drives, separation, correction))


def _errors(drives: Sequence[Drive], separation: float, values: Sequence[float]) -> list[float]:
    """What is missing, in units of how well it is known; the last three hold corrections that nothing tells at 1."""
    correction = Correction(*(1.0 + value for value in values))
    found = []
    for drive in drives:
        end = end_of(drive.steps, separation, correction)
        found += [(end.x - drive.x) / TAPE, (end.y - drive.y) / TAPE]
    return [*found, *(value / DOUBT for value in values)]


def _nudged(drives: Sequence[Drive], separation: float, values: Sequence[float], which: int) -> list[float]:
    return _errors(drives, separation, [value + _NUDGE * (i == which) for i, value in enumerate(values)])


def _distance(drives: Sequence[Drive], separation: float, correction: Correction) -> float:
    ends = [(end_of(drive.steps, separation, correction), drive) for drive in drives]
    return math.sqrt(sum((end.x - drive.x) ** 2 + (end.y - drive.y) ** 2 for end, drive in ends) / len(drives))


def _held(value: float) -> float:
    return max(-FARTHEST, min(value, FARTHEST))


def _dot(one: Sequence[float], other: Sequence[float]) -> float:
    return sum(a * b for a, b in zip(one, other, strict=True))


def _solved(matrix: list[list[float]], right: Sequence[float]) -> list[float]:
    """The x with A x = b, for a positive definite A (Gauss, without exchange of rows)."""
    rows = [[*row, value] for row, value in zip(matrix, right, strict=True)]
    size = len(rows)
    for i in range(size):
        for j in range(i + 1, size):
            factor = rows[j][i] / rows[i][i]
            rows[j] = [a - factor * b for a, b in zip(rows[j], rows[i], strict=True)]
    found = [0.0] * size
    for i in reversed(range(size)):
        found[i] = (rows[i][size] - _dot(rows[i][i + 1 : size], found[i + 1 :])) / rows[i][i]
    return found
