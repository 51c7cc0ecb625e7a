"""Whose threads are, and what they use, where several nodes share a process."""

import sys
import threading

import pytest

from robo.process import threads
from tests.support import PATIENCE, eventually


@pytest.fixture(autouse=True)
def _followed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threading.Thread, "start", threading.Thread.start)  # it is undone at the end
    threads.follow()


def test_a_thread_belongs_to_whom_the_thread_belongs_that_has_started_it() -> None:
    go = threading.Event()
    made: list[threading.Thread] = []

    def start(name: str) -> None:
        made.append(threading.Thread(target=go.wait, args=(PATIENCE,), name=name))
        made[-1].start()

    def begin() -> None:
        start("worker")
        start("robo-asyncio")

    first = threading.Thread(target=begin)
    threads.give(first, "a")
    first.start()
    first.join(PATIENCE)
    start("mine")
    worker, loop, mine = made
    assert (threads.owner_of(worker), threads.owner_of(loop), threads.owner_of(mine)) == ("a", None, None)
    assert threads.of("a") == [worker]
    assert threads.owner_of(None) is None
    go.set()
    for thread in made:
        thread.join(PATIENCE)
    assert threads.of("a") == []


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has clocks of single threads")
def test_processor_time_counts_for_whom_a_thread_belongs_and_is_kept_when_it_ends() -> None:
    stop = threading.Event()

    def burn() -> None:
        while not stop.is_set():
            pass

    busy, idle = threading.Thread(target=burn), threading.Thread(target=stop.wait, args=(PATIENCE,))
    threads.give(busy, "busy")
    threads.give(idle, "idle")
    used, unused = threads.Used("busy"), threads.Used("idle")
    busy.start()
    idle.start()
    eventually(lambda: (used.total() or 0.0) > 0.05, "some processor time")
    so_far = used.total()
    stop.set()
    for thread in (busy, idle):
        thread.join(PATIENCE)
    assert so_far is not None
    assert (used.total() or 0.0) >= so_far, "it is not forgotten"
    assert (unused.total() or 0.0) < 0.05
