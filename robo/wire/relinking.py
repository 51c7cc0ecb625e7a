"""What a client asks is asked again where its link was lost meanwhile.

Who is held up for longer than a link bears, the client, the router or the machine, has it cut and made anew at once.
Zenoh ends what was asked by it as though nobody knew an answer, and so it does with what is asked until it is back.
Where it was the router, all others link to it anew as well, and who is back before them is answered by nobody.
"""

import threading
import time
from collections.abc import Callable, Sized
from typing import TypeVar

import zenoh

from robo.wire.session import is_client

Answers = TypeVar("Answers", bound=Sized)

_SETTLES = 0.05
"""How long the news of a loss may come after the end of what was asked, s."""


def over_losses(session: zenoh.Session, ask: Callable[[], Answers], timeout: float) -> Answers:
    """What is answered to a question over a link that was there from its beginning to its end.

    Args:
        session: by which it is asked; where it is none of a client's that was opened here, it is asked once.
        ask: asks, and returns what was answered.
        timeout: how long to wait for a link that is lost, s.

    Returns:
        Where the link does not come back in time, or came back and nobody has answered since, what was answered last.
    """
    if not is_client(session):
        return ask()
    link = _Link()
    at_once = zenoh.handlers.Callback(link.notice, indirect=False)
    with session.info.declare_link_events_listener(at_once, history=True):
        answers, came_back = ask(), False
        end = time.monotonic() + timeout
        while True:
            if link.was_lost(0.0 if answers else _SETTLES):
                came_back = link.is_back(end - time.monotonic())
                if not came_back:
                    return answers
            elif answers or not came_back or time.monotonic() >= end:
                return answers
            answers = ask()


class _Link:
    """A client's only one, from now on."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._is_there = False
        self._is_lost = False

    def notice(self, event: zenoh.LinkEvent) -> None:
        """Take note that it has come, or gone; on a thread of Zenoh's."""
        with self._changed:
            self._is_there = event.kind == zenoh.SampleKind.PUT
            self._is_lost |= not self._is_there
            self._changed.notify_all()

    def was_lost(self, within: float) -> bool:
        """Whether it is not there, or was not since it `is_back`; one hears of it within this time, s."""
        with self._changed:
            return self._changed.wait_for(lambda: self._is_lost or not self._is_there, within)

    def is_back(self, timeout: float) -> bool:
        """Whether it is there within this time, s. What was lost before counts no more."""
        with self._changed:
            self._is_lost = False
            return timeout > 0.0 and self._changed.wait_for(lambda: self._is_there, timeout)
