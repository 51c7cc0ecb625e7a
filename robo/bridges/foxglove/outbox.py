"""What waits for one client: words all, of messages the newest, in bounded memory. Pure."""

from collections import Counter, deque
from typing import NamedTuple

from robo.bridges.foxglove import protocol

MOST_OF_ONE, MOST_BYTES_OF_ONE = 256, 4_000_000
"""Messages of one subscription that wait, and their bytes; one waits however large it is."""
MOST_BYTES = 16_000_000
"""Of all subscriptions together: beyond it the one that has most loses its oldest."""
MOST_WORDS, MOST_BYTES_OF_WORDS = 50_000, 32_000_000
"""A client for which so many words wait, or so many bytes of them and one more, does not read."""


class Full(Exception):
    """A client takes nothing."""


class _Waiting(NamedTuple):
    time: int
    payload: bytes


class _Row:
    """The messages of one subscription."""

    def __init__(self) -> None:
        self.messages: deque[_Waiting] = deque()
        self.bytes = 0
        self.gone = 0
        """Turns of messages that are left out, and still stand in the order."""

    def pop(self) -> _Waiting:
        oldest = self.messages.popleft()
        self.bytes -= len(oldest.payload)
        return oldest


class Outbox:
    """What one client gets next: words first, then messages in the order in which they came."""

    def __init__(self, most_bytes: int = MOST_BYTES) -> None:
        self._most_bytes = most_bytes
        self._words: deque[str | bytes] = deque()
        self._word_bytes = 0
        self._newest: dict[str, str | bytes] = {}
        self._rows: dict[int, _Row] = {}
        self._order: deque[int] = deque()
        """Whose turn it is, by subscription."""
        self._bytes = 0
        self._count = 0
        self.left_out: Counter[int] = Counter()
        """Messages that a newer one has taken the place of, by subscription."""
        self.forgotten = 0
        """The same, of subscriptions that are forgotten."""

    def say(self, word: str | bytes) -> None:
        """Something of which all counts.

        Raises:
            Full: the client takes nothing.
        """
        if len(self._words) >= MOST_WORDS or self._word_bytes >= MOST_BYTES_OF_WORDS:
            raise Full
        self._words.append(word)
        self._word_bytes += len(word)

    def say_newest(self, what: str, frame: str | bytes) -> None:
        """Something of which only the last one counts: what time it is."""
        self._newest[what] = frame

    def put(self, subscription: int, time: int, payload: bytes) -> None:
        """A message; older ones give way where too many wait."""
        row = self._rows.get(subscription)
        if row is None:
            row = self._rows[subscription] = _Row()
        row.messages.append(_Waiting(time, payload))
        row.bytes += len(payload)
        self._order.append(subscription)
        self._bytes += len(payload)
        self._count += 1
        while len(row.messages) > 1 and (len(row.messages) > MOST_OF_ONE or row.bytes > MOST_BYTES_OF_ONE):
            self._leave_out(subscription, row)
        while self._bytes > self._most_bytes and self._count > 1:
            # One that has one message alone keeps it, as long as another has more.
            worst = max(self._rows, key=lambda one: (len(self._rows[one].messages) > 1, self._rows[one].bytes))
            self._leave_out(worst, self._rows[worst])
        if len(self._order) > 2 * self._count + 1_000:
            self._tidy()

    def forget(self, subscription: int) -> None:
        """Nobody wants these any more."""
        row = self._rows.pop(subscription, None)
        if row is not None:
            self._bytes -= row.bytes
            self._count -= len(row.messages)
            self._order = deque(one for one in self._order if one != subscription)
        self.forgotten += self.left_out.pop(subscription, 0)

    def take(self) -> str | bytes | None:
        """What comes next; None where nothing waits."""
        if self._words:
            word = self._words.popleft()
            self._word_bytes -= len(word)
            return word
        if self._newest:
            return self._newest.pop(next(iter(self._newest)))
        while self._order:
            subscription = self._order.popleft()
            row = self._rows[subscription]
            if row.gone:
                row.gone -= 1
                continue
            oldest = row.pop()
            self._bytes -= len(oldest.payload)
            self._count -= 1
            return protocol.message(subscription, oldest.time, oldest.payload)
        return None

    @property
    def waiting(self) -> int:
        """Bytes of messages."""
        return self._bytes

    def _leave_out(self, subscription: int, row: _Row) -> None:
        self._bytes -= len(row.pop().payload)
        self._count -= 1
        row.gone += 1
        self.left_out[subscription] += 1

    def _tidy(self) -> None:
        """Forget turns of what was left out: a client that takes nothing for hours fills no memory by them."""
        kept: deque[int] = deque()
        for subscription in self._order:
            row = self._rows[subscription]
            if row.gone:
                row.gone -= 1
            else:
                kept.append(subscription)
        self._order = kept
