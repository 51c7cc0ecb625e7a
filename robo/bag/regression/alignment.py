"""Which message of one recording is which of another. Pure."""

from collections.abc import Callable, Iterable, Iterator
from itertools import zip_longest
from typing import Generic, TypeVar

M = TypeVar("M")

Pairs = Iterator[tuple[M | None, M | None]]
"""A message of the first and one of the second; None where one is missing there."""


def in_order(first: Iterable[M], second: Iterable[M]) -> Pairs[M]:
    """One after the other: the first with the first."""
    return zip_longest(first, second)


def by_time(first: Iterable[M], second: Iterable[M], time_of: Callable[[M], int], window: int) -> Pairs[M]:
    """Each with the one that is nearest in time, so that one that is missing makes nothing of what follows differ.

    Args:
        first, second: messages in the order of their times.
        time_of: the time of one, ns.
        window: those that are further apart than this are never the same, ns.
    """
    mine, theirs = _Ahead(first), _Ahead(second)
    while True:
        a, b = mine.head, theirs.head
        if a is None and b is None:
            return
        if a is None or b is None:
            yield mine.take(), theirs.take()
            continue
        apart = abs(time_of(a) - time_of(b))
        a_better = mine.next is not None and abs(time_of(mine.next) - time_of(b)) < apart
        b_better = theirs.next is not None and abs(time_of(theirs.next) - time_of(a)) < apart
        if apart > window or (a_better != b_better):
            behind = time_of(a) < time_of(b) if apart > window else a_better
            yield (mine.take(), None) if behind else (None, theirs.take())
        else:
            yield mine.take(), theirs.take()


class _Ahead(Generic[M]):
    """A stream of which one sees the next two."""

    def __init__(self, messages: Iterable[M]) -> None:
        self._rest = iter(messages)
        self.head: M | None = next(self._rest, None)
        self.next: M | None = next(self._rest, None)

    def take(self) -> M | None:
        """The next one, if there is one."""
        taken = self.head
        self.head, self.next = self.next, next(self._rest, None)
        return taken
