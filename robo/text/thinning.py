"""Long lines with as many points as a picture shows, and with all their peaks. Pure."""

import math
from itertools import zip_longest

Point = tuple[float, float]
"""Time (s) and value."""

MOST = 1_000
"""Stretches of a line: a picture has no more columns."""


class Thinned:
    """Points as they come; of each stretch of them the lowest and the highest stay. It takes no more than so many."""

    def __init__(self, most: int = MOST) -> None:
        self._most = most
        self._each = 1
        """Points of a stretch."""
        self._stretches: list[list[Point]] = []
        self._filled = 0
        """Points of the last one."""
        self.count = 0

    def add(self, time: float, value: float) -> None:
        """One more; one that is not finite makes a gap."""
        self.count += 1
        if not self._stretches or self._filled == self._each:
            if len(self._stretches) == self._most:
                halves = self._stretches[::2], self._stretches[1::2]
                self._stretches = [_ends([*first, *second]) for first, second in zip_longest(*halves, fillvalue=())]
                self._each *= 2
            self._stretches.append([])
            self._filled = 0
        self._filled += 1
        self._stretches[-1] = _ends([*self._stretches[-1], (time, value)])

    @property
    def points(self) -> list[Point]:
        """What stays, in the order in which it came."""
        return [point for stretch in self._stretches for point in stretch]


def _ends(points: list[Point]) -> list[Point]:
    """The lowest and the highest of a few points, and the first that is not finite."""
    finite = [index for index, (_, value) in enumerate(points) if math.isfinite(value)]
    gaps = [index for index, (_, value) in enumerate(points) if not math.isfinite(value)]
    kept = {*gaps[:1]}
    if finite:
        kept |= {min(finite, key=lambda index: points[index][1]), max(finite, key=lambda index: points[index][1])}
    return [points[index] for index in sorted(kept)]
