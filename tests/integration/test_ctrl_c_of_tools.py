"""A tool that waits without end does not miss a Ctrl-C, whenever it comes.

One that wakes no lock is heard when Python looks for signals; one that strikes a wait as it begins is a Ctrl-C as well.
"""

import signal
import sys
import threading
from collections.abc import Callable, Generator
from contextlib import closing
from types import CodeType

import pytest
import zenoh

from robo import Node, action
from robo.cli.reach import Reach
from robo.cli.views.action import send_goal
from robo.process.endings import raised_by_signals
from robo.samples.publishing import Audience
from robo.samples.stream import Stream
from robo.tools import actions
from robo_messages import Fibonacci
from tests.interrupts import strike, wait_and_be_struck
from tests.support import PATIENCE, eventually

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
    with pytest.raises(KeyboardInterrupt), raised_by_signals():
        wait()
    interrupting.join()


def test_who_waits_for_a_message_hears_it(session: zenoh.Session) -> None:
    with closing(Stream(session, ["nobody/says"])) as stream:
        is_interrupted(stream.get, Stream.get.__code__)


def test_who_waits_for_a_subscriber_hears_it(session: zenoh.Session) -> None:
    with closing(Audience(session, ["nobody/hears"])) as audience:
        is_interrupted(audience.wait, Audience.wait.__code__)


def test_who_waits_for_a_message_hears_one_that_strikes_as_the_wait_begins(session: zenoh.Session) -> None:
    with closing(Stream(session, ["nobody/says"])) as stream:
        strike(stream._changed)
        with pytest.raises(KeyboardInterrupt), raised_by_signals():
            stream.get()


class Counts(Node):
    @action("fibonacci", rate=50.0)
    def fibonacci(self, goal: Fibonacci.Goal) -> Generator[Fibonacci.Feedback | None, None, Fibonacci.Result]:
        for _ in range(goal.order):
            yield None
        return Fibonacci.Result([goal.order])


def test_a_goal_is_canceled_by_a_ctrl_c_that_strikes_as_the_wait_begins(
    session: zenoh.Session, endpoint: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    wait = actions.Sending.wait

    def waits(self: actions.Sending, timeout: float | None) -> actions.Outcome:
        monkeypatch.setattr(actions.Sending, "wait", wait)
        del timeout
        wait_and_be_struck()
        return wait(self, PATIENCE)

    monkeypatch.setattr(actions.Sending, "wait", waits)
    with Counts(namespace="r1", session=session):
        reach = Reach.of([endpoint])
        code = send_goal("r1/fibonacci", ["{order: 100000}"], reach, feedback=False, wait=True, timeout=None, json=True)
    assert code == 1
    assert '"status":"CANCELED"' in capsys.readouterr().out
