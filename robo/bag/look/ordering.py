"""Messages that come after later ones of their publisher. Pure.

A topic may have several publishers, of which one is always a little later than another; that is no disorder. Where
messages have numbers, each publisher is a series of them.
"""

from typing import Final

import msgspec

_MOST_SERIES = 64
"""Publishers of a topic that are told apart."""
_MOST_MISSING = 1_000
"""Numbers that a series waits for."""
_CLEARLY: Final = 10**9
"""What is so much later is out of order, whoever has said it, ns."""


class _Series(msgspec.Struct):
    """What one publisher has said."""

    last: int
    published: int
    """The latest, ns."""
    missing: dict[int, None]
    """Numbers before the last one that have not come."""


class Ordering:
    """Tells what is late, message by message of one topic."""

    def __init__(self, publishers: int) -> None:
        """`publishers` were announced."""
        self._alone = publishers == 1
        self._latest = 0
        self._series: list[_Series] = []

    def late(self, sequence: int, published: int) -> int:
        """By how much a message was published before one of its publisher that has come sooner, ns; 0 where it was not.

        Args:
            sequence: its number; 0 for none.
            published: ns since the epoch.
        """
        if not sequence:
            late = max(self._latest - published, 0)
            self._latest = max(self._latest, published)
            return late if self._alone or late > _CLEARLY else 0
        series = self._of(sequence)
        if series is None:
            self._series.append(_Series(sequence, published, {}))
            del self._series[:-_MOST_SERIES]
            return 0
        late = max(series.published - published, 0)
        series.published = max(series.published, published)
        series.missing.pop(sequence, None)
        if sequence > series.last:
            if sequence - series.last <= _MOST_MISSING:
                series.missing |= dict.fromkeys(range(series.last + 1, sequence))
            series.last = sequence
            while len(series.missing) > _MOST_MISSING:
                del series.missing[next(iter(series.missing))]
        return late

    def _of(self, sequence: int) -> _Series | None:
        """The series that a message goes on, or is missing in, or else may have left something out of."""
        before = None
        for series in self._series:
            if series.last == sequence - 1:
                return series
            if series.last < sequence and (before is None or series.last > before.last):
                before = series
        return next((series for series in self._series if sequence in series.missing), before)
