"""Figures about topics: exact by the publisher's own numbers."""

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo.samples.meters import Bandwidth, Delay, Loss, Meter, Rate, Sequences

MS = 1_000_000


def metered(numbers: list[int], *, period: int = 100 * MS, delay: int = 0, size: int = 10) -> Meter:
    meter = Meter("k")
    for number in numbers:
        meter.add(number, number * period, number * period + delay, size)
    return meter


def test_a_rate_counts_what_was_lost_and_not_the_observers_delay() -> None:
    meter = Meter("k")
    assert meter.window("hz") is None
    for number in (1, 2, 3, 6, 7):
        meter.add(number, number * 100 * MS, 10**12 + number, 1)
    rate = meter.window("hz")
    assert isinstance(rate, Rate)
    assert rate.rate == pytest.approx(10.0)
    assert (rate.count, rate.lost) == (4, 2)
    assert (rate.min, rate.max) == pytest.approx((0.1, 0.3))
    assert rate.jitter == pytest.approx(0.4 / 3)
    meter.add(8, 800 * MS, 0, 1)
    following = meter.window("hz")
    assert isinstance(following, Rate)
    assert (following.count, following.rate) == pytest.approx((1, 10.0)), "the gap between windows belongs to one"


def test_bandwidth_is_what_came() -> None:
    figures = metered([1, 2, 3, 4], size=1000).window("bw")
    assert isinstance(figures, Bandwidth)
    assert figures.bandwidth == pytest.approx(10_000)
    assert (figures.min, figures.max, figures.std) == (1000, 1000, 0)


def test_delay_is_from_publishing_to_arrival() -> None:
    figures = metered([1, 2, 3], delay=5 * MS).window("delay")
    assert isinstance(figures, Delay)
    assert (figures.mean, figures.min, figures.std) == pytest.approx((0.005, 0.005, 0.0))
    early = metered([1, 2], delay=-3 * MS).window("delay")
    assert isinstance(early, Delay)
    assert early.min == pytest.approx(-0.003)


@given(st.integers(0, 2**32), st.integers(1, 500))
def test_loss_is_exactly_what_was_dropped(seed: int, count: int) -> None:
    chance = random.Random(seed)
    kept = [number for number in range(2, count + 2) if chance.random() < 0.7]
    numbers = [1, *kept, count + 2]
    figures = metered(numbers).window("loss")
    assert isinstance(figures, Loss)
    assert figures.lost == count + 2 - len(numbers)
    assert figures.count == len(numbers) - 1
    assert (figures.total_lost, figures.total_count) == (figures.lost, len(numbers))


def test_losses_add_up_over_windows() -> None:
    meter = metered([1, 2, 5])
    first = meter.window("loss")
    for number in (6, 10):
        meter.add(number, number * 100 * MS, 0, 1)
    second = meter.window("loss")
    assert isinstance(first, Loss)
    assert isinstance(second, Loss)
    assert (first.lost, first.max) == (2, 2)
    assert (second.lost, second.max) == (3, 3)
    assert second.total_lost == 5


def test_a_publisher_that_starts_anew_has_lost_nothing() -> None:
    sequences = Sequences()
    assert [sequences.gap(number, i) for i, number in enumerate((500, 501, 1, 2, 4))] == [0, 0, 0, 0, 1]


def test_several_publishers_are_told_apart() -> None:
    sequences = Sequences(several=True)
    gaps = []
    for i in range(50):
        gaps.append(sequences.gap(10 + i, i * 10 * MS))
        if i != 20:
            gaps.append(sequences.gap(100_000 + i, i * 10 * MS + MS))
    assert sum(gaps) == 1


def test_publishers_that_count_alike_are_told_apart() -> None:
    sequences = Sequences(several=True)
    assert sum(sequences.gap(n, n * MS) for n in range(1, 40) for _ in range(2)) == 0


def test_a_publisher_that_says_nothing_is_measured_by_arrival() -> None:
    meter = Meter("k")
    for i in range(4):
        meter.add(None, i * 50 * MS, i * 50 * MS, 1)
    rate = meter.window("hz")
    assert isinstance(rate, Rate)
    assert (rate.rate, rate.lost) == pytest.approx((20.0, 0))
