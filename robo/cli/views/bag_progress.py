"""How far a verb is that goes through a recording; and how errors name what mends a file."""

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from robo.bag.progress import Tell
from robo.cli.printing import amount
from robo.errors import DamagedBag
from robo.text.terminal import own

_FIRST = 0.5
"""What takes no longer tells nothing, s."""
_PERIOD = 0.2
"""How often it is told, s."""


@contextmanager
def progress(doing: str) -> Iterator[Tell]:
    """What tells how far something is, on a line of the terminal that is written anew and goes away at its end.

    Args:
        doing: what is done: `reading drive.mcap`.
    """
    line = _Line(doing)
    try:
        with _mended():
            yield line.tell
    finally:
        line.end()


@contextmanager
def _mended() -> Iterator[None]:
    """Say of a damaged file what makes a whole one of it."""
    try:
        yield
    except DamagedBag as fault:
        if not fault.offset or "robo bag recover" in fault.reason:
            raise
        advice = f"`robo bag recover {fault.path} -o WHOLE` makes a whole file of what can be read"
        raise DamagedBag(f"{fault.reason}; {advice}", fault.path, fault.offset, cut=fault.cut) from None


class _Line:
    def __init__(self, doing: str) -> None:
        self._doing = doing
        self._live = sys.stderr.isatty()
        self._due = time.monotonic() + _FIRST
        self._shown = False

    def tell(self, done: int, total: int) -> None:
        if not self._live or (now := time.monotonic()) < self._due:
            return
        self._due = now + _PERIOD
        self._shown = True
        far = f"{min(done / total, 1.0):.0%}" if total else amount(done, "message")
        sys.stderr.write(f"{own(chr(13) + chr(27) + '[K')}{self._doing}: {far}; Ctrl-C ends")
        sys.stderr.flush()

    def end(self) -> None:
        if self._shown:
            sys.stderr.write(own("\r\x1b[K"))
            sys.stderr.flush()
