"""How a process ends in which threads may still be in Zenoh."""

import atexit
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NoReturn


@contextmanager
def raised_by_signals() -> Iterator[None]:
    """Within it, what the handler of a signal has raised comes out as just that.

    Raised in a `Condition.wait` that has let go of its lock, and not yet begun to wait, it leaves the `with` around the
    wait without a lock to let go of: what comes out of it is a RuntimeError. Waits for events and queues end in one.
    """
    try:
        yield
    except RuntimeError as error:
        if isinstance(error.__context__, KeyboardInterrupt | SystemExit):
            raise error.__context__ from None
        raise


def leave(code: int) -> NoReturn:
    """End with an exit code. A Ctrl-C that comes now changes nothing any more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_threads(code)
    sys.exit(code)


def end_with_threads(code: int) -> None:
    """End at once where a daemon thread is left: one that reads from Zenoh, a user's, a callback that hangs.

    Python must not take its interpreter down beside it: a thread that is just coming back from Zenoh's Rust
    code would abort the process.
    """
    if any(thread.daemon for thread in threading.enumerate()):
        atexit.unregister(end_with_threads)
        end_process(code)


def end_process(code: int) -> NoReturn:
    """End at once, after what others want to be done at exit."""
    try:
        atexit._run_exitfuncs()
        sys.stdout.flush()
        sys.stderr.flush()
    finally:
        os._exit(code)
