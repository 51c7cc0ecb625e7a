"""One child process: its output, its end, and how it is stopped."""

import asyncio
import os
import signal
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress

_LONGEST_LINE = 16_384
_LAST_LINES = 20


class Child:
    """A process in a process group of its own, so that a terminal's Ctrl-C reaches the supervisor alone
    and whatever the process starts can be ended with it.
    """

    def __init__(self, name: str, on_line: Callable[[str], None]) -> None:
        self.name = name
        self.last_lines: deque[str] = deque(maxlen=_LAST_LINES)
        """The end of its stderr, for the summary of a failure."""
        self._on_line = on_line
        self._process: asyncio.subprocess.Process | None = None
        self._pumps: list[asyncio.Task[None]] = []

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

    async def start(self, command: Sequence[str], environment: Mapping[str, str], *, cwd: str | None = None) -> None:
        """Start the process.

        Raises:
            OSError: the program or the folder is not there, or may not be used.
        """
        self._process = await asyncio.create_subprocess_exec(
            *command,
            env=environment,
            cwd=cwd,
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            process_group=0,
        )
        assert self._process.stdout is not None
        assert self._process.stderr is not None
        self._pumps = [
            asyncio.create_task(self._pump(self._process.stdout, keep=False)),
            asyncio.create_task(self._pump(self._process.stderr, keep=True)),
        ]

    async def wait(self) -> int:
        """Wait for the end of the process, show the rest of its output, and end what it left behind."""
        assert self._process is not None
        code = await self._process.wait()
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        # A grandchild outside the group may hold the pipes open: its output is not waited for.
        await asyncio.wait(self._pumps, timeout=0.5)
        for pump in self._pumps:
            pump.cancel()
        return code

    def send(self, number: signal.Signals) -> None:
        """Send a signal to the whole group."""
        if self.running:
            assert self._process is not None
            with suppress(ProcessLookupError):
                os.killpg(self._process.pid, number)

    async def stop(
        self,
        ended: "asyncio.Future[int] | asyncio.Task[int]",
        *,
        patience: float,
        first: signal.Signals = signal.SIGINT,
    ) -> None:
        """Ask the process to end, then insist: TERM after `patience` s, KILL after half as long again."""
        for number, seconds in ((first, patience), (signal.SIGTERM, patience / 2), (signal.SIGKILL, 5.0)):
            self.send(number)
            done, _ = await asyncio.wait([ended], timeout=seconds)
            if done:
                return

    async def _pump(self, stream: asyncio.StreamReader, *, keep: bool) -> None:
        """Pass on output line by line, whatever its encoding and however long its lines."""
        rest = b""
        while chunk := await stream.read(65_536):
            *lines, rest = (rest + chunk).split(b"\n")
            for line in lines:
                self._pass_on(line, keep=keep)
            if len(rest) > _LONGEST_LINE:
                self._pass_on(rest, keep=keep)
                rest = b""
        if rest:
            self._pass_on(rest, keep=keep)

    def _pass_on(self, line: bytes, *, keep: bool) -> None:
        text = line.decode("utf-8", "replace").rstrip("\r")
        if keep:
            self.last_lines.append(text)
        self._on_line(text)


def describe_exit(code: int) -> str:
    """An exit code in words: `exit code 1`, `killed by SIGSEGV`."""
    if code >= 0:
        return f"exit code {code}"
    try:
        return f"killed by {signal.Signals(-code).name}"
    except ValueError:
        return f"killed by signal {-code}"
