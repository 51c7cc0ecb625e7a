"""`robo up -d`: a run that outlives its command."""

import os
import select
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from contextlib import suppress

from robo.environment import NOTIFY_VARIABLE
from robo.supervisor.news import ENDS, HEED


def start_in_background(arguments: Sequence[str], robot: str, *, wait: bool) -> int:
    """Start `robo up` in a session of its own, and wait until it is up, or ready.

    Returns:
        The exit code: 0, or that of a run that ended before; 1 where a process of it failed and it runs on.
    """
    reader, writer = os.pipe()
    with tempfile.TemporaryFile() as output:
        run = subprocess.Popen(
            [sys.executable, "-m", "robo", "up", *arguments],
            env={**os.environ, NOTIFY_VARIABLE: str(writer)},
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
            pass_fds=(writer,),
            start_new_session=True,
        )
        os.close(writer)
        code, failed = 0, False
        with os.fdopen(reader, encoding="utf-8") as lines:
            for line in lines:
                word = line.rstrip("\n")
                if word == "ready" or (word == "up" and not wait):
                    print(f"{robot} is {word} (process {run.pid}); `robo ps` shows it, `robo down` ends it")
                    return 0
                if word.startswith(HEED):
                    print(word.removeprefix(HEED), file=sys.stderr)
                elif word not in ("up", "down") and not failed:
                    print(f"{robot} is not all ready: {word.removeprefix(ENDS)}", file=sys.stderr)
                    if not word.startswith(ENDS):
                        print("it runs on; `robo why` tells more, `robo down` ends it", file=sys.stderr)
                        return 1
                    failed = True
            code = run.wait()
        if failed:  # another one of this name may be started as soon as this command is over
            print("it has ended with that; `robo why` tells more", file=sys.stderr)
            return code or 1
        output.seek(0)
        print(output.read().decode(errors="replace"), end="", file=sys.stderr)
    if wait and code == 0:
        print(f"{robot} has ended by itself", file=sys.stderr)
    return code


class Starter:
    """The command that has put this run into the background, as the run sees it."""

    def __init__(self, descriptor: int) -> None:
        """`descriptor` is of the pipe on which it listens."""
        self._pipe = descriptor
        self._poll = select.poll()
        self._poll.register(descriptor, 0)  # only its end

    @classmethod
    def from_environment(cls) -> "Starter | None":
        """Who has put this run into the background; None for a run in the foreground."""
        descriptor = os.environ.pop(NOTIFY_VARIABLE, None)
        if descriptor is None or not descriptor.isdecimal():
            return None
        os.set_inheritable(int(descriptor), False)
        return cls(int(descriptor))

    def notify(self, word: str) -> None:
        """Tell how far the run has come."""
        with suppress(OSError):  # it has heard enough
            os.write(self._pipe, f"{word}\n".encode())

    def gone(self) -> bool:
        """Whether nobody reads any more what the run prints.

        What is printed went into a file that has no name, for the starter to show if the run ends at once: from now on
        it would only grow, so it goes nowhere.
        """
        if not self._poll.poll(0):
            return False
        nowhere = os.open(os.devnull, os.O_WRONLY)
        for stream in (1, 2):
            with suppress(OSError):
                os.ftruncate(stream, 0)
            os.dup2(nowhere, stream)
        os.close(nowhere)
        return True
