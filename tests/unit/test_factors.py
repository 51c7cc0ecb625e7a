"""Covariances in factors: the same numbers as with whole matrices, and positive where those are not."""

import itertools
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo_services.factors import Factors, Matrix, NotPositive

SIZES = st.integers(1, 8)
SEEDS = st.integers(0, 2**32 - 1)
Array = np.ndarray[Any, np.dtype[np.float64]]


def covariance(rng: np.random.Generator, n: int) -> Array:
    root = rng.normal(size=(n, n))
    return root @ root.T + 0.01 * np.eye(n)


def rows(array: Array) -> list[list[float]]:
    return [[float(one) for one in row] for row in array]


def changes(jacobian: Array) -> list[tuple[int, list[tuple[int, float]]]]:
    n = len(jacobian)
    return [(i, [(k, float(jacobian[i, k]) - (i == k)) for k in range(n)]) for i in range(n)]


def is_covariance(matrix: Matrix) -> bool:
    """Finite, symmetric, positive on its diagonal, and nothing more alike than it can be."""
    n = len(matrix)
    pairs = list(itertools.product(range(n), repeat=2))
    return (
        all(math.isfinite(matrix[i][j]) and matrix[i][j] == matrix[j][i] for i, j in pairs)
        and all(matrix[i][i] > 0.0 for i in range(n))
        and all(abs(matrix[i][j]) <= math.sqrt(matrix[i][i] * matrix[j][j]) * (1 + 1e-9) for i, j in pairs)
    )


@given(SIZES, SEEDS)
def test_factors_are_those_of_the_matrix(n: int, seed: int) -> None:
    matrix = covariance(np.random.default_rng(seed), n)
    factors = Factors.of(rows(matrix))
    assert np.array(factors.matrix()) == pytest.approx(matrix, rel=1e-9, abs=1e-9)
    assert [factors.variance(i) for i in range(n)] == pytest.approx(list(np.diag(matrix)))


@given(SIZES, SEEDS)
def test_a_step_is_that_of_whole_matrices(n: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    matrix, jacobian = covariance(rng, n), np.eye(n) + 0.3 * rng.normal(size=(n, n))
    errors, variances = rng.normal(size=(n, 3)), rng.uniform(0, 1, 3)
    noise = [([float(one) for one in errors[:, k]], float(variances[k])) for k in range(3)]
    moved = Factors.of(rows(matrix)).moved(changes(jacobian), noise)
    expected = jacobian @ matrix @ jacobian.T + errors @ np.diag(variances) @ errors.T
    assert np.array(moved.matrix()) == pytest.approx(expected, rel=1e-8, abs=1e-8)


@given(SIZES, SEEDS, st.floats(1e-3, 1e3))
def test_a_measurement_is_that_of_whole_matrices(n: int, seed: int, variance: float) -> None:
    rng = np.random.default_rng(seed)
    matrix, h = covariance(rng, n), rng.normal(size=n) * (rng.uniform(size=n) < 0.7)
    factors, gain, total = Factors.of(rows(matrix)).measured([float(one) for one in h], variance)
    along = matrix @ h
    assert total == pytest.approx(h @ along + variance)
    assert gain == pytest.approx(list(along / total))
    expected = matrix - np.outer(along, along) / total
    assert np.array(factors.matrix()) == pytest.approx(expected, rel=1e-8, abs=1e-8)


@given(SEEDS)
def test_errors_that_belong_together_become_independent(seed: int) -> None:
    rng = np.random.default_rng(seed)
    matrix, h = covariance(rng, 3), rng.normal(size=(3, 5))
    factors = Factors.of(rows(matrix))
    apart: Array = np.array(factors.correlate(rows(h)))
    information = apart.T @ np.diag(1 / np.array(factors.d)) @ apart
    assert information == pytest.approx(h.T @ np.linalg.inv(matrix) @ h, rel=1e-6, abs=1e-6)


@given(st.lists(st.tuples(st.integers(0, 3), st.floats(-9, 9), st.booleans()), min_size=1, max_size=60))
def test_it_stays_a_covariance_whatever_is_measured(steps: list[tuple[int, float, bool]]) -> None:
    """With errors from 1e-9 to 1e9 in turns, where whole matrices lose their last digits and then their sign."""
    factors = Factors.diagonal([1e9, 1e-9, 1.0, 1e6])
    for index, exponent, moves in steps:
        h = [0.5 if i < index else float(i == index) for i in range(4)]
        factors, gain, total = factors.measured(h, 10.0**exponent)
        assert total > 0.0
        assert all(map(math.isfinite, gain))
        if moves:
            factors = factors.moved([(0, [(3, 0.7)]), (2, [(0, -0.2)])], [([0.0, 0.1, 1.0, 0.0], 10.0**-exponent)])
        assert is_covariance(factors.matrix())


@pytest.mark.parametrize(
    "matrix", [[[0.0]], [[-1.0]], [[math.nan]], [[1.0, 2.0], [2.0, 1.0]], [[1.0, math.nan], [math.nan, 1.0]]]
)
def test_what_is_no_covariance_is_refused(matrix: list[list[float]]) -> None:
    with pytest.raises(NotPositive):
        Factors.of(matrix)
