"""Finding the processes of a run wherever they have gone, and ending them.

Every process of a launch carries its run's id in the environment, which children inherit even where they
leave their parent's group and session.
"""

import ctypes
import os
import re
import signal
import sys
import time
from collections.abc import Callable, Collection, Container, Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from robo.environment import OWNER_VARIABLE, RUN_VARIABLE
from robo.machine.ancestry import descendants
from robo.wire.run_id import supervisor_lives

if TYPE_CHECKING:
    import psutil  # which a start does without: it would take a tenth of it

PATIENCE = (0.5, 0.25, 0.5)
"""How long to wait after INT, TERM and KILL, s. All of it is less than 2 s."""

_SUBREAPER = 36  # PR_SET_CHILD_SUBREAPER, linux/prctl.h


_FORKED = {"robo.process.node", "robo.process.shared"}
"""Stand in the command line of a node, or of several, and of what these have forked; the last word is its full name."""


class Left(NamedTuple):
    """A process that somebody has left behind, and that was ended."""

    pid: int
    node: str
    """Whose it was: the full name of a process of the run; empty where nothing tells."""
    command: str
    """Its command line."""

    def sentence(self, label: str) -> str:
        """What is told of it; `label` is what is said for its node."""
        return f"ended process {self.pid}, which {label or 'a node'} had left behind: {self.command}"

    @classmethod
    def read(cls, sentence: str) -> "Left | None":
        """What a sentence tells of, with the label for the node; None where it tells of something else."""
        found = _SENTENCE.fullmatch(sentence)
        return cls(int(found[1]), found[2], found[3]) if found is not None else None


_SENTENCE = re.compile(r"ended process (\d+), which (.+?) had left behind: (.*)", re.DOTALL)


def processes_of(run: str) -> list[int]:
    """The ids of the processes that carry a run's id, this one left out."""
    return [pid for pid, found in _marked() if found == run]


def leftovers() -> list[int]:
    """The ids of processes of runs whose supervisor is gone."""
    return [pid for pid, run in _marked() if not supervisor_lives(run)]


def sweep(run: str, spare: Collection[int] = (), *, also: Collection[int] = (), adopted: bool = False) -> list[Left]:
    """End every process of a run: INT, TERM, KILL.

    Args:
        run: its id.
        spare: process ids that are left alone.
        also: process ids of the run; they and their descendants are ended with or without the run's id.
        adopted: also those descendants of this process that do not carry the id any more.

    Returns:
        Those that were there.
    """
    known = [p for pid in also for p in _family(pid)]

    def find() -> list[int]:
        found = {*processes_of(run), *(p.pid for p in known if p.is_running())}
        if adopted:
            found |= {p.pid for p in _family(os.getpid())} - {os.getpid()}
        return [pid for pid in found if pid not in spare]

    return _end(find)


def end_leftovers() -> list[int]:
    """End what earlier runs have left behind, and return the process ids."""
    return [one.pid for one in _end(leftovers)]


def left_in_group(leader: int) -> list[Left]:
    """Who is still there of the process group of a process that has ended."""
    try:
        os.killpg(leader, 0)
    except OSError:  # nobody: so it is nearly always
        return []
    return [_described(process) for process in _alive([pid for pid in _pids() if _group_of(pid) == leader])]


def adopt_orphans() -> None:
    """Become the parent of what descendants leave behind (Linux): it stays findable, and can be reaped."""
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(_SUBREAPER, 1, 0, 0, 0)


def reap(own: Container[int]) -> None:
    """Collect adopted processes that have ended, so that they do not stay zombies.

    Args:
        own: process ids that somebody else waits for.
    """
    while sys.platform == "linux":  # nowhere else are any adopted
        try:
            ended = os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG | os.WNOWAIT)
        except ChildProcessError:
            return
        if ended is None or ended.si_pid in own:
            return
        os.waitpid(ended.si_pid, os.WNOHANG)


def _end(find: Callable[[], list[int]]) -> list[Left]:
    import psutil

    first: list[Left] = []
    for number, patience in zip((signal.SIGINT, signal.SIGTERM, signal.SIGKILL), PATIENCE, strict=True):
        found = list(_alive(find()))
        first = first or [_described(process) for process in found]
        for process in found:
            try:
                process.send_signal(number)
                process.send_signal(signal.SIGCONT)
            except psutil.Error:
                continue
        if not found:
            break
        wait_for_ends(found, patience)
    return first


def wait_for_ends(processes: "Collection[psutil.Process]", patience: float) -> None:
    """Wait until all have ended, but no longer than so long, s."""
    import psutil

    end = time.monotonic() + patience
    for process in processes:
        # Where many threads begin, the number of one that has ended is soon a thread's of another program. Of that,
        # psutil (7.2) passes on what the system says: there is no such process.
        with suppress(psutil.Error, OSError):
            process.wait(max(end - time.monotonic(), 0.0))


def _described(process: "psutil.Process") -> Left:
    import psutil

    words: list[str] = []
    owner = ""
    with suppress(psutil.Error):
        words = process.cmdline()
        owner = process.environ().get(OWNER_VARIABLE, "")
    if not owner and not _FORKED.isdisjoint(words):  # of what was forked the environment is shown as its template's
        owner = words[-1]
    return Left(process.pid, owner, " ".join(words))


def _group_of(pid: int) -> int | None:
    try:
        return os.getpgid(pid)
    except OSError:
        return None


def _family(pid: int) -> "list[psutil.Process]":
    """A process and its descendants."""
    import psutil

    found = []
    for one in (pid, *descendants(pid)):
        with suppress(psutil.Error):
            found.append(psutil.Process(one))
    return found


def _alive(pids: Collection[int]) -> "Iterator[psutil.Process]":
    import psutil

    for pid in pids:
        try:
            process = psutil.Process(pid)
            if process.status() != psutil.STATUS_ZOMBIE:
                yield process
        except psutil.Error:
            continue


def _marked() -> Iterator[tuple[int, str]]:
    """The ids of all processes with a run's id, and the run's."""
    for pid in _pids():
        run = _run_of(pid) if pid != os.getpid() else None
        if run:
            yield pid, run


def _pids() -> list[int]:
    if sys.platform != "linux":
        import psutil

        return psutil.pids()
    return [int(name) for name in os.listdir("/proc") if name.isdecimal()]


def _run_of(pid: int) -> str | None:
    if sys.platform != "linux":
        import psutil

        try:
            return psutil.Process(pid).environ().get(RUN_VARIABLE)
        except (psutil.Error, OSError):
            return None
    try:  # psutil would take apart every variable of every process
        environment = Path(f"/proc/{pid}/environ").read_bytes()
    except OSError:
        return None  # gone, or somebody else's
    for variable in environment.split(b"\0"):
        if variable.startswith(RUN_VARIABLE.encode() + b"="):
            return variable.partition(b"=")[2].decode(errors="replace")
    return None
