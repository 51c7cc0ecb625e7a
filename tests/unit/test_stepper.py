"""Letting the threads of nodes run one at a time."""

import threading

from robo.testing.stepper import Inbox, Stepper
from tests.support import PATIENCE


def test_what_comes_for_a_thread_that_has_just_been_started_is_waited_for() -> None:
    stepper = Stepper(PATIENCE)
    inbox = Inbox(stepper)
    taken: list[object] = []

    def read() -> None:
        while (item := inbox.take()) is not None:
            taken.append(item)

    reader = threading.Thread(target=read, daemon=True)
    stepper.post(inbox, "a message")
    late = threading.Timer(0.05, reader.start)
    late.start()
    stepper.settle()
    assert taken == ["a message"]
    inbox.close()
    late.join(PATIENCE)
    reader.join(PATIENCE)
    assert not reader.is_alive()
