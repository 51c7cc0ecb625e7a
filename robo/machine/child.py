"""One child process: its output, its heartbeat, its end, and how it is stopped."""

import asyncio
import os
import signal
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress

from robo.environment import HEARTBEAT_VARIABLE
from robo.machine.forks import Fork, Forked
from robo.machine.hearing import Hearing
from robo.machine.orphans import Left, left_in_group
from robo.process.template import HEART


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
        self.left: Sequence[Left] = ()
        """Who of its process group was still there when it had ended, though nobody had told the group to."""
        self._told = False
        self._spawned = spawned
        self._hearing = Hearing(on_line, on_beat)
        self._has_heart = on_beat is not None
        self._beat_period = beat_period
        self._process: asyncio.subprocess.Process | Forked | None = None

    @property
    def last_lines(self) -> deque[str]:
        """The end of its stderr, for the summary of a failure."""
        return self._hearing.last_lines

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
        theirs = ExitStack()
        try:
            their_out, their_err, *hearts = self._hearing.open(theirs)
            forked = None
            if fork is not None:
                forked = await fork({**environment, **self._beats(HEART)}, (their_out, their_err, *hearts))
            self._process = forked or await asyncio.create_subprocess_exec(
                *command,
                env={**environment, **self._beats(*hearts)},
                cwd=cwd,
                stdin=asyncio.subprocess.DEVNULL,
                stdout=their_out,
                stderr=their_err,
                pass_fds=hearts,
                process_group=0,
            )
        except BaseException:
            self._hearing.close()
            raise
        finally:
            theirs.close()
        self._spawned.add(self._process.pid)
        await self._hearing.begin()

    def _beats(self, descriptor: int = -1) -> dict[str, str]:
        """What tells a node where its heartbeats go, and how often; nothing where nobody listens."""
        return {HEARTBEAT_VARIABLE: f"{descriptor}:{self._beat_period:g}"} if self._has_heart else {}

    def say(self, data: bytes, descriptors: Sequence[int] = ()) -> None:
        """Say something to the process on the socket of its heartbeats, and hand down descriptors.

        Raises:
            OSError: it is gone, or has not read for a while.
        """
        self._hearing.say(data, descriptors)

    async def wait(self) -> int:
        """Wait for the end of the process, show the rest of its output, and end what it left behind."""
        assert self._process is not None
        code = await self._process.wait()
        self._spawned.discard(self._process.pid)
        self.left = () if self._told else left_in_group(self._process.pid)
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        await self._hearing.finish()
        return code

    def send(self, number: signal.Signals) -> None:
        """Send a signal to the whole group."""
        if self.running:
            assert self._process is not None
            self._told = self._told or number != signal.SIGCONT
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


def describe_exit(code: int) -> str:
    """An exit code in words: `exit code 1`, `killed by SIGSEGV`."""
    if code >= 0:
        return f"exit code {code}"
    try:
        return f"killed by {signal.Signals(-code).name}"
    except ValueError:
        return f"killed by signal {-code}"
