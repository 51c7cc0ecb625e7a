"""`robo up -d`: a run that outlives its command."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from contextlib import suppress

from robo.environment import NOTIFY_VARIABLE


def start_in_background(arguments: Sequence[str], robot: str, *, wait: bool) -> int:
    """Start `robo up` in a session of its own, and wait until it is up, or ready.

    Returns:
        The exit code: 0, or that of a run that ended before; 1 where a process of it failed.
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
        code = 0
        with os.fdopen(reader, encoding="utf-8") as lines:
            for line in lines:
                word = line.rstrip("\n")
                if word == "ready" or (word == "up" and not wait):
                    print(f"{robot} is {word} (process {run.pid}); `robo ps` shows it, `robo down` ends it")
                    return 0
                if word not in ("up", "down"):
                    print(f"{robot} is not all ready: {word}", file=sys.stderr)
                    print("it runs on; `robo why` tells more, `robo down` ends it", file=sys.stderr)
                    return 1
            code = run.wait()
        output.seek(0)
        print(output.read().decode(errors="replace"), end="", file=sys.stderr)
    if wait and code == 0:
        print(f"{robot} has ended by itself", file=sys.stderr)
    return code


def notify_starter() -> Callable[[str], None] | None:
    """How a run tells the command that has put it into the background; None for a run in the foreground."""
    descriptor = os.environ.pop(NOTIFY_VARIABLE, None)
    if descriptor is None or not descriptor.isdecimal():
        return None
    number = int(descriptor)
    os.set_inheritable(number, False)

    def notify(word: str) -> None:
        with suppress(OSError):  # the starter has heard enough
            os.write(number, f"{word}\n".encode())

    return notify
