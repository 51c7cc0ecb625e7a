"""What a node that no supervisor runs has logged last: nobody else keeps it."""

import logging
import time
from collections import deque
from contextlib import nullcontext

from robo.node.log import ConsoleFormatter
from robo.text.levels import level_name
from robo.wire.reports import LastWords, LogRecord

MOST = 500
"""Lines."""
_LONGEST = 2_000
"""Of a line, characters; what is longer is cut."""


class LastLines(logging.Handler):
    """Keeps the lines of a node's records, as a supervisor keeps those of its processes."""

    def __init__(self, node: str) -> None:
        """`node` is its full name."""
        super().__init__()
        self._node = node.strip("/")
        self._kept: deque[LogRecord] = deque(maxlen=MOST)
        self._newest = 0
        self.setFormatter(ConsoleFormatter(supervised=True, colour=False))

    def emit(self, record: logging.LogRecord) -> None:
        """Keep a record; the lines below its first one, a traceback, have no level."""
        level = level_name(record.levelno)
        try:
            first, *more = self.format(record).split("\n")
        except Exception:
            self.handleError(record)
            return
        # Each record has a time of its own: by it somebody knows what is new.
        self._newest = max(int(record.created * 1e9), self._newest + 1)
        self._keep(first.removeprefix(f"{level:5} "), level)
        for line in more:
            self._keep(line, None)

    def after(self, since: int) -> LastWords:
        """What is kept and was logged after a time, ns since the epoch, the oldest first."""
        with self.lock or nullcontext():  # all of a record or nothing
            return LastWords(time.time_ns(), [line for line in self._kept if line.time > since])

    def _keep(self, line: str, level: str | None) -> None:
        self._kept.append(LogRecord(time=self._newest, node=self._node, message=line[:_LONGEST], level=level))
