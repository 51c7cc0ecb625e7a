"""How far something is that goes through a recording, told while it goes on. Pure."""

from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

T = TypeVar("T")

Tell = Callable[[int, int], None]
"""Takes how much is done and of how much, 0 where that is not known: messages, or bytes where a file is scanned."""

_EACH = 50
"""Messages from one time to the next that it is told."""


def silent(done: int, total: int) -> None:
    """Tell nobody."""
    del done, total


def counted(items: Iterable[T], total: int, tell: Tell) -> Iterator[T]:
    """The same items, and it is told how many of `total` have been handed out."""
    for done, item in enumerate(items, start=1):
        yield item
        if done % _EACH == 0:
            tell(done, total)
