"""What waits for one browser: the newest of each channel, the most urgent first, in bounded memory. Pure."""

from collections import deque
from collections.abc import Hashable
from typing import NamedTuple

MOST_UNREAD = 262_144
"""Bytes that are on their way to a browser before it says that it has them: more would only make what follows old."""
_MOST_LINES = 2_000
"""Of a channel of which all counts."""
_MOST_LINES_SIZE = 2_000_000
"""And what they may take together, bytes."""
_MOST_SENT = 5_000
"""Frames that a browser may leave without a word: some eight minutes of beats."""


class Frame(NamedTuple):
    """Something for a browser."""

    data: bytes | str

    @property
    def size(self) -> int:
        """Bytes, about."""
        return len(self.data)


class Mailbox:
    """What one browser gets next."""

    def __init__(self, most_unread: int = MOST_UNREAD) -> None:
        self._most_unread = most_unread
        self._urgent: dict[Hashable, Frame] = {}
        self._newest: dict[Hashable, Frame] = {}
        self._lines: deque[Frame] = deque()
        self._lines_size = 0
        self._sent: deque[int] = deque()
        self._unread = 0
        self.left_out = 0
        """Frames of which all count that were left out, since too many waited."""
        self.skipped = 0
        """Frames that a newer one has taken the place of."""

    def put(self, channel: Hashable, data: bytes | str, *, urgent: bool = False) -> None:
        """The newest of a channel: it takes the place of the one that waits."""
        box = self._urgent if urgent else self._newest
        # One that waits keeps its turn: else a quick channel would hold itself back for ever.
        self.skipped += channel in box
        box[channel] = Frame(data)

    def add(self, data: bytes | str) -> None:
        """One of which all count: lines of the log, events."""
        self._lines.append(Frame(data))
        self._lines_size += len(data)
        while len(self._lines) > 1 and (len(self._lines) > _MOST_LINES or self._lines_size > _MOST_LINES_SIZE):
            self._lines_size -= self._lines.popleft().size
            self.left_out += 1

    def drop(self, channel: Hashable) -> None:
        """Nobody looks at a channel any more."""
        self._newest.pop(channel, None)

    def take(self) -> Frame | None:
        """The next one; None where nothing waits, or the browser has not had what is on its way."""
        if self._urgent:  # always: it is small
            return self._taken(self._urgent.pop(next(iter(self._urgent))))
        if self._unread >= self._most_unread:
            return None
        if self._lines:
            self._lines_size -= self._lines[0].size
            return self._taken(self._lines.popleft())
        if self._newest:
            return self._taken(self._newest.pop(next(iter(self._newest))))
        return None

    def has_read(self, count: int) -> None:
        """The browser has dealt with so many frames more."""
        for _ in range(min(count, len(self._sent))):
            self._unread -= self._sent.popleft()

    @property
    def urgent(self) -> int:
        """Frames that wait before all others."""
        return len(self._urgent)

    @property
    def is_lost(self) -> bool:
        """Whether the browser takes what it gets and never says so."""
        return len(self._sent) > _MOST_SENT

    @property
    def unread(self) -> int:
        """Bytes that are on their way."""
        return self._unread

    def _taken(self, frame: Frame) -> Frame:
        self._sent.append(frame.size)
        self._unread += frame.size
        return frame
