"""Nothing outlives its launch: a small process that ends what a killed supervisor leaves behind.

It is forked at the start and waits at the end of a pipe: when the supervisor goes without having
dismissed it, it ends all that belongs to the run.
"""

import os
import shutil
import signal
import time
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import NoReturn

from robo.machine import limit_groups
from robo.machine.cgroup import ControlGroup, own_folders
from robo.machine.limit_groups import LimitGroups
from robo.machine.orphans import sweep


class Watchdog:
    """Watches over one run, from a forked process: this one must have a single thread."""

    def __init__(self, run: str, folder: Path) -> None:
        """
        Args:
            run: its id.
            folder: of temporary files, which go with it.
        """
        self._group = ControlGroup.make(run)
        own = own_folders()
        reader, self._writer = os.pipe()
        self.pid = os.fork()
        if self.pid == 0:
            os.close(self._writer)
            _watch(reader, run, folder, self._group, own)
        os.close(reader)
        # The watchdog stays outside.
        self._inside = self._group is not None and self._group.enter()
        self.limit_groups = LimitGroups(run, self._group if self._inside else None, self.pid, own)
        """What limits processes of the run."""

    def take_in(self, pid: int) -> None:
        """A process that was started before is of the run as well, with all that it starts."""
        if self._group is not None and self._inside:
            self._group.take(pid)

    def note(self, pid: int, running: bool) -> None:
        """A process of the run has been started, or has ended: one that drops its environment is known all the same."""
        with suppress(OSError):
            os.write(self._writer, b"%c%d\n" % (b"+" if running else b"-", pid))

    def dismiss(self) -> None:
        """The run has ended as it should."""
        if self._group is not None and self._inside:
            self._group.leave()
        os.write(self._writer, b".\n")
        os.close(self._writer)
        os.waitpid(self.pid, 0)


def _watch(reader: int, run: str, folder: Path, group: ControlGroup | None, own: Mapping[str, Path]) -> NoReturn:
    try:
        os.setsid()  # a terminal's Ctrl-C, or its end, is for the supervisor
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_IGN)
        # What else the supervisor has open would seem to live on in this process.
        os.closerange(3, reader)
        os.closerange(reader + 1, 1024)
        nothing = os.open(os.devnull, os.O_RDWR)
        for stream in (0, 1, 2):  # whoever reads the supervisor's output waits for no one else
            os.dup2(nothing, stream)
        noted: set[int] = set()
        with ExitStack() as ends:  # the last one first, and each whatever goes wrong before it: nobody else does it
            ends.callback(_remove_groups, run, group, own)
            if not _is_dismissed(reader, noted):
                ends.callback(shutil.rmtree, folder, ignore_errors=True)
                if group is not None:
                    ends.callback(group.kill)
                sweep(run, also=noted)
    finally:
        os._exit(0)


def _remove_groups(run: str, group: ControlGroup | None, own: Mapping[str, Path]) -> None:
    for _ in range(100):
        if limit_groups.remove(run, own) and (group is None or group.remove()):
            return
        time.sleep(0.01)  # what was killed takes a moment to go


def _is_dismissed(reader: int, noted: set[int]) -> bool:
    """Wait for the end of the supervisor, and note its processes. Returns whether it ended as it should."""
    with os.fdopen(reader, "rb") as lines:
        for line in lines:
            if line == b".\n":
                return True
            (noted.add if line[:1] == b"+" else noted.discard)(int(line[1:]))
    return False
