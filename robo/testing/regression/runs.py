"""Runs as processes of their own: each with another order of hashes, and one that dies takes nobody along."""

from __future__ import annotations

import os
import queue
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import IO

import msgspec

from robo.bag.regression.report import Trouble
from robo.errors import UsageError
from robo.testing.regression.order import Line, RunOrder, RunResult
from robo.testing.run import clean_environment
from robo.text.readable import readable

SILENCE = 120.0
"""How long a run may say nothing beyond its patience, s: a node may take a while for its start, on a machine that has
much else to do."""

_SHOWN = 12
"""How many of the last lines of a process that has died are shown."""


def run_apart(order: RunOrder, number: int, progress: Callable[[float], None], silence: float = SILENCE) -> RunResult:
    """Run once, in a process of its own.

    Args:
        order: what to run.
        number: of the run; hashes follow from it.
        progress: is told how much is done, 0 to 1.
        silence: how long the process may say nothing beyond its patience, s.

    Returns:
        What it has come to; where the process has died, that as a trouble.

    Raises:
        UsageError: what is wanted makes no sense.
    """
    silence += order.patience
    leash = [sys.executable, "-m", "robo.machine.leash", str(os.getpid()), sys.executable]
    with tempfile.TemporaryFile() as errors:
        process = subprocess.Popen(
            [*leash, "-m", "robo.testing.regression.run"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors,
            env=clean_environment() | {"PYTHONHASHSEED": str(number)},
            start_new_session=True,  # Ctrl-C is for whoever waits, who ends it
        )
        assert process.stdin is not None
        assert process.stdout is not None
        lines: _Lines = queue.SimpleQueue()
        reader = threading.Thread(target=_read, args=(process.stdout, lines), name="robo-replay", daemon=True)
        reader.start()
        try:
            with suppress(BrokenPipeError):
                process.stdin.write(msgspec.msgpack.encode(order))  # JSON has neither infinities nor bytes
                process.stdin.close()
            result = _follow(lines, progress, silence)
            if result is not None:
                return result
            code = process.returncode if _ends(process) else None
            return RunResult(begin=order.begin or 0, troubles=[_death(order, code, _last_lines(errors), silence)])
        finally:
            process.kill()
            process.wait()
            reader.join(1.0)
            if not reader.is_alive():  # else something that a node has started holds the pipe
                process.stdout.close()


def _ends(process: subprocess.Popen[bytes]) -> bool:
    try:
        process.wait(1.0)
    except subprocess.TimeoutExpired:
        return False
    return True


_Lines = queue.SimpleQueue[bytes | None]
"""What a run tells; None where that ends."""


def _read(output: IO[bytes], lines: _Lines) -> None:
    for line in output:
        lines.put(line)
    lines.put(None)


def _follow(lines: _Lines, progress: Callable[[float], None], silence: float) -> RunResult | None:
    """What a run tells, to its result; None where it ends, or is silent, before."""
    while True:
        try:
            text = lines.get(timeout=silence)
        except queue.Empty:
            return None
        if text is None:
            return None
        line = msgspec.json.decode(text, type=readable(Line))
        if line.mistake is not None:
            raise UsageError(line.mistake)
        if line.done is not None:
            progress(line.done)
        if line.result is not None:
            return line.result


def _death(order: RunOrder, code: int | None, words: str, silence: float) -> Trouble:
    who = ", ".join(one.name or one.service for one in order.nodes)
    ended_by = signal.Signals(-code).name if code is not None and code < 0 else ""
    if code is None:
        how = f"nothing has come of it for {silence:g} s"
    elif code < 0:
        how = f"its process was ended by {ended_by}"
    else:
        how = f"its process has ended with exit code {code}"
    return Trouble(who, order.begin or 0, f"{how}\n{words}" if words else how, ended_by)


def _last_lines(errors: IO[bytes]) -> str:
    errors.seek(0)
    lines = errors.read()[-20_000:].decode(errors="replace").splitlines()
    return "\n".join(f"  {line}" for line in lines[-_SHOWN:])
