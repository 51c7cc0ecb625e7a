"""How often each place was hit: squares of a grid that gets coarser where there would be too many. Pure."""

import math
from collections.abc import Iterable
from typing import NamedTuple

RESOLUTION = 0.05
"""Width of a cell where there is room for such, m."""
_MOST_CELLS = 1_000_000
_MOST_SIDE = 1_000
"""Cells along a side of a picture."""
FARTHEST = 1e6
"""What is further away is no place, m."""
_OUTSIDE = 0.001
"""Of all hits so many may be beyond each edge of the picture: lasers see far through windows."""
_MARGIN = 0.5
"""Around all, m."""


class Grid(NamedTuple):
    """A part of the cells, as rows from the top (the highest y)."""

    resolution: float
    """Width of a cell, m."""
    left: float
    """x of the left edge, m."""
    top: float
    """y of the upper edge, m."""
    width: int
    height: int
    counts: dict[tuple[int, int], int]
    """How often what is at (column, row) was hit."""


class Cells:
    """Counts hits."""

    def __init__(self, resolution: float = RESOLUTION) -> None:
        self.resolution = resolution
        self.hits = 0
        self._counts: dict[tuple[int, int], int] = {}

    def add(self, points: Iterable[tuple[float, float]]) -> None:
        """Places that were hit, m."""
        counts, per = self._counts, 1.0 / self.resolution
        for x, y in points:
            if -FARTHEST < x < FARTHEST and -FARTHEST < y < FARTHEST:
                cell = math.floor(x * per), math.floor(y * per)
                counts[cell] = counts.get(cell, 0) + 1
                self.hits += 1
        if len(counts) > _MOST_CELLS:
            self._coarsen()

    def grid(self, track: Iterable[tuple[float, float]]) -> Grid:
        """What a picture shows: nearly all that was hit, and all of the track."""
        while True:
            left, right, low, high = self._edges(track := list(track))
            width, height = right - left + 1, high - low + 1
            if max(width, height) <= _MOST_SIDE:
                break
            self._coarsen()
        counts = {
            (x - left, high - y): count
            for (x, y), count in self._counts.items()
            if left <= x <= right and low <= y <= high
        }
        size = self.resolution
        return Grid(size, left * size, (high + 1) * size, width, height, counts)

    def _edges(self, track: Iterable[tuple[float, float]]) -> tuple[int, int, int, int]:
        margin = math.ceil(_MARGIN / self.resolution)
        found: list[int] = []
        for axis in (0, 1):
            by_place: dict[int, int] = {}
            for cell, count in self._counts.items():
                by_place[cell[axis]] = by_place.get(cell[axis], 0) + count
            within = _within(by_place, round(self.hits * _OUTSIDE))
            on_track = [math.floor(point[axis] / self.resolution) for point in track if abs(point[axis]) < FARTHEST]
            ends = [*within, *on_track] or [0]
            found += [min(ends) - margin, max(ends) + margin]
        left, right, low, high = found
        return left, right, low, high

    def _coarsen(self) -> None:
        self.resolution *= 2.0
        merged: dict[tuple[int, int], int] = {}
        for (x, y), count in self._counts.items():
            cell = x // 2, y // 2
            merged[cell] = merged.get(cell, 0) + count
        self._counts = merged


def _within(counts: dict[int, int], beyond: int) -> list[int]:
    """The first and the last place with not more than so many hits beyond it; none where there are none."""
    ends = []
    for places in (sorted(counts), sorted(counts, reverse=True)):
        passed = 0
        for place in places:
            passed += counts[place]
            if passed > beyond:
                ends.append(place)
                break
    return ends
