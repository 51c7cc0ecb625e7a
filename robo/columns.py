"""Rows of words as lines with columns."""

from collections.abc import Sequence

from robo.terminal import visible, width


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """A line for each row; each column as wide as its longest word."""
    rows = [[visible(word) for word in row] for row in rows]
    widths = [max(map(width, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(map(_padded, row, widths)).rstrip() for row in rows]


def _padded(word: str, to: int) -> str:
    return word + " " * (to - width(word))
