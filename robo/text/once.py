"""Telling a thing once: what a thousand messages have in common is said of the first of them."""

from collections.abc import Callable

MOST = 1_000
"""Things that are told; whoever makes up new ones fills no log."""


class Once:
    """Tells what has not been told yet."""

    def __init__(self, tell: Callable[[str], object], most: int = MOST) -> None:
        """
        Args:
            tell: is told each.
            most: how many at the most.
        """
        self._tell = tell
        self._most = most
        self._told: set[str] = set()

    def __call__(self, text: str, what: str | None = None) -> bool:
        """Tell a text, unless `what` it is about, or the text itself, has been told. Returns whether it was new."""
        key = text if what is None else what
        if key in self._told or len(self._told) >= self._most:
            return False
        self._told.add(key)
        self._tell(text)
        return True
