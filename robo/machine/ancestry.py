"""Who has started whom, how long a process has been running, and whether it is about to go.

It is what a system that hides most of /proc still tells: under systemd's `ProcSubset=pid` the file `/proc/stat` is
missing, without which psutil (7.2) does not know when a process was started, nor who its children are.
"""

import os
import signal
import sys
import time

_PF_EXITING = 0x4  # linux/sched.h


def ancestors(pid: int) -> list[int]:
    """The process that has started a process, and so on, as far as they are there."""
    found: list[int] = []
    while (parent := _parent_of(found[-1] if found else pid)) and parent not in found:
        found.append(parent)
    return found


def descendants(pid: int) -> list[int]:
    """The processes that a process has started, and those that these have."""
    if sys.platform != "linux":
        import psutil

        try:
            return [child.pid for child in psutil.Process(pid).children(recursive=True)]
        except psutil.Error:
            return []
    started: dict[int, list[int]] = {}
    for name in os.listdir("/proc"):
        if name.isdecimal() and (parent := _parent_of(int(name))) is not None:
            started.setdefault(parent, []).append(int(name))
    found: list[int] = []
    unseen = [pid]
    while unseen:
        more = started.get(unseen.pop(), [])
        found += more
        unseen += more
    return found


def age(pid: int) -> float:
    """How long a process has been running, s.

    Raises:
        OSError: it is gone.
    """
    if sys.platform != "linux":
        import psutil

        try:
            return time.time() - psutil.Process(pid).create_time()
        except psutil.Error as error:
            raise ProcessLookupError(str(error)) from None
    # Ticks since the machine has started, asleep or not: see proc(5).
    begin = int(_fields(pid)[19]) / os.sysconf("SC_CLK_TCK")
    return time.clock_gettime(time.CLOCK_BOOTTIME) - begin


def is_exiting(pid: int) -> bool:
    """Whether a process is ending, or was killed, and is not gone yet; False where the system does not tell.

    That may last: on a machine that gives it no turn, or while a driver holds it.
    """
    if sys.platform != "linux":
        import psutil

        try:
            return psutil.Process(pid).status() == psutil.STATUS_ZOMBIE
        except psutil.Error:
            return False
    try:
        fields = _fields(pid)
    except OSError:
        return False
    state, flags, pending = fields[0], int(fields[6]), int(fields[28])
    return state == "Z" or bool(flags & _PF_EXITING) or bool(pending & 1 << (signal.SIGKILL - 1))


def _parent_of(pid: int) -> int | None:
    if sys.platform != "linux":
        import psutil

        try:
            return psutil.Process(pid).ppid()
        except psutil.Error:
            return None
    try:
        return int(_fields(pid)[1])
    except OSError:
        return None  # gone


def _fields(pid: int) -> list[str]:
    """What `/proc/PID/stat` says after the name in parentheses, which may hold anything: the state comes first."""
    with open(f"/proc/{pid}/stat", encoding="utf-8", errors="replace") as file:
        return file.read().rpartition(")")[2].split()
