"""What a test has left behind: threads, sessions, processes."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

import psutil
import zenoh

from robo.process.endings import end_process
from robo.wire import session

GRACE = 1.0
"""How long threads and processes that are ending may take, s."""


_given_up: list[threading.Thread] = []
"""Threads that tests have left behind and that were told of."""


class Leak(AssertionError):
    """A test has left something behind."""


class Before:
    """What was there before a test."""

    def __init__(self) -> None:
        self._threads = set(threading.enumerate())
        self._sessions = set(map(id, session.opened()))
        self._children = _children()

    def check(self) -> None:
        """End what the test has left behind, as far as that can be done, and name it.

        Raises:
            Leak: there was something.
        """
        end = time.monotonic() + GRACE
        while self._threads_left() or self._children_left():
            if time.monotonic() > end:
                break
            time.sleep(0.002)
        left = [*self._name_threads(), *self._end_sessions(), *self._kill_children()]
        if left:
            raise Leak("\n".join(["the test has left behind", *(f"  {one}" for one in left)]))

    def _threads_left(self) -> list[threading.Thread]:
        there = [thread for thread in threading.enumerate() if thread not in self._threads]
        # Threads of Zenoh's and of other extensions, which Python merely has seen, are not the test's to end.
        return [thread for thread in there if not isinstance(thread, threading._DummyThread)]

    def _name_threads(self) -> Iterable[str]:
        frames = sys._current_frames()
        for thread in self._threads_left():
            _given_up.append(thread)
            frame = frames.get(thread.ident or 0)
            place = f", at {frame.f_code.co_filename}:{frame.f_lineno} in {frame.f_code.co_name}" if frame else ""
            yield f"the thread {thread.name}{place}"

    def _end_sessions(self) -> Iterable[str]:
        for one in [one for one in session.opened() if id(one) not in self._sessions]:
            yield f"a session, {_name_of(one)}, that nobody has closed"
            session.close_session(one)

    def _children_left(self) -> set[int]:
        return {pid for pid in _children() - self._children if _is_alive(pid)}

    def _kill_children(self) -> Iterable[str]:
        for pid in self._children_left():
            with suppress(psutil.Error):
                process = psutil.Process(pid)
                for one in [*process.children(recursive=True), process]:
                    yield f"the process {one.pid}: {' '.join(one.cmdline())}"
                    with suppress(psutil.Error):
                        one.kill()
                process.wait(GRACE)


def end_run(exit_code: int) -> None:
    """End this process where a thread that a test has left behind would keep Python from doing so."""
    stuck = [thread for thread in _given_up if thread.is_alive() and not thread.daemon]
    if stuck:
        names = ", ".join(thread.name for thread in stuck)
        print(f"robo: still running, and given up: the thread {names}", file=sys.stderr)
        end_process(exit_code)


def _name_of(one: zenoh.Session) -> str:
    with suppress(zenoh.ZError):
        return str(one.zid())
    return "closed"


def _children() -> set[int]:
    """The children of this process. Linux says it at once; elsewhere all processes have to be looked at."""
    tasks = Path("/proc/self/task")
    try:
        return {int(pid) for task in os.listdir(tasks) for pid in (tasks / task / "children").read_bytes().split()}
    except OSError:  # also where a thread has just ended
        return {child.pid for child in psutil.Process().children()}


def _is_alive(pid: int) -> bool:
    with suppress(psutil.Error):
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    return False
