"""The messages that a tool waits for, and the Ctrl-C that it does not miss meanwhile."""

import signal
import sys
import threading

import pytest
import zenoh

from robo.samples.stream import Stream
from tests.support import eventually


@pytest.mark.timeout(30)
def test_ctrl_c_that_does_not_wake_the_lock_is_heard(session: zenoh.Session) -> None:
    stream = Stream(session, ["nobody/says"])
    main = threading.main_thread().ident
    assert main is not None

    def waits() -> bool:
        caller = sys._current_frames()[main].f_back
        return caller is not None and caller.f_code is Stream.get.__code__

    def interrupt() -> None:
        eventually(waits, "the stream is waited for")
        signal.pthread_kill(threading.get_ident(), signal.SIGINT)  # as the system may choose any thread

    interrupting = threading.Thread(target=interrupt)
    interrupting.start()
    with pytest.raises(KeyboardInterrupt):
        stream.get()
    interrupting.join()
    stream.close()
