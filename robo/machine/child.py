"""One child process: its output, its heartbeat, its end, and how it is stopped."""

import asyncio
import fcntl
import os
import signal
import socket
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from typing import IO

from robo.environment import HEARTBEAT_VARIABLE
from robo.machine.forks import Fork, Forked
from robo.machine.output import BUFFER, Budget, pump
from robo.process.template import HEART

_LAST_LINES = 30
"""Lines of the end of its stderr that are kept."""
_DRAIN = 0.3
"""How long an ended process's output may pause before it is taken for complete, s."""
_LONGEST_BEAT = 1_000_000
"""How much of a heartbeat is read, bytes."""
_HEART_BUFFER = 200_000
"""How much a heartbeat's socket is to hold, bytes."""


class Spawned:
    """The processes that this one has started for a run and waits for: nobody else may collect them."""

    def __init__(self, watchdog: int, tell: Callable[[int, bool], None]) -> None:
        """
        Args:
            watchdog: the process id of what ends the others where this one cannot; it is not told of itself.
            tell: takes the id of each that has been started, and True; and of each that has ended, and False.
        """
        self._pids = {watchdog}
        self._tell = tell

    def add(self, pid: int) -> None:
        """One has been started."""
        self._pids.add(pid)
        self._tell(pid, True)

    def discard(self, pid: int) -> None:
        """One has ended."""
        self._pids.discard(pid)
        self._tell(pid, False)

    def __contains__(self, pid: object) -> bool:
        return pid in self._pids


