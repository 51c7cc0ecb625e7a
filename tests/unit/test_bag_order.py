"""Messages of many blocks in the order of their times, whatever the blocks' times, with few blocks in memory."""

from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo.bag.mcap.format import Malformed, Row
from robo.bag.read.order import Cache, Data, Span, in_order
from tests import bags

times = st.integers(0, 30)
blocks = st.lists(st.lists(times, min_size=1, max_size=8), max_size=8)


class Given:
    """Blocks of messages, each with the times that were given; loads are counted."""

    def __init__(self, every: Sequence[Sequence[int]], most: int) -> None:
        self._every = every
        self.loads = 0
        self.spans = [Span(min(block), max(block)) for block in every]
        self._cache = Cache(self._load, most)

    def data(self, number: int) -> Data:
        return self._cache.get(number)

    def damaged(self, number: int, reason: str) -> Exception:
        return ValueError(f"block {number}: {reason}")

    def _load(self, number: int) -> bytes:
        self.loads += 1
        block = self._every[number]
        return b"".join(bags.message(1, place, at, 0, bytes([number, place])) for place, at in enumerate(block))


def everything(_: int, __: Row) -> bool:
    return True


def arrived(row: Row) -> int:
    return row.arrived


@given(blocks, st.sampled_from([0, 100, 10_000]))
def test_messages_come_in_order_and_those_of_one_time_as_they_stand(every: list[list[int]], most: int) -> None:
    found = [
        (found.row.arrived, *found.data[found.row.begin : found.row.end])
        for found in in_order(Given(every, most), everything, arrived)
    ]
    expected = [(at, number, place) for number, block in enumerate(every) for place, at in enumerate(block)]
    assert found == sorted(expected)


@given(blocks, times, times)
def test_only_what_is_wanted_comes(every: list[list[int]], begin: int, end: int) -> None:
    wanted = [
        found.row.arrived for found in in_order(Given(every, 100), lambda _, row: begin <= row.arrived < end, arrived)
    ]
    assert wanted == sorted(at for block in every for at in block if begin <= at < end)


def test_of_a_file_as_it_was_written_each_block_is_loaded_once() -> None:
    given_ = Given([list(range(number * 100, number * 100 + 100)) for number in range(50)], most=0)
    assert sum(1 for _ in in_order(given_, everything, arrived)) == 5_000
    assert given_.loads == 50


def test_blocks_are_not_loaded_before_somebody_asks_for_their_messages() -> None:
    given_ = Given([[0, 1], [2, 3], [4, 5]], most=10_000)
    messages = in_order(given_, everything, arrived)
    assert next(messages).row.arrived == 0
    assert given_.loads == 1


def test_a_block_that_makes_no_sense_is_told() -> None:
    def wanted(_: int, row: Row) -> bool:
        if row.arrived == 3:
            raise Malformed("three is too many")
        return True

    with pytest.raises(ValueError, match="block 1: three is too many"):
        list(in_order(Given([[0, 1], [2, 3]], 100), wanted, arrived))


def test_more_at_one_time_than_memory_has_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robo.bag.read.order.LARGE", 50)
    monkeypatch.setattr("robo.bag.read.order.MOST_OPEN", 200)
    apart = [list(range(number * 10, number * 10 + 3)) for number in range(9)]
    assert sum(1 for _ in in_order(Given(apart, 100), everything, arrived)) == 27
    with pytest.raises(ValueError, match="large chunks of more than 200 bytes are of the same time"):
        list(in_order(Given([[0, 5, 9], [1, 8], [2, 7]], 100), everything, arrived))


def test_large_blocks_that_are_open_are_not_loaded_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robo.bag.read.order.LARGE", 50)
    given_ = Given([list(range(0, 100, 2)), list(range(1, 100, 2))], most=0)
    assert sum(1 for _ in in_order(given_, everything, arrived)) == 100
    assert given_.loads <= 4
