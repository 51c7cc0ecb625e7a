"""How a process that is told to end hears of it."""

import _thread
import os
import signal
from collections.abc import Callable

ENDING = (signal.SIGINT, signal.SIGTERM)


def on_end(act: Callable[[], object]) -> None:
    """From now on, call `act` beside the main thread on each SIGINT and SIGTERM.

    Python runs the handler of a signal in the main thread, when that comes to it. One that is just about to wait for a
    lock does not: where the signal comes after the last look and before the wait, and a busy machine makes that long,
    it waits on, forever. Nor may a handler take a lock that the main thread may hold. So handlers do nothing here:
    the system writes the number of each signal into a pipe at once, and a thread of its own reads that.
    """
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    for number in ENDING:
        signal.signal(number, lambda *_: None)
    _thread.start_new_thread(_listen, (reading, act))  # it keeps no process from its end


def _listen(reading: int, act: Callable[[], object]) -> None:
    while numbers := os.read(reading, 64):
        for number in numbers:
            if number in ENDING:
                _thread.start_new_thread(act, ())  # one that takes its time keeps the next one from nothing
