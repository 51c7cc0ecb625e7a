"""How a process that is told to end hears of it."""

import _thread
import signal
from collections.abc import Callable
from types import FrameType


def on_end(act: Callable[[], object]) -> None:
    """From now on, call `act` beside the main thread on each SIGINT and SIGTERM.

    Python runs the handler of a signal in the main thread, wherever that is, also within a lock. An `act` that wants
    the same lock would wait for its own thread, forever: setting an event deadlocks where the main thread just begins
    to wait for it.
    """

    def handle(_number: int, _frame: FrameType | None) -> None:
        _thread.start_new_thread(act, ())  # `threading` takes a lock to start one

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, handle)
