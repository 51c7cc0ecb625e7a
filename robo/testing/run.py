"""A run of a test: `robo up` as a process, in the test's own folder and at a port of its own."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import sysconfig
import time
from collections import defaultdict, deque
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path

from robo.environment import LOG_FOLDER_VARIABLE
from robo.errors import RunError
from robo.machine.log_files import SUPERVISOR
from robo.machine.orphans import Left
from robo.tools import logs
from robo.wire.tcp import HeldPort

STOP_TIMEOUT = 20.0
"""How long a run may take to end, s: what its processes are granted, and then some."""

_LOOK = 0.02
"""How often one looks at what it has printed, s."""

_SHOWN = 10
"""How many lines of each node are shown."""


class LaunchFailed(AssertionError):
    """A robot of a test did not start, or did not end, as it should."""


class Run:
    """`robo up` of one manifest."""

    def __init__(self, manifest: str, robot: str, words: Sequence[str], folder: Path, workspace: Path) -> None:
        """
        Args:
            manifest: which one, as a command line names it.
            robot: what the robot is called.
            words: what else the command line says.
            folder: for its output and its logs.
            workspace: where it is started.
        """
        self.manifest = manifest
        self.robot = robot
        self.was_awaited = False
        """Whether it has ended and the test wanted that."""
        self._port = HeldPort()
        self.endpoint = f"tcp/127.0.0.1:{self._port.number}"
        self._logs = folder / "logs"
        self._output = folder / "output.txt"
        up = ["-m", "robo", "up", manifest, *words, "--robot-name", robot, "--listen", self.endpoint]
        leash = [sys.executable, "-m", "robo.machine.leash", str(os.getpid()), sys.executable]
        with ExitStack() as held, self._output.open("wb") as output:
            held.callback(self._port.close)
            self._process = subprocess.Popen(
                [*leash, *up],
                cwd=workspace,
                env=clean_environment() | {LOG_FOLDER_VARIABLE: str(self._logs)},
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
            )
            held.pop_all()  # until the end of the run

    def wait_until_over(self, timeout: float) -> int:
        """Wait until it ends by itself; returns its exit code.

        Raises:
            LaunchFailed: it goes on.
        """
        try:
            code = self._process.wait(timeout)
        except subprocess.TimeoutExpired:
            raise LaunchFailed(f"{self.manifest}: the run still goes on after {timeout:g} s") from None
        self.was_awaited = True
        return code

    def is_over(self) -> bool:
        """Whether it has ended."""
        return self._process.poll() is not None

    def wait_until_reached(self, timeout: float) -> None:
        """Wait until its router listens.

        Raises:
            LaunchFailed: it ends before, or does not come.
        """
        end = time.monotonic() + timeout
        while not _answers(self._port.number):
            if self.is_over():
                code = self._process.returncode
                raise LaunchFailed(f"{self.manifest} did not start: exit code {code}\n{self.printed()}")
            if time.monotonic() > end:
                raise LaunchFailed(f"{self.manifest}: nothing listens within {timeout:g} s\n{self.printed()}")
            time.sleep(0.01)

    def wait_for_line(self, text: str, timeout: float) -> str:
        """The first line that it has printed, or prints, with a text in it."""
        end = time.monotonic() + timeout
        while True:
            last_look = self.is_over() or time.monotonic() > end
            line = next((line for line in self.printed().splitlines() if text in line), None)
            if line is not None:
                return line
            if last_look:
                raise AssertionError(f"no line of the run holds {text!r}, within {timeout:g} s or before its end")
            time.sleep(_LOOK)

    def printed(self) -> str:
        """All that it has printed."""
        return self._output.read_text(errors="replace").rstrip()

    def last_lines(self) -> str:
        """The last lines of each of its nodes, or all that was printed where there are none."""
        try:
            run = logs.find_run(self.robot, None, self._logs)
        except RunError:
            return self.printed()
        kept: dict[str, deque[str]] = defaultdict(lambda: deque(maxlen=_SHOWN))
        for record in logs.read(run, set()):
            stamp = time.strftime("%H:%M:%S", time.localtime(record.time / 1e9))
            words = [f"  {stamp}.{record.time // 1_000_000 % 1000:03d}", record.level or "", record.message]
            kept[record.node].append(" ".join(filter(None, words)))
        silent = [f"{label}: no line" for label in run.labels if label not in kept]
        return "\n".join([*(line for label, lines in sorted(kept.items()) for line in (f"{label}:", *lines)), *silent])

    def left_behind(self) -> list[Left]:
        """What its supervisor had to end of that which nodes had started; with labels for nodes."""
        try:
            run = logs.find_run(self.robot, None, self._logs)
        except RunError:
            return []
        told = (Left.read(record.message) for record in logs.read(run, {SUPERVISOR}))
        return [one for one in told if one is not None]

    def end(self) -> str:
        """End it, as `robo down` does. Returns what was wrong with that; empty where all is well."""
        self._signal(signal.SIGTERM)
        try:
            self._process.wait(STOP_TIMEOUT)
        except subprocess.TimeoutExpired:
            self._signal(signal.SIGKILL)
            self._process.wait(STOP_TIMEOUT)
            return f"the run did not end within {STOP_TIMEOUT:g} s, and was killed"
        finally:
            self._port.close()
        return ""

    def _signal(self, number: signal.Signals) -> None:
        if self._process.poll() is None:
            with suppress(ProcessLookupError):
                self._process.send_signal(number)


def words_of(arguments: Mapping[str, object]) -> list[str]:
    """Arguments of a manifest as words of a command line: `use_sim:=true`."""
    return [f"{name}:={_text(value)}" for name, value in arguments.items()]


def _text(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def clean_environment() -> dict[str, str]:
    """This process's environment without what is said to robo in it; modules are found where the test finds them."""
    own = {name: value for name, value in os.environ.items() if not name.startswith("ROBO_")}
    installed = tuple(sysconfig.get_path(which) for which in ("stdlib", "platstdlib", "purelib", "platlib"))
    beside = [path for path in sys.path if path and not path.startswith(installed)]
    return own | {"PYTHONPATH": os.pathsep.join(beside)}


def _answers(port: int) -> bool:
    try:
        socket.create_connection(("127.0.0.1", port), timeout=1.0).close()
    except OSError:
        return False
    return True
