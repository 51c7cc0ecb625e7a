"""What a process may use at most, and how it is told that it has ended by that.

Control groups hold it all, for whatever the process starts too. Where none can be made, memory is looked at a few
times a second, and a process that has more than its limit is killed: RLIMIT_AS would count the address space, of which
Zenoh and threads reserve much and use little. That nothing grows without bound between two looks is seen to by
RLIMIT_DATA, which counts what may be written, used or not, and is set far above the limit. Open files have a limit of
the system's own everywhere.
"""

import os
import signal
import sys
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TypeVar

from robo.launch.plan import LimitsPlan
from robo.machine.ancestry import descendants
from robo.machine.limit_groups import LimitGroup, LimitGroups
from robo.text.sizes import in_short

T = TypeVar("T")

_HEADROOM = 256 << 20
"""What a process may reserve beyond twice its limit without using it: stacks of threads, arenas; bytes."""
_NO_MEMORY = ("MemoryError", "memory allocation of", "Cannot allocate memory", "bad_alloc")
_NO_FILES = ("Too many open files", "EMFILE")


class Hold:
    """The limits of one process, from its start to its end."""

    def __init__(
        self, pid: int, limits: LimitsPlan, group: LimitGroup | None, used: Callable[[int], int] | None = None
    ) -> None:
        """Set them.

        Args:
            pid: of the process, which has just started.
            limits: at least one.
            group: its control group; None where there is none.
            used: tells how much memory a process uses, bytes.
        """
        self._pid = pid
        self._limits = limits
        self._used = used or used_memory
        self._found = ""
        lacking = ["memory", "cpu"] if group is None else group.limit(limits)
        if group is not None and not _with_descendants(pid, group.take):
            lacking = ["memory", "cpu"]
        self._group = group if "memory" not in lacking else None
        self._kills = self._group.memory_kills() if self._group is not None else 0
        wishes = []
        if limits.cpu is not None and "cpu" in lacking:
            wishes.append(f"cpu {limits.cpu:g}: no control group can be made here")
        if limits.memory is not None and self._group is None:
            _with_descendants(pid, partial(_limit, "DATA", 2 * limits.memory + _HEADROOM))
        if limits.files is not None:
            why = _with_descendants(pid, partial(_limit, "NOFILE", limits.files))
            wishes += [f"files {limits.files}: {why}"] if why else []
        self.lacking = "; ".join(wishes)
        """What it runs without, and why; empty where it has all limits."""

    def look(self) -> bool:
        """Whether it has more memory than it may, and is to be killed; to be called often."""
        most = self._limits.memory
        if most is None or self._group is not None:
            return False
        used = self._used(self._pid)
        if used <= most:
            return False
        self._found = f": it used {in_short(used)} of memory, and its limit is {in_short(most)}"
        return True

    def blame(self, code: int, last_lines: Iterable[str]) -> str:
        """What is said of an end that comes of a limit; empty where it does not.

        Args:
            code: its exit code, negative for a signal.
            last_lines: what it has printed last.
        """
        memory, files = self._limits.memory, self._limits.files
        if code == 0:
            return ""
        if memory is not None and self._found and code == -signal.SIGKILL:
            return self._found
        if memory is not None and self._group is not None and self._group.memory_kills() > self._kills:
            return f": it needed more memory than its limit of {in_short(memory)}"
        text = "\n".join(last_lines)
        if memory is not None and any(word in text for word in _NO_MEMORY):
            return f": it got no more memory, and its limit is {in_short(memory)}"
        if files is not None and any(word in text for word in _NO_FILES):
            return f": it had as many files open as its limit of {files} allows"
        return ""


class Limiter:
    """Sets the limits of a run's processes."""

    def __init__(self, groups: LimitGroups) -> None:
        self._groups = groups

    def hold(self, pid: int, name: str, limits: LimitsPlan) -> Hold:
        """Set the limits of a process that has just started; `name` is its full name."""
        wanted = limits.memory is not None or limits.cpu is not None
        return Hold(pid, limits, self._groups.of(name) if wanted else None)


def _with_descendants(pid: int, do: Callable[[int], T]) -> T:
    """Do something to a process, and to what it has started before that was done. Returns what came of it for it."""
    found = do(pid)
    seen = {pid}
    while more := {*descendants(pid)} - seen:
        for one in more:
            do(one)
        seen |= more
    return found


def used_memory(pid: int) -> int:
    """The memory of a process, and of what it has started, that is its own, bytes: shared memory is left out."""
    if sys.platform != "linux":
        import psutil

        try:
            return int(psutil.Process(pid).memory_info().rss)
        except psutil.Error:
            return 0
    pages, unseen = 0, [pid]
    while unseen:
        one = unseen.pop()
        with suppress(OSError):  # it has just ended
            _, resident, shared, *_ = map(int, Path(f"/proc/{one}/statm").read_text().split())
            pages += resident - shared
            for thread in os.listdir(f"/proc/{one}/task"):
                unseen += map(int, Path(f"/proc/{one}/task/{thread}/children").read_text().split())
    return pages * os.sysconf("SC_PAGE_SIZE")


def _limit(what: str, most: int, pid: int) -> str:
    """Set a limit of the system's own; returns why that is not possible."""
    if sys.platform != "linux":
        return "this system limits no other process"
    import resource

    try:
        resource.prlimit(pid, getattr(resource, f"RLIMIT_{what}"), (most, most))
    except ProcessLookupError:
        return ""
    except (OSError, ValueError) as error:
        return str(error)
    return ""
