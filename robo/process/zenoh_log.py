"""What Zenoh writes about refusals, which it does on this process's standard output alone: read, counted, told.

Standard output becomes a pipe of this process's own. It is read without a pause, for what cannot be written holds up
Zenoh's threads, and so all that passes through the router.
"""

import fcntl
import os
import sys
import threading
import time
from collections.abc import Callable, Iterable
from itertools import islice

import zenoh

from robo.security.refusals import INTERESTING, LOG_FILTER, Reader, Tally

_PIECE = 1 << 18
"""Bytes that are read at once."""
_BATCH = 0.01
"""How long what comes is left in the pipe, s: it holds what a router says in three times as long, at its quickest."""
_MOST_LINES = 300
"""Lines of one piece that are looked at; a flood of refusals is not counted to the last one."""
_MARK = b"robo has read up to "
"""How a line begins by which this process sees how far it has read."""


class ZenohLog:
    """What Zenoh writes, read as it comes. Once for a process, made before its first session."""

    def __init__(self, tell: Callable[[str], None]) -> None:
        """`tell` takes a sentence for the router's owner, on a thread of its own."""
        self.tally, self.reader = Tally(), Reader()
        """What was refused so far, which goes on counting, and what reads it."""
        self._tell = tell
        self._marking = threading.Lock()
        self._mark = self._passed = 0
        """The last marks that were written and read."""
        self._progress = threading.Condition()
        sys.stdout.flush()
        ours, self._theirs = os.pipe()
        if hasattr(fcntl, "F_SETPIPE_SZ"):
            fcntl.fcntl(self._theirs, fcntl.F_SETPIPE_SZ, 1 << 20)
        os.dup2(self._theirs, sys.__stdout__.fileno() if sys.__stdout__ is not None else 1)
        os.environ.pop("RUST_LOG", None)  # what is written down is what is read here
        zenoh.init_log_from_env_or(LOG_FILTER)
        threading.Thread(target=self._read, args=(ours,), name="robo-refusals", daemon=True).start()

    def catch_up(self, timeout: float) -> bool:
        """Wait until all is read and counted that was written before.

        Args:
            timeout: how long at most, s.

        Returns:
            Whether it is.
        """
        with self._marking:  # not the other lock: what reads needs that to go on, and a full pipe waits for it
            self._mark += 1
            mark = self._mark
            os.write(self._theirs, b"%s%d;\n" % (_MARK, mark))
        with self._progress:
            return self._progress.wait_for(lambda: self._passed >= mark, timeout)

    def _read(self, ours: int) -> None:
        rest = b""
        while piece := os.read(ours, _PIECE):
            if len(piece) < _PIECE:
                time.sleep(_BATCH)  # else this thread would be woken for each message that passes
            whole, end, rest = (rest + piece).rpartition(b"\n")
            if not end:
                continue
            if any(word in whole for word in INTERESTING):
                self._count(line for line in whole.split(b"\n") if any(word in line for word in INTERESTING))
            if _MARK in whole:
                with self._progress:
                    self._passed = int(whole.rpartition(_MARK)[2].partition(b";")[0])
                    self._progress.notify_all()

    def _count(self, lines: Iterable[bytes]) -> None:
        for line in islice(lines, _MOST_LINES):
            refusal = self.reader.read(line.decode(errors="replace"))
            sentence = self.tally.add(refusal, time.monotonic(), time.time_ns()) if refusal is not None else None
            if sentence is not None:
                self._tell(sentence)
