"""Command lines that tests type, and what they print; and waiting for what no event tells of.

What is not about a command line has its helper elsewhere: `robo.testing` runs nodes and robots, `tests.plain` is a
client that knows nothing of robo, `tests.processes` plays processes for the parts of a supervisor, and `tests.conftest`
has free ports and linked sessions.
"""

import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import psutil
import pytest
import zenoh

PATIENCE = 40.0
"""How long an event may take on a machine that is busy with other things, s. Only what fails waits that long."""


def lines_of_its_own(output: str) -> list[str]:
    """What a run says, but for the remains of others that it has cleared away: other tests kill supervisors."""
    return [line for line in output.splitlines() if "had left behind" not in line]


def eventually(condition: Callable[[], bool], what: str, timeout: float = PATIENCE) -> None:
    """Wait until something is true that no event tells of."""
    end = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < end, f"not within {timeout} s: {what}"
        time.sleep(0.005)


def is_heard(publisher: zenoh.Publisher) -> bool:
    """Whether somebody listens. What Zenoh's stub calls a bool is an object, and true whatever it says."""
    status: Any = publisher.matching_status
    return bool(status.matching)


def plain_environment() -> dict[str, str]:
    """This process's environment without what is said to robo in it, but for where robots of tests meet."""
    return {key: value for key, value in os.environ.items() if not key.startswith("ROBO_") or key == "ROBO_MEETING"}


class Running:
    """A command that runs beside the test; its output is collected by a thread.

    Args:
        command: its words.
        cwd: where it runs.
        env: its environment.
        terminal: whether it runs in a terminal of its own.
    """

    def __init__(
        self, command: Sequence[str], *, cwd: str | None = None, env: Mapping[str, str], terminal: bool = False
    ) -> None:
        ours, theirs = os.openpty() if terminal else os.pipe()
        self.process = subprocess.Popen(
            command,
            stdin=theirs if terminal else None,
            stdout=theirs,
            stderr=subprocess.STDOUT,
            cwd=cwd,
            env=env,
            start_new_session=terminal,
        )
        os.close(theirs)
        self._out = open(ours, errors="replace")  # noqa: SIM115 (closed with the command)
        self._terminal = terminal
        self._changed = threading.Condition()
        self._lines: list[str] = []
        self._over = False
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        with suppress(OSError):  # which is how a terminal tells that nobody writes any more
            for line in self._out:
                with self._changed:
                    self._lines.append(line.rstrip("\n"))
                    self._changed.notify_all()
        with self._changed:
            self._over = True
            self._changed.notify_all()

    @property
    def output(self) -> str:
        return "\n".join(self._lines)

    def wait_for(self, text: str, timeout: float = PATIENCE) -> str:
        """The first line that holds a text."""

        def found() -> str | None:
            return next((line for line in self._lines if text in line), None)

        with self._changed:
            self._changed.wait_for(lambda: found() is not None or self._over, timeout)
            line = found()
        assert line is not None, (
            f"{self.process.args!r}: {text!r} not within {timeout} s, or before the end, in:\n{self.output}"
        )
        return line

    def wait(self, timeout: float = PATIENCE) -> int:
        """The exit code."""
        code = self.process.wait(timeout)
        self._reader.join(5)
        return code

    def interrupt(self) -> None:
        """Press Ctrl-C."""
        if self._terminal:
            os.killpg(self.process.pid, signal.SIGINT)
        else:
            self.process.send_signal(signal.SIGINT)

    def close(self) -> None:
        """End it, whatever it does; nothing of it survives."""
        try:
            if self.process.poll() is None:
                self._end()
        finally:
            self._reader.join(5)
            self._out.close()

    def _end(self) -> None:
        children: list[psutil.Process] = []
        with suppress(psutil.Error, ProcessLookupError):  # it may be just ending
            children = self.children()
            self.interrupt()
        try:
            self.wait(10)
        except subprocess.TimeoutExpired:
            for process in [*children, psutil.Process(self.process.pid)]:
                with suppress(psutil.Error):
                    process.kill()
            self.wait(10)

    def children(self) -> list[psutil.Process]:
        """The processes that the command has started."""
        return psutil.Process(self.process.pid).children(recursive=True)

    def child(self, part: str) -> psutil.Process:
        """The child whose command line holds a text.

        A look that falls into the end of a child's parent misses it: its line of parents is broken until it has its
        new one.
        """
        found: list[psutil.Process] = []

        def seen() -> bool:
            for process in self.children():
                with suppress(psutil.Error):  # it is just ending
                    if any(part in word for word in process.cmdline()):
                        found.append(process)
                        return True
            return False

        eventually(seen, f"a child process of {part!r}")
        return found[0]


class Command(Running):
    """A `robo` command that runs beside the test."""

    def __init__(self, *arguments: str, cwd: str | None = None) -> None:
        super().__init__([sys.executable, "-m", "robo", *arguments], cwd=cwd, env=plain_environment())


@contextmanager
def robo(*arguments: str, cwd: str | None = None) -> Iterator[Command]:
    """Run a `robo` command; whatever happens, nothing of it survives the test."""
    command = Command(*arguments, cwd=cwd)
    try:
        yield command
    finally:
        command.close()


