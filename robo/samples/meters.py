"""Figures about topics, worked out from what publishers say of each message.

Every message carries its sequence number and the time at which it was published. Rates and losses from
these are exact: neither the tool's own delays nor messages that were lost on the way falsify them. Pure.
"""

import math
import statistics
from collections.abc import Callable
from itertools import pairwise
from typing import Literal

import msgspec

Measure = Literal["hz", "bw", "delay", "loss"]


class Rate(msgspec.Struct, frozen=True):
    """How often messages were published within a window."""

    key: str
    rate: float
    """Hz, from the times at which they were published; messages that were lost count."""
    count: int
    min: float
    """Shortest time between two, s."""
    max: float
    """Longest time between two, s."""
    std: float
    """Standard deviation of the times between two, s."""
    jitter: float
    """Mean change from one time between two to the next, s."""
    lost: int
    """Gaps in the sequence numbers."""


class Bandwidth(msgspec.Struct, frozen=True):
    """How many bytes of payload came within a window."""

    key: str
    rate: float
    """Hz."""
    bandwidth: float
    """Bytes a second."""
    count: int
    min: float
    """Smallest message, bytes."""
    max: float
    """Largest message, bytes."""
    mean: float
    """Bytes."""
    std: float
    """Standard deviation of the sizes, bytes."""


class Delay(msgspec.Struct, frozen=True):
    """How long messages took from their publisher to this program, within a window."""

    key: str
    rate: float
    """Hz."""
    count: int
    min: float
    """s. Between machines their clocks decide: a negative delay says that they differ."""
    max: float
    """s."""
    mean: float
    """s."""
    std: float
    """Standard deviation, s."""
    jitter: float
    """Mean change from one delay to the next, s."""


class Loss(msgspec.Struct, frozen=True):
    """How many messages did not come, within a window."""

    key: str
    rate: float
    """Hz, as published."""
    count: int
    """Messages that came."""
    lost: int
    """Messages that did not, by the gaps in the sequence numbers."""
    loss: float
    """Lost ones among all, 0 to 1."""
    min: float
    """Fewest lost at a stretch; 0 where nothing was lost."""
    max: float
    """Most lost at a stretch."""
    std: float
    """Standard deviation of how many were lost at a stretch."""
    total_count: int
    """Messages that came since the beginning."""
    total_lost: int


Window = Rate | Bandwidth | Delay | Loss


class _Series(msgspec.Struct):
    """The messages of one publisher."""

    number: int
    published: int
    period: float = 0.0
    """About how long from one to the next, ns."""


_IMPLAUSIBLE = 20.0
"""Of several publishers, one that seems to have lost so many times more than it can have published
since is another one."""


class Sequences:
    """Tells how many messages were lost, from sequence numbers and publish times alone.

    A topic may have several publishers, each with numbers of its own, and a publisher may start anew:
    a number that continues no series begins another one.
    """

    def __init__(self, *, several: bool = False) -> None:
        """`several` publishers are there: a jump may also be the first word of one of them."""
        self._several = several
        self._series: list[_Series] = []

    def gap(self, number: int, published: int) -> int:
        """How many messages of its publisher are missing before this one."""
        nearest = None
        for series in self._series:
            if series.number < number and (nearest is None or series.number > nearest.number):
                nearest = series
        if nearest is None or (self._several and not _plausible(nearest, number, published)):
            self._series.append(_Series(number, published))
            del self._series[:-64]  # publishers that come and go
            return 0
        missing = number - nearest.number - 1
        nearest.period = (published - nearest.published) / (missing + 1)
        nearest.number, nearest.published = number, published
        return missing


def _plausible(series: _Series, number: int, published: int) -> bool:
    missing = number - series.number - 1
    if not missing or not series.period:
        return missing < _IMPLAUSIBLE
    return missing < _IMPLAUSIBLE * (1.0 + (published - series.published) / series.period)


class Meter:
    """The figures of one topic, window by window.

    The last message of a window is the first of the next one, so that no gap goes unseen.
    """

    def __init__(self, key: str, publishers: int = 1) -> None:
        """`publishers` is how many there are, as far as is known."""
        self.key = key
        self.total_count = 0
        self.total_lost = 0
        self._sequences = Sequences(several=publishers > 1)
        self._published: list[int] = []
        self._arrived: list[int] = []
        self._sizes: list[int] = []
        self._gaps: list[int] = []

    def add(self, sequence_number: int | None, published: int, arrived: int, size: int) -> None:
        """Count a message.

        Args:
            sequence_number: None where the publisher does not say.
            published: ns since the epoch, by the publisher's clock.
            arrived: ns since the epoch, by this machine's clock.
            size: of the payload, bytes.
        """
        gap = self._sequences.gap(sequence_number, published) if sequence_number is not None else 0
        self._published.append(published)
        self._arrived.append(arrived)
        self._sizes.append(size)
        self._gaps.append(gap)
        self.total_count += 1
        self.total_lost += gap

    def window(self, measure: Measure) -> Window | None:
        """The figures since the last window; None for less than two messages."""
        if len(self._published) < 2:
            return None
        figures: dict[Measure, Callable[[], Window]] = {
            "hz": self._hz, "bw": self._bw, "delay": self._delay, "loss": self._loss,
        }  # fmt: skip
        result = figures[measure]()
        self.forget()
        return result

    def forget(self) -> None:
        """Begin a new window."""
        for kept in (self._published, self._arrived, self._sizes, self._gaps):
            del kept[:-1]

    @property
    def _lost(self) -> int:
        return sum(self._gaps[1:])

    @property
    def _rate(self) -> float:
        span = (max(self._published) - min(self._published)) * 1e-9
        steps = len(self._published) - 1 + self._lost
        return steps / span if span > 0 else math.inf

    def _hz(self) -> Rate:
        gaps = [(b - a) * 1e-9 for a, b in pairwise(self._published)]
        return Rate(
            self.key, self._rate, len(gaps), min(gaps), max(gaps), statistics.pstdev(gaps), _jitter(gaps), self._lost
        )

    def _bw(self) -> Bandwidth:
        sizes = self._sizes[1:]
        mean = statistics.fmean(sizes)
        span = (max(self._arrived) - min(self._arrived)) * 1e-9
        rate = len(sizes) / span if span > 0 else math.inf
        return Bandwidth(
            self.key, rate, rate * mean, len(sizes), min(sizes), max(sizes), mean, statistics.pstdev(sizes)
        )

    def _delay(self) -> Delay:
        delays = [(came - went) * 1e-9 for went, came in zip(self._published[1:], self._arrived[1:], strict=True)]
        return Delay(
            self.key,
            self._rate,
            len(delays),
            min(delays),
            max(delays),
            statistics.fmean(delays),
            statistics.pstdev(delays),
            _jitter(delays),
        )

    def _loss(self) -> Loss:
        stretches = [gap for gap in self._gaps[1:] if gap] or [0]
        count, lost = len(self._gaps) - 1, self._lost
        return Loss(
            self.key,
            self._rate,
            count,
            lost,
            lost / (count + lost),
            min(stretches),
            max(stretches),
            statistics.pstdev(stretches),
            self.total_count,
            self.total_lost,
        )


def _jitter(values: list[float]) -> float:
    changes = [abs(b - a) for a, b in pairwise(values)]
    return statistics.fmean(changes) if changes else 0.0
