"""Nothing outlives its launch: a small process that ends what a killed supervisor leaves behind.

Every process of a launch carries its run's id in the environment, which children inherit even where they
leave their parent's group and session. The watchdog waits at the end of a pipe: when the supervisor
goes without having dismissed it, it ends all processes with that id.
"""

import os
import shutil
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import NoReturn

import psutil

RUN_VARIABLE = "ROBO_RUN"


class Watchdog:
    """Watches over one run, from a forked process: this one must have a single thread."""

    def __init__(self, run: str, folder: Path) -> None:
        """
        Args:
            run: its id.
            folder: of temporary files, which go with it.
        """
        reader, self._writer = os.pipe()
        self._pid = os.fork()
        if self._pid == 0:
            os.close(self._writer)
            _watch(reader, run, folder)
        os.close(reader)

    def dismiss(self) -> None:
        """The run has ended as it should."""
        os.write(self._writer, b".")
        os.close(self._writer)
        os.waitpid(self._pid, 0)


def _watch(reader: int, run: str, folder: Path) -> NoReturn:
    try:
        os.setsid()  # a terminal's Ctrl-C, or its end, is for the supervisor
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_IGN)
        nothing = os.open(os.devnull, os.O_RDWR)
        for stream in (0, 1, 2):  # whoever reads the supervisor's output waits for no one else
            os.dup2(nothing, stream)
        if not os.read(reader, 1):
            sweep(run)
            shutil.rmtree(folder, ignore_errors=True)
    finally:
        os._exit(0)


def processes_of(run: str) -> Iterator[psutil.Process]:
    """The processes that carry a run's id, this one left out."""
    for process in psutil.process_iter():
        try:
            if process.pid != os.getpid() and process.environ().get(RUN_VARIABLE) == run:
                yield process
        except (psutil.Error, OSError):
            continue  # gone, or somebody else's


def sweep(run: str) -> list[int]:
    """End every process that carries a run's id: INT, TERM, KILL.

    Returns:
        The process ids of those that were there.
    """
    first: list[int] = []
    for number, patience in ((signal.SIGINT, 1.0), (signal.SIGTERM, 1.0), (signal.SIGKILL, 2.0)):
        found = list(processes_of(run))
        first = first or [process.pid for process in found]
        for process in found:
            try:
                process.send_signal(number)
            except psutil.Error:
                continue
        psutil.wait_procs(found, timeout=patience)
        if not found:
            break
    return first
