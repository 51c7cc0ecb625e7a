"""Importing modules in a process of its own, which reports on each of them.

What they import stays out of this process. One that crashes, ends the process or does not come to its end is named, and
the others are imported all the same. Nothing that they start outlives it.
"""

import contextlib
import importlib
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from types import ModuleType
from typing import Generic, TypeVar

import msgspec

from robo.text.readable import readable
from robo.text.unreadable import UNREADABLE

T = TypeVar("T")

PATIENCE = 30.0
"""How long the import of one module may take, s."""


class Imported(msgspec.Struct, Generic[T], frozen=True):
    """What came of one module."""

    module: str
    found: T | None = None
    """What was looked for in it; None where it cannot be imported."""
    error: str = ""
    """Why it cannot be imported: what stands behind these words."""


class _Line(msgspec.Struct):
    """What the process says of a module."""

    found: bytes = b""
    """As MessagePack."""
    error: str = ""


def import_apart(
    program: Sequence[str], modules: Sequence[str], kind: type[T], patience: float = PATIENCE
) -> Iterator[Imported[T]]:
    """Import modules elsewhere, and tell what came of each, in their order.

    Args:
        program: a module that calls `report` when it is run, and its first words; the modules are its last ones.
        modules: their full names.
        kind: what the program finds in each.
        patience: how long the import of one may take, s.
    """
    left = list(modules)
    while left:
        why = ""
        with _process([*program, *left]) as process:
            try:
                for line in _lines(process, len(left), patience):
                    found = None if line.error else msgspec.msgpack.decode(line.found, type=readable(kind))
                    yield Imported(left.pop(0), found, line.error)
                if left:
                    why = f"it ends the process with {_ended(process.wait(patience))}"
            except (TimeoutError, subprocess.TimeoutExpired):
                why = f"it has not come to its end within {patience:g} s"
            except UNREADABLE:
                why = "it writes into what this process reports"
        if left:
            yield Imported(left.pop(0), error=why)


@contextlib.contextmanager
def _process(words: Sequence[str]) -> Iterator["subprocess.Popen[bytes]"]:
    # Python's -P: a file of the current folder that is called like one of robo's own modules hides none of them.
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", *words],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    with process:
        try:
            yield process
        finally:
            with contextlib.suppress(OSError):  # all of them have ended
                os.killpg(process.pid, signal.SIGKILL)


def _lines(process: "subprocess.Popen[bytes]", most: int, patience: float) -> Iterator[_Line]:
    """What the process reports until it ends, or has said so many lines.

    Raises:
        TimeoutError: one is too long in coming.
    """
    assert process.stdout is not None
    descriptor = process.stdout.fileno()
    rest = b""
    for _ in range(most):
        limit = time.monotonic() + patience
        while b"\n" not in rest:
            if not select.select([descriptor], [], [], max(0.0, limit - time.monotonic()))[0]:
                raise TimeoutError
            data = os.read(descriptor, 65536)
            if not data:
                return
            rest += data
        line, _, rest = rest.partition(b"\n")
        yield msgspec.json.decode(line, type=readable(_Line))


def _ended(code: int) -> str:
    return signal.Signals(-code).name if code < 0 else f"exit code {code}"


def report(modules: Sequence[str], look: Callable[[ModuleType], object]) -> None:
    """Import modules and report what a look at each of them finds, to what is stdout; then end this process.

    Args:
        modules: their full names; the current folder is searched first, as it is for a node.
        look: what it returns is sent as MessagePack.
    """
    out = os.dup(1)  # a program that a module starts does not inherit it
    os.dup2(2, 1)
    if (here := os.getcwd()) not in sys.path:
        sys.path.insert(0, here)
    for name in modules:
        os.write(out, msgspec.json.encode(_line(name, look)) + b"\n")
    os._exit(0)  # whatever threads a module has begun


def _line(name: str, look: Callable[[ModuleType], object]) -> _Line:
    from robo.text.import_errors import explained

    try:
        return _Line(found=msgspec.msgpack.encode(look(importlib.import_module(name))))
    except (Exception, SystemExit) as error:  # a user's module may raise anything while it is imported
        return _Line(error=explained(error))
