"""The id of a run: it tells which process the run's supervisor is, so that others see whether it lives."""

import os
import sys
import time


def new_run_id() -> str:
    """`<time><random>-<pid>-<start of this process>-<its pid namespace>`.

    Ids sort as the runs have begun, as far as clocks agree: of two that begin at once, one is the earlier.
    """
    begin = time.time_ns() // 1_000_000
    return f"{begin:011x}{os.urandom(3).hex()}-{os.getpid()}-{_begin_of(os.getpid())}-{_pid_namespace()}"


def supervisor_lives(run: str, *, unknown: bool = True) -> bool:
    """Whether the supervisor of a run still runs; `unknown` where this machine cannot know, as of another container."""
    _, _, rest = run.partition("-")
    pid, _, rest = rest.partition("-")
    begin, _, namespace = rest.partition("-")
    if not pid.isdecimal() or namespace != _pid_namespace():
        return unknown
    return _begin_of(int(pid)) == begin


def _begin_of(pid: int) -> str | None:
    """When a process was started, in this machine's own units; None where it does not run."""
    if sys.platform != "linux":
        import psutil

        try:
            return f"{psutil.Process(pid).create_time():.2f}"
        except psutil.Error:
            return None
    try:
        # After the name in parentheses, which may hold anything; see proc(5) for the fields.
        with open(f"/proc/{pid}/stat", encoding="utf-8", errors="replace") as file:
            fields = file.read().rpartition(")")[2].split()
    except OSError:
        return None
    return None if fields[0] == "Z" else fields[19]


def _pid_namespace() -> str:
    """Which processes a process id counts among: another container's mean nothing here."""
    try:
        return os.readlink("/proc/self/ns/pid").strip("pid:[]")
    except OSError:
        return "0"
