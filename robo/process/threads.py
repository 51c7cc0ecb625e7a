"""Whose a thread is, where several nodes share a process: it belongs to whom the thread belongs that has started it."""

import threading
import time
import weakref
from collections.abc import Hashable

_PER_THREAD_CLOCK = 6
"""The kind of Linux's clocks of processor time, of one thread by its id; see `MAKE_THREAD_CPUCLOCK` in the kernel."""

_OF_ALL = {"robo-asyncio", "robo-sleep"}
"""The names of threads that serve all nodes of a process, whoever has started them (`robo.node.async_loop`)."""

_owners: "weakref.WeakKeyDictionary[threading.Thread, Hashable]" = weakref.WeakKeyDictionary()
_of_python = threading.Thread.start


def follow() -> None:
    """From now on, note of each thread whose it is."""

    def start(thread: threading.Thread) -> None:
        owner = _owners.get(threading.current_thread())
        if owner is not None and thread.name not in _OF_ALL:
            _owners.setdefault(thread, owner)
        _of_python(thread)

    setattr(threading.Thread, "start", start)  # noqa: B010 (mypy takes no assignment to a method)


def give(thread: threading.Thread, owner: Hashable) -> None:
    """Say whose a thread is that has not been started."""
    _owners[thread] = owner


def owner_of(thread: threading.Thread | None) -> Hashable | None:
    """Whose a thread is; None for one of the whole process."""
    return _owners.get(thread) if thread is not None else None


def of(owner: Hashable) -> list[threading.Thread]:
    """The threads of an owner that run."""
    return [thread for thread in threading.enumerate() if _owners.get(thread) == owner]


class Used:
    """The processor time that the threads of one owner have used, those included that have ended."""

    def __init__(self, owner: Hashable) -> None:
        self._owner = owner
        self._running: dict[int, float] = {}
        """By the system's id of a thread, its time when last looked at, s."""
        self._ended = 0.0

    def total(self) -> float | None:
        """So far, s; None where the system does not tell it."""
        found: dict[int, float] = {}
        for thread in of(self._owner):
            number = thread.native_id
            if number is None:
                continue
            try:
                # By its number and not by `pthread_getcpuclockid`, which crashes for a thread that has just ended.
                found[number] = time.clock_gettime((~number << 3) | _PER_THREAD_CLOCK)
            except OSError:
                continue
            except AttributeError:  # not on this system
                return None
        # A number that is used again begins anew, and what it had before is not lost.
        self._ended += sum(t for number, t in self._running.items() if found.get(number, 0.0) < t)
        self._running = found
        return self._ended + sum(found.values())
