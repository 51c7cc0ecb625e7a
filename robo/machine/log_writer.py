"""Writing the output of a run to its files for as long as that works, and again when it works again."""

import errno
import os
import time
from collections import deque
from collections.abc import Callable

import msgspec

from robo.environment import LOG_RUN_LIMIT_VARIABLE
from robo.machine.log_files import KEPT_FILES, SUPERVISOR, LogFiles
from robo.wire.reports import LogRecord

FIRST_TRY, LAST_TRY = 0.5, 10.0
"""After how many seconds files that could not be written are tried again: twice as long each time, up to the last."""

_LEAST_ROOM = 1_000_000
"""A disk that was full is tried again when it has so much room, bytes: else it would be full again at once."""

_HEALTHY = 60.0
"""After how many seconds of writing earlier trouble is forgotten, s."""
_LOOK_PERIOD = 1.0
"""How often it is looked whether the files are still there, s."""
_MOST_PENDING = 1_000
"""Lines that are kept before the files are begun."""


class Outage(msgspec.Struct):
    """A time in which no files are written."""

    begin: float
    """By the wall clock, s since the epoch."""
    why: str
    lost: int
    """Lines that are in no file."""
    next_try: float
    """By the monotonic clock, s."""
    number: int | None = None
    """The last error's, as in `errno`."""
    node: str = ""
    """Whose line it was that could not be written; empty where it was none's."""

    @property
    def since(self) -> str:
        """When it began, for people."""
        return time.strftime("%H:%M:%S", time.localtime(self.begin))


class LogWriter:
    """Adds lines to log files. A full disk or a folder that is removed costs lines, which are counted, and no more."""

    def __init__(
        self, files: LogFiles, tell: Callable[[LogRecord], None], clock: Callable[[], float] = time.monotonic
    ) -> None:
        """
        Args:
            files: to be written.
            tell: is told once when they cannot be written, and once when they can again.
            clock: monotonic, s.
        """
        self._files = files
        self._tell = tell
        self._clock = clock
        self._begun = False
        self._pending: deque[LogRecord] = deque(maxlen=_MOST_PENDING)
        self._outage: Outage | None = None
        self._delay = FIRST_TRY
        self._mended_at = self._looked_at = clock()
        self._set_aside = -1

    @property
    def problem(self) -> str:
        """Why lines are in no file just now; empty where they are."""
        outage = self._outage
        if outage is None:
            return ""
        return f"no log files are written since {outage.since}, {_lines(outage.lost)} so far: {outage.why}"

    def begin(self) -> None:
        """Begin the files, with the lines that have come already."""
        self._begun = True
        try:
            self._files.begin()
        except OSError as error:
            self._fail(error, 0)
        while self._pending:
            self.write(self._pending.popleft())

    def write(self, line: LogRecord) -> None:
        """Add a line; where that does not work, it is counted."""
        if not self._begun:
            self._pending.append(line)
        elif self._outage is not None:
            self._outage.lost += 1
        else:
            try:
                self._files.write(line)
            except OSError as error:
                self._fail(error, 1, line.node)

    def look(self) -> None:
        """Try again what did not work, and see whether the files are still where they were; to be called often."""
        now = self._clock()
        if self._outage is not None:
            if now >= self._outage.next_try:
                self._try_again()
        elif self._begun and now - self._looked_at >= _LOOK_PERIOD:
            self._looked_at = now
            for node in self._files.dropped():
                kept = f"the newest {KEPT_FILES * self._files.largest / 1e6:.3g} MB are kept ({LOG_RUN_LIMIT_VARIABLE})"
                self._tell(_record(f"the log of {node} is full: its oldest lines go from now on, {kept}"))
            lost = self._files.lost()
            if lost is not None:
                self._outage = Outage(time.time(), "the files or their folder were removed", lost, now)
                self._try_again()
                self._tell_of_outage()

    def wants_room(self) -> bool:
        """Whether others' files may have to go: at the beginning, and each time one was set aside."""
        before, self._set_aside = self._set_aside, self._files.set_aside
        return self._set_aside != before

    def close(self) -> None:
        """Close the files; what is missing in them is noted there, if that works now."""
        if self._outage is not None:
            self._outage.node = ""  # the note may be possible where that one's lines still are not
            self._try_again()
        self._files.close()

    def _fail(self, error: OSError, lost: int, node: str = "") -> None:
        now = self._clock()
        if now - self._mended_at > _HEALTHY:
            self._delay = FIRST_TRY
        self._files.close()
        self._outage = Outage(time.time(), _words(error), lost, now + self._delay, error.errno, node)
        self._tell_of_outage()

    def _tell_of_outage(self) -> None:
        if self._outage is not None:
            self._tell(_record(f"no log files are written: {self._outage.why}; it is tried again"))

    def _try_again(self) -> None:
        assert self._outage is not None
        found = self._outage
        line = _record(f"log files are written again; {_lines(found.lost)} since {found.since}: {found.why}")
        try:
            self._files.close()
            if found.number == errno.ENOSPC and self._files.room() < _LEAST_ROOM:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            self._files.begin()
            if found.node:  # others' files may work all the time, and say nothing of it
                self._files.open(found.node)
            self._files.write(line)
        except OSError as error:
            self._delay = min(2 * self._delay, LAST_TRY)
            found.why, found.number, found.next_try = _words(error), error.errno, self._clock() + self._delay
            return
        self._outage = None
        self._mended_at = self._clock()
        self._tell(line)


def _record(text: str) -> LogRecord:
    return LogRecord(time=time.time_ns(), node=SUPERVISOR, message=text, level="WARN")


def _lines(lost: int) -> str:
    return "1 line is missing" if lost == 1 else f"{lost:,} lines are missing"


def _words(error: OSError) -> str:
    where = f": {error.filename}" if error.filename else ""
    return f"{error.strerror or error}{where}"
