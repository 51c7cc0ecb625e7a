"""What a process prints: lines out of any bytes, and a limit for those that flood."""

import asyncio
import time
from collections.abc import Callable

_LONGEST_LINE = 16_384
_PARTIAL = 0.3
"""How long the beginning of a line waits for its end, s."""


_BREATH = 0.005
"""How long what floods is left to itself between two reads, s: reading it must not cost the run a core."""

BUFFER = 262_144
"""How much is read at once, and held by a pipe, bytes."""


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
    """How much one process may print: so many bytes a second, with a reserve for bursts."""

    PER_SECOND = 256 * 1024
    RESERVE = 2 * 1024 * 1024
    LINE = 100
    """What a line costs besides its bytes."""

    def __init__(self, now: float) -> None:
        self._left = float(self.RESERVE)
        self._spent = False
        self._at = now

    def take(self, chunk: bytes, now: float) -> bool:
        """Whether there is enough left for a chunk; then it is spent."""
        self._left = min(self.RESERVE, self._left + (now - self._at) * self.PER_SECOND)
        self._at = now
        cost = len(chunk) + self.LINE * chunk.count(b"\n")
        # Once it is spent, a second's worth is saved first: better some lines together than single ones.
        if cost > self._left or (self._spent and self._left < max(cost, self.PER_SECOND)):
            self._spent = True
            return False
        self._spent = False
        self._left -= cost
        return True


async def pump(stream: asyncio.StreamReader, on_line: Callable[[str], None], budget: Budget) -> None:
    """Pass on what a stream brings, line by line, until its end.

    What is over the budget is read and left out, so that neither the process nor anybody else waits; how
    much it was is said in its place.
    """
    lines = Lines()
    left_out = skipped_lines = 0
    while True:
        try:
            async with asyncio.timeout(_PARTIAL if lines.partial or left_out else None):
                chunk = await stream.read(BUFFER)
        except TimeoutError:
            for text in lines.flush():
                on_line(text)
            if left_out:
                on_line(_left_out(left_out, skipped_lines))
                left_out = skipped_lines = 0
            continue
        if chunk and not budget.take(chunk, time.monotonic()):
            if not left_out:
                for text in lines.flush():
                    on_line(text)
            left_out += len(chunk)
            skipped_lines += chunk.count(b"\n")
            await asyncio.sleep(_BREATH)
            continue
        if left_out:
            on_line(_left_out(left_out, skipped_lines))
            left_out = skipped_lines = 0
        for text in lines.feed(chunk) if chunk else lines.flush():
            on_line(text)
        if not chunk:
            return


def _left_out(size: int, lines: int) -> str:
    return f"… {lines:,} lines ({size / 1e6:.1f} MB) left out: it prints too much"


def _text(line: bytes) -> str:
    return line.decode("utf-8", "replace").rstrip("\r")
