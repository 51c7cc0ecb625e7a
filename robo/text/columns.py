"""Rows of words as lines with columns."""

from collections.abc import Sequence

from robo.text.terminal import visible, width

_GAP = "  "
_LEAST_LAST = 24
"""So much of the last column, which may be long, is worth more than other columns."""


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """A line for each row; each column as wide as its longest word."""
    rows = [[visible(word) for word in row] for row in rows]
    widths = [max(map(width, column)) for column in zip(*rows, strict=True)]
    return [_GAP.join(map(_padded, row, widths)).rstrip() for row in rows]


def fitted(rows: Sequence[Sequence[str]], most: int, spared: Sequence[str]) -> list[list[str]]:
    """Rows that take no more than so many columns of a terminal, as far as that goes.

    Args:
        rows: the first one is the head.
        most: how wide a line may be.
        spared: names in the head; of these what there is no room for is left out, the first first.

    Returns:
        The rows with what is left; the last word of each is cut short where it is too long.
    """
    columns = [list(map(visible, column)) for column in zip(*rows, strict=True)]
    last = columns[-1]
    needed = min(max(map(width, last)), _LEAST_LAST)

    def left() -> int:
        """The room for the last column."""
        return most - sum(max(map(width, column)) + len(_GAP) for column in columns[:-1])

    for name in spared:
        if left() >= needed:
            break
        columns = [column for column in columns if column[0] != name]
    columns[-1] = [_cut(word, max(left(), needed)) for word in last]
    return [list(row) for row in zip(*columns, strict=True)]


def _cut(word: str, most: int) -> str:
    return word if width(word) <= most else f"{word[: most - 1]}…"


def _padded(word: str, to: int) -> str:
    return word + " " * (to - width(word))
