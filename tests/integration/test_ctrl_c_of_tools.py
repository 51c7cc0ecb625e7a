"""A tool that waits without end does not miss a Ctrl-C that wakes no lock: Python runs its handler when it looks."""

import signal
import sys
import threading
from collections.abc import Callable
from contextlib import closing
from types import CodeType

import pytest
import zenoh

from robo.samples.publishing import Audience
from robo.samples.stream import Stream
from tests.support import eventually

pytestmark = pytest.mark.timeout(30)


def is_interrupted(wait: Callable[[], object], code: CodeType) -> None:
    """Begin to wait, for ever, and see it end by a signal that another thread gets, as the system may choose any."""
    main = threading.main_thread().ident
    assert main is not None

    def waits() -> bool:
        caller = sys._current_frames()[main].f_back
        return caller is not None and caller.f_code is code

    def interrupt() -> None:
        eventually(waits, "it waits")
        signal.pthread_kill(threading.get_ident(), signal.SIGINT)

    interrupting = threading.Thread(target=interrupt)
    interrupting.start()
    with pytest.raises(KeyboardInterrupt):
        wait()
    interrupting.join()


def test_who_waits_for_a_message_hears_it(session: zenoh.Session) -> None:
    with closing(Stream(session, ["nobody/says"])) as stream:
        is_interrupted(stream.get, Stream.get.__code__)


def test_who_waits_for_a_subscriber_hears_it(session: zenoh.Session) -> None:
    with closing(Audience(session, ["nobody/hears"])) as audience:
        is_interrupted(audience.wait, Audience.wait.__code__)
