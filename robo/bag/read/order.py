"""Messages of many blocks in the order of their times, holding few blocks in memory. Pure but for what loads them.

Blocks say from when to when their messages are. A block is opened when its first message may be due, so that in a
file that was written as messages came one is open at a time. Of an open block the times and places are kept, 16 bytes
a message; its data are kept as long as there is room for them, and loaded again where there is not.
"""

import heapq
from array import array
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from typing import Final, NamedTuple, Protocol

from robo.bag.mcap.format import MESSAGE_HEAD, PREFIX, Malformed, Row, rows

Data = bytes | memoryview

MOST_KEPT: Final = 2**26
"""Of blocks that are kept after they were last looked at, bytes: 67 MB."""

LARGE: Final = 2**24
"""The data of a larger block stay as long as it is open, bytes: 17 MB. To load them for each message takes long."""
MOST_OPEN: Final = 2**28
"""Of such blocks whose messages come at one time, bytes: 268 MB."""

_FOR_EVER = 2**64


class Span(NamedTuple):
    """A block as far as order goes."""

    begin: int
    """No message is before, ns."""
    end: int
    """None is after, ns."""


class Found(NamedTuple):
    """A message in its place."""

    block: int
    row: Row
    data: Data
    """Of the block."""


class Blocks(Protocol):
    """Where messages stand."""

    @property
    def spans(self) -> Sequence[Span]:
        """Of each block."""

    def data(self, number: int) -> Data:
        """The records of a block."""

    def damaged(self, number: int, reason: str) -> Exception:
        """What to raise where the records of a block make no sense."""


class Cache:
    """The data of blocks that were used last."""

    def __init__(self, load: Callable[[int], Data], most: int = MOST_KEPT) -> None:
        """`load` has the data of a block by its number; `most` bytes are kept, and the last block in any case."""
        self._load = load
        self._most = most
        self._kept: OrderedDict[int, Data] = OrderedDict()
        self._size = 0

    def get(self, number: int) -> Data:
        """The data of a block."""
        data = self._kept.get(number)
        if data is None:
            data = self._kept[number] = self._load(number)
            self._size += len(data)
            while self._size > self._most and len(self._kept) > 1:
                self._size -= len(self._kept.popitem(last=False)[1])
        self._kept.move_to_end(number)
        return data


def in_order(blocks: Blocks, wanted: Callable[[int, Row], bool], time_of: Callable[[Row], int]) -> Iterator[Found]:
    """Messages in the order of their times; those of one time in that of their blocks and places.

    Args:
        blocks: where they stand.
        wanted: whether a message of a block is to be there; raises `Malformed` where it makes no sense.
        time_of: what time counts.

    Raises:
        Exception: what `blocks.damaged` makes: a block makes no sense, or too much is of one time.
    """
    spans = blocks.spans
    waiting = sorted(range(len(spans)), key=lambda number: (spans[number].begin, number), reverse=True)
    heap: list[tuple[int, int, int, Iterator[tuple[int, int]]]] = []
    large: dict[int, Data] = {}
    while waiting or heap:
        while waiting and (not heap or spans[waiting[-1]].begin <= heap[0][0]):
            number = waiting.pop()
            due = _rows_of(blocks, number, wanted, time_of)
            for time, place in due:
                heapq.heappush(heap, (time, number, place, due))
                if len(data := blocks.data(number)) > LARGE:
                    large[number] = data
                break
            if len(large) > 1 and sum(map(len, large.values())) > MOST_OPEN:
                raise blocks.damaged(number, f"large chunks of more than {MOST_OPEN:,} bytes are of the same time")
        if not heap:
            continue
        _, number, place, due = heap[0]
        data = large.get(number) or blocks.data(number)
        yield Found(number, _row_at(data, place), data)
        if len(heap) > 1:
            for time, place in due:
                heapq.heapreplace(heap, (time, number, place, due))
                break
            else:
                heapq.heappop(heap)
                large.pop(number, None)
            continue
        # No other block has a say, until the next one opens.
        next_opens = spans[waiting[-1]].begin if waiting else _FOR_EVER
        for time, place in due:
            if time >= next_opens:
                heap[0] = (time, number, place, due)
                break
            yield Found(number, _row_at(data, place), data)
        else:
            heap.clear()
            large.clear()


def _rows_of(
    blocks: Blocks, number: int, wanted: Callable[[int, Row], bool], time_of: Callable[[Row], int]
) -> Iterator[tuple[int, int]]:
    """Time and place of the messages of a block, in order."""
    times, places = array("Q"), array("Q")
    last, sorted_ = 0, True
    try:
        for row in rows(blocks.data(number)):
            if wanted(number, row):
                time = time_of(row)
                sorted_ = sorted_ and time >= last
                last = time
                times.append(time)
                places.append(row.begin)
    except Malformed as error:
        raise blocks.damaged(number, str(error)) from None
    if not sorted_:
        by_time = sorted(range(len(times)), key=times.__getitem__)
        times, places = array("Q", map(times.__getitem__, by_time)), array("Q", map(places.__getitem__, by_time))
    return zip(times, places, strict=True)


def _row_at(data: Data, begin: int) -> Row:
    """The message whose data begin somewhere in a block."""
    head = begin - MESSAGE_HEAD.size
    _, length = PREFIX.unpack_from(data, head - PREFIX.size)
    channel, sequence, arrived, published = MESSAGE_HEAD.unpack_from(data, head)
    return Row(channel, sequence, arrived, published, begin, head + length)
