"""Covariances in factors that keep them symmetric and positive, whatever is rounded: P = U D Uᵀ.

U is upper triangular with ones on its diagonal, D a diagonal of positive numbers. A filter that steps from factors to
factors (Bierman 1977, "Factorization Methods for Discrete Sequential Estimation", ch. V and VI.4) has no covariance
that could become negative by a difference of large numbers; one that multiplies and subtracts whole matrices has.

Matrices are sequences of rows of floats. For eight quantities plain Python is quick enough, and brings no numpy along.
"""

from collections.abc import Sequence
from operator import mul

Row = Sequence[float]
Matrix = Sequence[Row]
Changes = Sequence[tuple[int, Sequence[tuple[int, float]]]]
"""How a matrix differs from the identity, row by row."""

LEAST = 1e-18
"""No element of D is less, so that none becomes 0 by underflow."""


class NotPositive(ValueError):
    """A matrix is no covariance."""


class Factors:
    """A covariance as U and D. It never changes."""

    __slots__ = ("d", "u")

    def __init__(self, u: list[list[float]], d: list[float]) -> None:
        self.u, self.d = u, d

    @classmethod
    def diagonal(cls, variances: Sequence[float]) -> "Factors":
        """Of quantities that are independent of each other."""
        n = len(variances)
        unit = [[1.0 if i == j else 0.0 for j in range(n)] for i in range(n)]
        return cls(unit, [max(variance, LEAST) for variance in variances])

    @classmethod
    def of(cls, matrix: Matrix) -> "Factors":
        """Of a covariance; of its two halves the upper one counts.

        Raises:
            NotPositive: it is none.
        """
        n = len(matrix)
        u = [[1.0 if i == j else 0.0 for j in range(n)] for i in range(n)]
        d = [0.0] * n
        for j in reversed(range(n)):
            for i in reversed(range(j + 1)):
                left = matrix[i][j] - sum(u[i][k] * d[k] * u[j][k] for k in range(j + 1, n))
                if i == j:
                    if not left > 0.0:
                        raise NotPositive(f"the matrix is no covariance: row {j + 1}")
                    d[j] = left
                else:
                    u[i][j] = left / d[j]
        return cls(u, d)

    def matrix(self) -> list[list[float]]:
        """P itself: symmetric to the last digit."""
        n = len(self.d)
        weighted = [list(map(mul, row, self.d)) for row in self.u]
        upper = [[sum(map(mul, weighted[i], self.u[j])) if j >= i else 0.0 for j in range(n)] for i in range(n)]
        return [[upper[min(i, j)][max(i, j)] for j in range(n)] for i in range(n)]

    def variance(self, index: int) -> float:
        """One element of P's diagonal."""
        return sum(u * u * d for u, d in zip(self.u[index], self.d, strict=True))

    def correlate(self, rows: Matrix) -> list[list[float]]:
        """U⁻¹ times these rows: of errors with this covariance it makes independent ones, whose variances are D."""
        found: list[list[float]] = [list(row) for row in rows]
        for i in reversed(range(len(found) - 1)):
            for j in range(i + 1, len(found)):
                share = self.u[i][j]
                if share:
                    found[i] = [a - share * b for a, b in zip(found[i], found[j], strict=True)]
        return found

    def moved(self, changes: Changes, noise: Sequence[tuple[Row, float]] = ()) -> "Factors":
        """What P becomes by a step, J P Jᵀ + Σ g gᵀ q: weighted Gram-Schmidt (Thornton 1976; Bierman 1977, VI.4).

        Args:
            changes: J, in what makes it more than the identity: of rows their number, and what is added to the
                quantity as pairs of another one's number and by how much of it.
            noise: how the quantities move with each error, g, and its variance, q.
        """
        n = len(self.d)
        weights = [*self.d, *(variance for _, variance in noise)]
        moved = list(self.u)
        for i, added in changes:
            row = self.u[i]
            for k, share in added:
                row = [a + share * b for a, b in zip(row, self.u[k], strict=True)]
            moved[i] = row
        errors = zip(*(g for g, _ in noise), strict=True) if noise else [()] * n
        rows = [[*row, *error] for row, error in zip(moved, errors, strict=True)]
        u = [[0.0] * n for _ in range(n)]
        d = [0.0] * n
        for j in range(n - 1, -1, -1):
            row = rows[j]
            weighted = list(map(mul, row, weights))
            d[j] = norm = max(sum(map(mul, row, weighted)), LEAST)
            u[j][j] = 1.0
            for i in range(j):
                other = rows[i]
                share = sum(map(mul, other, weighted)) / norm
                if share:
                    u[i][j] = share
                    rows[i] = [a - share * b for a, b in zip(other, row, strict=True)]
        return Factors(u, d)

    def measured(self, h: Row, variance: float) -> tuple["Factors", list[float], float]:
        """What P becomes when one number is measured, h·x with an error of this variance (Bierman 1977, ch. V).

        Args:
            h: how the number depends on the quantities.
            variance: of its error, more than 0.

        Returns:
            The new factors, the gain, and the variance of what was expected to be measured.
        """
        n = len(self.d)
        f = [sum(map(mul, column, h)) for column in zip(*self.u, strict=True)]
        u = [row[:] for row in self.u]
        d = self.d[:]
        gain = [0.0] * n
        total = variance
        for j in range(n):
            along = f[j]
            if along == 0.0:
                continue
            weighted = along * self.d[j]
            before, total = total, total + along * weighted
            d[j] = max(self.d[j] * (before / total), LEAST)
            share = along / before
            for i in range(j):
                old = u[i][j]
                u[i][j] = old - share * gain[i]
                gain[i] += weighted * old
            gain[j] = weighted
        return Factors(u, d), [one / total for one in gain], total
