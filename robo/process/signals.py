"""How a process that is told to end hears of it."""

import _thread
import os
import signal
from collections.abc import Callable
from types import FrameType

ENDING = (signal.SIGINT, signal.SIGTERM)


def on_end(act: Callable[[], object]) -> None:
    """From now on, call `act` beside the main thread on each SIGINT and SIGTERM.

    Python runs the handler of a signal in the main thread, when that comes to it. One that is just about to wait for a
    lock does not: where the signal comes after the last look and before the wait, and a busy machine makes that long,
    it waits on, forever. So the system also writes the number of each signal into a pipe at once, and a thread of its
    own reads that. Who comes first acts; the other one remains for where somebody else wants that pipe's place. Neither
    takes a lock, which the main thread may hold.
    """
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    signals = _Signals(act)
    for number in ENDING:
        signal.signal(number, signals.handled)
    _thread.start_new_thread(signals.listen, (reading,))  # it keeps no process from its end


class _Signals:
    """Counts what it is told in both ways, so that it acts once for each signal."""

    def __init__(self, act: Callable[[], object]) -> None:
        self._act = act
        self._handled = self._read = 0
        self._first: dict[int, object] = {}
        """Who came first to each signal."""

    def handled(self, _number: int, _frame: FrameType | None) -> None:
        """The main thread has come to it."""
        self._handled += 1
        self._hear(self._handled)

    def listen(self, reading: int) -> None:
        """Read what the system writes."""
        while numbers := os.read(reading, 64):
            for number in numbers:
                if number in ENDING:
                    self._read += 1
                    self._hear(self._read)

    def _hear(self, count: int) -> None:
        me = object()
        if self._first.setdefault(count, me) is me:  # in one step: the other thread may come at the same moment
            _thread.start_new_thread(self._act, ())  # one that takes its time keeps the next one from nothing
