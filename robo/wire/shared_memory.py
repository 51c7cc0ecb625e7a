"""Shared memory for large messages: whether this process may use it, and the memory itself.

Zenoh has shared memory of its own accord too, which copies each large payload once more and ends its threads where
`/dev/shm` is full (zenoh 1.10). So robo turns that off, and asks for the memory itself, where it has looked before
whether there is enough of it. Whoever has none, or is on another host, gets the same payload through its socket.

What is written here lies in memory that cannot be swapped out, at both ends: the right to have that is needed too.
"""

import os
from typing import TYPE_CHECKING

import zenoh

from robo.environment import SHARED_MEMORY_VARIABLE
from robo.wire.shared_room import FOLDER, MOST, free_bytes

if TYPE_CHECKING:
    from robo.wire.shared_buffers import SharedMemory

_OF_A_SESSION = 2**20
"""Without so much no session takes part in shared memory, bytes: Zenoh itself needs some, to read too."""
_LEAST_LOCKABLE = 2 * MOST
"""Who may lock less memory reads nothing through shared memory: a publisher's memory that does not fit in is lost."""
_CAP_IPC_LOCK = 14


def hindrance() -> str:
    """Why large messages cannot go through shared memory in this process, in words; empty where they can."""
    if not os.path.isdir(FOLDER):
        return ""  # another system's, which has it elsewhere
    if not os.access(FOLDER, os.W_OK):
        return f"{FOLDER} cannot be written"
    if (free := free_bytes()) < _OF_A_SESSION:
        return f"{FOLDER} has {free / 2**20:.0f} MB free"
    if (lockable := _lockable()) < _LEAST_LOCKABLE:
        return f"this user may lock {lockable / 2**20:.0f} MB of memory (ulimit -l), not {_LEAST_LOCKABLE / 2**20:.0f}"
    return ""


def _lockable() -> int:
    """How much memory this process may keep from being swapped out, bytes."""
    import resource  # not on all systems

    limit = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    if limit == resource.RLIM_INFINITY:
        return 2**62
    try:
        with open("/proc/self/status", encoding="ascii", errors="replace") as file:
            lines = dict(line.split(":", 1) for line in file if ":" in line)
        if int(lines["CapEff"], 16) >> _CAP_IPC_LOCK & 1:
            return 2**62
    except (OSError, ValueError, KeyError):
        pass
    return limit


_why_not: dict[str, str] = {}
"""By a session's id: why its publishers use none; empty where they do."""
_of_process: "SharedMemory | None" = None


def use(session: zenoh.Session, *, directly: bool) -> None:
    """Let a session's publishers use shared memory, where that is on and the session links to others directly."""
    why_not = "" if directly else "it reaches others through a router"
    if os.environ.get(SHARED_MEMORY_VARIABLE) == "off":
        why_not = f"{SHARED_MEMORY_VARIABLE}=off"
    _why_not[str(session.info.zid())] = why_not


def of_session(session: zenoh.Session) -> "SharedMemory | None":
    """What publishers of a session put large messages into; None where they are not to."""
    global _of_process
    if _why_not.get(str(session.info.zid()), "nobody has opened it") != "":
        return None
    if _of_process is None:
        from robo.wire.shared_buffers import SharedMemory  # who sends nothing large carries nothing of it

        _of_process = SharedMemory(hindrance())
    return _of_process


def way_of(session: zenoh.Session) -> str:
    """How a session's large messages travel to others on this machine, in words."""
    problem = _why_not.get(str(session.info.zid()), "") or (_of_process.problem if _of_process else hindrance())
    return f"sockets: {problem}" if problem else "shared memory"
