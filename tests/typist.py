"""Somebody at the keys of a terminal in which a program runs, as a job of a shell."""

import fcntl
import os
import pty
import select
import struct
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import psutil

from tests.support import PATIENCE

SHELL = """\
import fcntl, os, signal, sys, termios

fcntl.ioctl(0, termios.TIOCSCTTY, 0)
job = os.fork()
if not job:
    os.setpgid(0, 0)
    signal.signal(signal.SIGTTOU, signal.SIG_IGN)
    os.tcsetpgrp(0, os.getpid())
    signal.signal(signal.SIGTTOU, signal.SIG_DFL)
    os.execv(sys.argv[1], sys.argv[1:])
signal.signal(signal.SIGHUP, signal.SIG_IGN)
sys.exit(os.waitstatus_to_exitcode(os.waitpid(job, 0)[1]))
"""
"""What a shell does to run one job in the foreground of its terminal, whose keys then send signals to it."""


class Typist:
    """A terminal with a program in it."""

    def __init__(
        self, words: Sequence[str], environment: Mapping[str, str], columns: int, cwd: Path | None = None
    ) -> None:
        """
        Args:
            words: the program's, after `python`.
            environment: the program's.
            columns: of the terminal.
            cwd: the program's folder.
        """
        self._leader, self._follower = pty.openpty()  # the latter is kept: the terminal's mode goes with the last
        fcntl.ioctl(self._follower, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
        self.mode = termios.tcgetattr(self._follower)
        self.shell = subprocess.Popen(
            [sys.executable, "-c", SHELL, sys.executable, *words],
            stdin=self._follower, stdout=self._follower, stderr=self._follower, start_new_session=True, cwd=cwd,
            env={**environment, "TERM": "xterm"},
        )  # fmt: skip
        self._changed = threading.Condition()
        self._data = b""
        self._over = threading.Event()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        while not self._over.is_set():
            if select.select([self._leader], [], [], 0.05)[0]:
                with suppress(OSError):
                    data = os.read(self._leader, 65536)
                    with self._changed:
                        self._data += data
                        self._changed.notify_all()

    @property
    def program(self) -> psutil.Process:
        """The program's process."""
        (found,) = psutil.Process(self.shell.pid).children()
        return found

    @property
    def output(self) -> str:
        """All that has been written."""
        return self._data.decode(errors="replace").replace("\r\n", "\n")

    def wait_until(self, seen: Callable[[], object]) -> None:
        """Wait until what is written is as it should be."""
        assert self.comes_to(seen, PATIENCE), self.output[-3000:]

    def comes_to(self, seen: Callable[[], object], within: float) -> bool:
        """Whether what is written comes to be as it should be in time, s."""
        with self._changed:
            return self._changed.wait_for(lambda: bool(seen()), within)

    def has_ended(self, within: float) -> bool:
        """Whether the program ends in time, s."""
        with suppress(subprocess.TimeoutExpired):
            self.shell.wait(within)
        return self.shell.returncode is not None

    def type(self, keys: bytes) -> float:
        """Hit keys. Returns when, s since the epoch."""
        os.write(self._leader, keys)
        return time.time()

    def has_its_mode_back(self) -> bool:
        """Whether the terminal is as it was before."""
        return termios.tcgetattr(self._follower) == self.mode

    def hang_up(self) -> None:
        """Close the terminal."""
        self._over.set()
        self._reader.join()
        os.close(self._follower)
        os.close(self._leader)
        self._leader = -1

    def close(self) -> None:
        """End what still runs, and close the terminal."""
        if self.shell.poll() is None:
            with suppress(psutil.Error):  # it has just ended
                for process in psutil.Process(self.shell.pid).children(recursive=True):
                    process.kill()
        self.shell.wait(PATIENCE)
        if self._leader >= 0:
            self.hang_up()
