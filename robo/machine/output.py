"""What a process prints: lines out of any bytes, and a limit for those that flood."""

import asyncio
import time
from collections.abc import Callable

import msgspec

from robo.text.terminal import escaped_json

BUFFER = 262_144
"""How much is read at once, and held by a pipe, bytes."""

_LONGEST_LINE = 16_384
"""A longer line comes in pieces, bytes."""
_PARTIAL = 0.3
"""How long the beginning of a line waits for its end, s."""
_TOLD_WITHIN = 1.0
"""How long a flood goes on before it is said how much of it was left out, s."""
_BREATH = 0.005
"""How long what floods is left to itself between two reads, s: reading it must not cost the run a core."""


class Lines:
    """Cuts bytes into lines of text, whatever their encoding and however long they are."""

    def __init__(self) -> None:
        self._rest = b""

    @property
    def partial(self) -> bool:
        """Whether the beginning of a line waits for its end."""
        return bool(self._rest)

    def feed(self, chunk: bytes) -> list[str]:
        """The lines that are complete now."""
        *lines, self._rest = (self._rest + chunk).split(b"\n")
        if len(self._rest) > _LONGEST_LINE:
            lines += self.flush_bytes()
        return [_text(line[i : i + _LONGEST_LINE]) for line in lines for i in range(0, len(line) or 1, _LONGEST_LINE)]

    def flush(self) -> list[str]:
        """What there is of an unfinished line."""
        return [_text(line) for line in self.flush_bytes()]

    def flush_bytes(self) -> list[bytes]:
        """What there is of an unfinished line, as it came."""
        rest, self._rest = self._rest, b""
        return [rest] if rest else []


class Budget:
    """How much one process may print: so many bytes of log file a second, with a reserve for bursts."""

    PER_SECOND = 256 * 1024
    RESERVE = 2 * 1024 * 1024
    LINE = 100
    """What a line costs besides its text, bytes."""

    def __init__(self, now: float) -> None:
        self._left = float(self.RESERVE)
        self._spent = False
        self._at = now

    def take(self, chunk: bytes, now: float) -> int:
        """How many bytes of a chunk there is enough left for, whole lines where it has any; they are spent."""
        self._left = min(self.RESERVE, self._left + (now - self._at) * self.PER_SECOND)
        self._at = now
        # Once it is spent, a second's worth is saved first: better some lines together than single ones.
        if self._spent and self._left < self.PER_SECOND:
            return 0
        cost = self._cost(chunk)
        self._spent = cost > self._left
        passes = len(chunk)
        if self._spent:
            fits = int(passes * self._left / cost)
            passes = chunk.rfind(b"\n", 0, fits) + 1 or fits
            cost = self._cost(chunk[:passes])
        self._left = max(0.0, self._left - cost)
        return passes

    def _cost(self, chunk: bytes) -> int:
        """What a log file takes for it: JSON writes six bytes for a control character."""
        written = escaped_json(msgspec.json.encode(chunk.decode("utf-8", "replace")).decode())
        return len(written.encode()) + self.LINE * (chunk.count(b"\n") + 1)


class _Skipped:
    """What is left out of the output, until it is told."""

    def __init__(self) -> None:
        self.size = self._lines = 0
        self._since = 0.0
        self._ends_line = True

    def add(self, chunk: bytes, now: float) -> None:
        if not self.size:
            self._since = now
        self.size += len(chunk)
        self._lines += chunk.count(b"\n")
        self._ends_line = chunk.endswith(b"\n")

    def rest_of_line(self, chunk: bytes) -> int:
        """How many bytes at the beginning of a chunk belong to a line whose beginning was left out."""
        return chunk.find(b"\n") + 1 if self.size and not self._ends_line else 0

    def is_old(self, now: float) -> bool:
        return self.size > 0 and now - self._since >= _TOLD_WITHIN

    def told(self) -> list[str]:
        """What is to be said of it, if anything; then it is said."""
        size, lines = self.size, self._lines
        self.size = self._lines = 0
        if not size:
            return []
        what = (
            f"{lines:,} line{'s' * (lines != 1)} ({size / 1e6:.1f} MB)" if lines else f"{size / 1e6:.1f} MB of a line"
        )
        return [f"… {what} left out: it prints too much"]


async def pump(stream: asyncio.StreamReader, on_line: Callable[[str], None], budget: Budget) -> None:
    """Pass on what a stream brings, line by line, until its end.

    What is over the budget is read and left out, so that neither the process nor anybody else waits; how
    much it was is said in its place, in a flood once a second.
    """
    lines = Lines()
    skipped = _Skipped()
    while True:
        try:
            async with asyncio.timeout(_PARTIAL if lines.partial or skipped.size else None):
                chunk = await stream.read(BUFFER)
        except TimeoutError:
            for text in (*lines.flush(), *skipped.told()):
                on_line(text)
            continue
        if not chunk:
            for text in (*lines.flush(), *skipped.told()):
                on_line(text)
            return
        now = time.monotonic()
        begin = skipped.rest_of_line(chunk)
        if begin:
            skipped.add(chunk[:begin], now)
        passes = begin + budget.take(chunk[begin:], now) if begin < len(chunk) else begin
        if passes > begin or skipped.is_old(now):
            for text in skipped.told():
                on_line(text)
        for text in lines.feed(chunk[begin:passes]):
            on_line(text)
        if passes < len(chunk):
            for text in lines.flush():
                on_line(text)
            skipped.add(chunk[passes:], now)
            await asyncio.sleep(_BREATH)


def _text(line: bytes) -> str:
    return line.decode("utf-8", "replace").rstrip("\r")
