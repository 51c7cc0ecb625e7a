"""Lines over time as text: a cell of a terminal holds 2 x 4 Braille dots. Pure."""

import math
from collections.abc import Mapping, Sequence

_DOTS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
"""The bit of each dot of a cell, by row and column."""
_BLANK = 0x2800

Point = tuple[float, float]
"""Time (s) and value."""
Cell = tuple[str, int | None]
"""A character, and the number of the series that it belongs to."""


class Chart:
    """A picture of several series, a list of cells for each row, from the top."""

    def __init__(
        self, series: Mapping[str, Sequence[Point]], *, begin: float, end: float, width: int, height: int
    ) -> None:
        """
        Args:
            series: by name; points that are not finite leave a gap.
            begin, end: the times at the left and the right edge, s.
            width, height: in cells, the axis included.
        """
        finite = [
            value for points in series.values() for time, value in points if math.isfinite(value) and time >= begin
        ]
        self.low, self.high = _limits(finite)
        marks = [_number(self.high), _number((self.high + self.low) / 2), _number(self.low)]
        margin = max(map(len, marks)) + 1
        self._columns = max(width - margin, 1)
        self._height = max(height, 2)
        self._begin, self._span = begin, max(end - begin, 1e-9)
        bits = [[0] * self._columns for _ in range(self._height)]
        owner: list[list[int | None]] = [[None] * self._columns for _ in range(self._height)]
        for number, points in enumerate(series.values()):
            self._draw(points, number, bits, owner)
        labels = {0: marks[0], self._height // 2: marks[1], self._height - 1: marks[2]}
        self.rows: list[list[Cell]] = [
            [
                *((c, None) for c in f"{labels.get(row, ''):>{margin - 1}}│"),
                *((chr(_BLANK + b), who) for b, who in zip(bits[row], owner[row], strict=True)),
            ]
            for row in range(self._height)
        ]

    def _draw(self, points: Sequence[Point], number: int, bits: list[list[int]], owner: list[list[int | None]]) -> None:
        before: tuple[int, int] | None = None
        for time, value in points:
            if not math.isfinite(value) or time < self._begin:
                before = None
                continue
            x = round((time - self._begin) / self._span * (self._columns * 2 - 1))
            y = round((self.high - value) / (self.high - self.low) * (self._height * 4 - 1))
            for dot_x, dot_y in _line(before or (x, y), (x, y)):
                column, row = dot_x // 2, dot_y // 4
                if 0 <= column < self._columns and 0 <= row < self._height:
                    bits[row][column] |= _DOTS[dot_y % 4][dot_x % 2]
                    owner[row][column] = number
            before = (x, y)

    def __str__(self) -> str:
        return "\n".join("".join(character for character, _ in row).rstrip() for row in self.rows)


def _limits(values: Sequence[float]) -> tuple[float, float]:
    """The range that is shown: a constant stands in the middle."""
    if not values:
        return 0.0, 1.0
    low, high = min(values), max(values)
    room = (high - low) * 0.05 or max(abs(high) * 0.05, 0.5)
    return low - room, high + room


def _line(a: tuple[int, int], b: tuple[int, int]) -> list[tuple[int, int]]:
    """The dots from one to another."""
    steps = max(abs(b[0] - a[0]), abs(b[1] - a[1]), 1)
    return [
        (a[0] + round((b[0] - a[0]) * i / steps), a[1] + round((b[1] - a[1]) * i / steps)) for i in range(steps + 1)
    ]


def _number(value: float) -> str:
    return f"{value:.4g}"