class Child:
    """A process in a process group of its own, so that a terminal's Ctrl-C reaches the supervisor alone
    and whatever the process starts can be ended with it.
    """

    def __init__(
        self,
        spawned: Spawned,
        on_line: Callable[[str, str], None],
        on_beat: Callable[[bytes], None] | None = None,
        beat_period: float = 1.0,
    ) -> None:
        """
        Args:
            spawned: the processes of the run, to which it belongs while it runs.
            on_line: takes the name of the stream, `stdout` or `stderr`, and a line.
            on_beat: takes the heartbeats of a node.
            beat_period: the time between two, s.
        """
        self.last_lines: deque[str] = deque(maxlen=_LAST_LINES)
        """The end of its stderr, for the summary of a failure."""
        self._lines = 0

        def count(stream: str, text: str) -> None:
            self._lines += 1
            on_line(stream, text)

        self._spawned = spawned
        self._on_line = count
        self._on_beat = on_beat
        self._beat_period = beat_period
        self._heart: socket.socket | None = None
        self._process: asyncio.subprocess.Process | Forked | None = None
        self._pumps: list[asyncio.Task[None]] = []
        self._ours = ExitStack()
        """What is to be closed at the end."""

    @property
    def pid(self) -> int | None:
        """The process id, once started."""
        return self._process.pid if self._process is not None else None

    @property
    def running(self) -> bool:
        """Whether it has started and not yet ended."""
        return self._process is not None and self._process.returncode is None

    @property
    def returncode(self) -> int | None:
        """The exit code, negative for a signal; None before the end."""
        return self._process.returncode if self._process is not None else None

    async def start(
        self,
        command: Sequence[str],
        environment: Mapping[str, str],
        *,
        cwd: str | None = None,
        fork: Fork | None = None,
    ) -> None:
        """Start the process.

        Args:
            command: the words of its command line.
            environment: all of it.
            cwd: the folder it runs in.
            fork: forks it from the template, where it may be: what is forked shows the same command line.

        Raises:
            OSError: the program or the folder is not there, or may not be used.
        """
        ours, theirs = ExitStack(), ExitStack()
        try:
            # Pipes of our own: asyncio's would not tell of the end of a process whose children keep them open.
            (out, their_out), (err, their_err) = _pipe(ours, theirs), _pipe(ours, theirs)
            heart = self._make_heart(ours, theirs) if self._on_beat is not None else None
            handed_down = () if heart is None else (heart,)
            forked = None
            if fork is not None:
                beats = self._beats(None if heart is None else HEART)
                forked = await fork({**environment, **beats}, (their_out, their_err, *handed_down))
            self._process = forked or await asyncio.create_subprocess_exec(
                *command,
                env={**environment, **self._beats(heart)},
                cwd=cwd,
                stdin=asyncio.subprocess.DEVNULL,
                stdout=their_out,
                stderr=their_err,
                pass_fds=handed_down,
                process_group=0,
            )
        except BaseException:
            ours.close()
            raise
        finally:
            theirs.close()
        self._spawned.add(self._process.pid)
        self._ours = ours
        budget = Budget(time.monotonic())
        self._pumps = [
            asyncio.create_task(pump(await _reader(out, ours), lambda text: self._on_line("stdout", text), budget)),
            asyncio.create_task(pump(await _reader(err, ours), self._on_error_line, budget)),
        ]
        if self._heart is not None:
            asyncio.get_running_loop().add_reader(self._heart, self._read_beats)

    def _beats(self, descriptor: int | None) -> dict[str, str]:
        """What tells a node where its heartbeats go, and how often; nothing where nobody listens."""
        return {} if descriptor is None else {HEARTBEAT_VARIABLE: f"{descriptor}:{self._beat_period:g}"}

    def _make_heart(self, ours: ExitStack, theirs: ExitStack) -> int:
        """A socket for heartbeats; returns the descriptor that the process gets."""
        self._heart, heart = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._heart.setblocking(False)
        # macOS grants 2 kB by default, less than what a node with some topics says.
        self._heart.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _HEART_BUFFER)
        heart.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _HEART_BUFFER)
        ours.callback(self._close_heart)
        theirs.enter_context(heart)
        return heart.fileno()

    async def wait(self) -> int:
        """Wait for the end of the process, show the rest of its output, and end what it left behind."""
        assert self._process is not None
        code = await self._process.wait()
        self._spawned.discard(self._process.pid)
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        # A grandchild outside the group may hold the pipes open: what it has to say is not waited for.
        seen = -1
        while seen != self._lines:
            seen = self._lines
            _, unfinished = await asyncio.wait(self._pumps, timeout=_DRAIN)
            if not unfinished:
                break
        for task in self._pumps:
            task.cancel()
        self._ours.close()
        return code

    def send(self, number: signal.Signals) -> None:
        """Send a signal to the whole group."""
        if self.running:
            assert self._process is not None
            with suppress(ProcessLookupError):
                os.killpg(self._process.pid, number)

    async def stop(self, ended: "asyncio.Task[int]", *, patience: float, first: signal.Signals = signal.SIGINT) -> None:
        """Ask the process to end, then insist: TERM after `patience` s, KILL after half as long again."""
        for number, seconds in ((first, patience), (signal.SIGTERM, patience / 2), (signal.SIGKILL, 5.0)):
            self.send(number)
            self.send(signal.SIGCONT)  # one that is stopped could not obey
            done, _ = await asyncio.wait([ended], timeout=seconds)
            if done:
                return

    def _on_error_line(self, text: str) -> None:
        self.last_lines.append(text)
        self._on_line("stderr", text)

    def _read_beats(self) -> None:
        assert self._heart is not None
        assert self._on_beat is not None
        with suppress(BlockingIOError, ConnectionError):
            while beat := self._heart.recv(_LONGEST_BEAT):
                self._on_beat(beat)

    def _close_heart(self) -> None:
        if self._heart is not None:
            with suppress(ValueError):
                asyncio.get_running_loop().remove_reader(self._heart)
            self._heart.close()
            self._heart = None


def _pipe(ours: ExitStack, theirs: ExitStack) -> tuple[IO[bytes], int]:
    """A pipe: our end to read, and the descriptor that the process gets."""
    reader, writer = os.pipe()
    theirs.callback(os.close, writer)
    if hasattr(fcntl, "F_SETPIPE_SZ"):
        with suppress(OSError):  # a user may have only so much of it
            fcntl.fcntl(reader, fcntl.F_SETPIPE_SZ, BUFFER)
    return ours.enter_context(os.fdopen(reader, "rb", buffering=0)), writer


async def _reader(pipe: IO[bytes], ours: ExitStack) -> asyncio.StreamReader:
    reader = asyncio.StreamReader(limit=BUFFER)
    loop = asyncio.get_running_loop()
    transport, _ = await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), pipe)
    ours.callback(transport.close)
    return reader


def describe_exit(code: int) -> str:
    """An exit code in words: `exit code 1`, `killed by SIGSEGV`."""
    if code >= 0:
        return f"exit code {code}"
    try:
        return f"killed by {signal.Signals(-code).name}"
    except ValueError:
        return f"killed by signal {-code}"