def run_robo(
    *arguments: str, timeout: float = 60.0, cwd: str | None = None, env: Mapping[str, str] | None = None
) -> "subprocess.CompletedProcess[str]":
    """Run a `robo` command to its end; `env` is what its environment has beside this process's."""
    command = [sys.executable, "-m", "robo", *arguments]
    more = os.environ | (env or {})
    return subprocess.run(command, capture_output=True, text=True, timeout=timeout, check=False, cwd=cwd, env=more)


INTERRUPTED = (130, -signal.SIGINT)
"""Exit codes of what Ctrl-C ends: by itself, and where it comes before anybody cares for it."""

_ENDLESS = (
    (r"robo up\b", r" -d\b|--dry-run|--show-args"),
    (r"robo (router|keeper|top)\b", r"--print-config|--once"),
    (r"robo (run|dashboard)\b", ""),
    (r"robo topic (echo|hz|bw|delay|loss|plot)\b", r"--once|--count|--duration"),
    (r"robo topic pub\b.* -r\b", r"--times"),
    (r"robo topic pub\b.* --latched", ""),
    (r"robo bag play\b.* --loop", ""),
    (r"robo param watch\b", ""),
    (r"robo tf (echo|monitor)\b", r"--once|--duration"),
    (r"robo action echo\b", ""),
    (r"robo events\b", ""),
    (r"robo bag record\b", r"--duration"),
    (r"robo bridge (foxglove|ros2)\b", r"--layout"),
    (r"robo logs\b.* -f\b", ""),
    (r"robo\b.* --watch\b", ""),
)


def is_endless(line: str) -> bool:
    """Whether what a line of the shell starts goes on until Ctrl-C."""
    words = line.rpartition("&&")[2]
    if "--help" in words:
        return False
    return any(re.search(verb, words) and not (ends and re.search(ends, words)) for verb, ends in _ENDLESS)


_SPACES = (("net", "net"), ("mount", "mnt"))
"""Namespaces of a desk: the option of nsenter, and the file."""


class Desk:
    """A folder, a network and a meeting place of its own: commands work on it as printed, with robo's usual endpoints.

    Args:
        folder: where commands run.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._environment = plain_environment() | {
            "ROBO_MEETING": "",  # where it is by itself, which is this desk's own
            "NO_COLOR": "1",
            "XDG_STATE_HOME": str(folder / ".state"),
            "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
        }
        self._terminals: list[Running] = []
        with ExitStack() as undo:
            met, apart = Path(f"/tmp/robo-{os.geteuid()}"), folder / ".meeting"
            met.mkdir(mode=0o700, exist_ok=True)
            apart.mkdir(mode=0o700)
            script = f"ip link set lo up && mount --bind {apart} {met} && echo there && exec sleep infinity"
            self._network = Running(["unshare", "--net", "--mount", "sh", "-c", script], env=self._environment)
            undo.callback(self._network.close)
            try:
                self._network.wait_for("there")
            except AssertionError:
                pytest.skip(f"no network of its own can be made here: {self._network.output}")
            undo.pop_all()

    def start(self, line: str) -> Running:
        """Type a line into a terminal of its own."""
        spaces = [f"--{kind}=/proc/{self._network.process.pid}/ns/{name}" for kind, name in _SPACES]
        command = ["nsenter", *spaces, "bash", "-o", "pipefail", "-c", f"cd {self.folder}\n{line}"]
        terminal = Running(command, cwd=str(self.folder), env=self._environment, terminal=True)
        self._terminals.append(terminal)
        return terminal

    def run(self, line: str, *, ends: bool | None = None, timeout: float = 60.0) -> tuple[int, str]:
        """Type a line and wait for its end.

        Args:
            line: what the shell runs.
            ends: whether it ends by itself; Ctrl-C ends what does not, once it has printed something.
            timeout: s.

        Returns:
            The exit code, 0 where Ctrl-C ended it as it should; and what was printed.
        """
        by_itself = ends if ends is not None else not is_endless(line)
        terminal = self.start(line)
        if not by_itself:
            terminal.wait_for("", timeout)
            terminal.interrupt()
        code = terminal.wait(timeout)
        return 0 if not by_itself and code in INTERRUPTED else code, terminal.output

    def close(self) -> None:
        """Press Ctrl-C in every terminal, end what is left in the background, and give up the network."""
        with ExitStack() as ends:
            ends.callback(self._network.close)
            ends.callback(self._sweep)
            for terminal in self._terminals:
                ends.callback(terminal.close)

    def _sweep(self) -> None:
        """End what runs in the network, such as a robot that a command has left in the background."""
        ours = os.readlink(f"/proc/{self._network.process.pid}/ns/net")
        assert ours != os.readlink("/proc/self/ns/net")

        def empty() -> bool:
            left = 0
            for process in psutil.process_iter():
                with suppress(OSError, psutil.Error):  # it has just ended, or it is somebody else's
                    if process.pid != self._network.process.pid and os.readlink(f"/proc/{process.pid}/ns/net") == ours:
                        left += 1
                        process.kill()
            return left == 0

        eventually(empty, "nothing is left in the network")  # one look may miss what is just being forked
