"""`robo replay-test`: having a recording replayed to nodes, and printing what came of it.

The replay is a process of its own: nodes run there, and one that crashes or hangs takes no command along.
"""

from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING, Any

import msgspec

from robo.bag.regression.report import ReplayReport, lines
from robo.cli.printing import paint, print_json, print_line
from robo.errors import RunError, UsageError
from robo.parameters.words import sorted_out
from robo.text import colours
from robo.text.readable import readable
from robo.text.terminal import own

if TYPE_CHECKING:
    from robo.cli.replay_words import ReplayWords

_COLOURS = {
    "SAME:": colours.GREEN,
    "ACCEPTED:": colours.GREEN,
    "DIFFERENT:": colours.RED,
    "FAILED:": colours.RED,
    "NOT": colours.RED,
}


class _Line(msgspec.Struct):
    """A line that the process tells."""

    done: float | None = None
    stage: str = ""
    report: msgspec.Raw = msgspec.Raw()
    mistake: str | None = None


def run_replay_test(request: ReplayWords) -> int:
    """Replay, and print the report.

    Returns:
        1 where something differs, is not deterministic or has failed.

    Raises:
        UsageError: what is asked makes no sense, or a file cannot be read.
    """
    others, arguments = sorted_out(request.words or [])
    if others:
        raise UsageError(f"{others[0]}: one recording is replayed; arguments of the manifest are NAME:=VALUE")
    if not request.bag.exists():
        raise UsageError(f"there is no recording {request.bag}")
    told = _replay(
        {
            "bag": str(request.bag),
            "nodes": request.node or [],
            "manifest": request.manifest,
            "robot": request.robot_name,
            "arguments": arguments,
            "tolerances": _path(request.tolerances),
            "ignored": request.ignore or [],
            "runs": request.runs,
            "accept": request.accept,
            "output": _path(request.output),
            "plots": _path(request.plot),
            "patience": request.patience,
        }
    )
    report = msgspec.json.decode(told, type=readable(ReplayReport))
    if request.json:
        print_json(msgspec.json.decode(told))
    else:
        for line in lines(report):
            for part in line.split("\n"):
                print_line(_painted(part))
    return 0 if report.fine else 1


def _replay(request: dict[str, Any]) -> bytes:
    """Have it done by a process of its own; the report, as JSON."""
    leash = [sys.executable, "-m", "robo.machine.leash", str(os.getpid())]
    command = [*leash, sys.executable, "-m", "robo.testing.regression"]  # by name: tests stand beside the tools
    # Apart from the terminal: Ctrl-C is for this command, which ends the other.
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True)
    progress = _Progress()
    try:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(msgspec.msgpack.encode(request))
        process.stdin.close()
        for text in process.stdout:
            line = msgspec.json.decode(text, type=readable(_Line))
            if line.mistake is not None:
                process.wait()
                raise UsageError(line.mistake)
            if bytes(line.report):
                process.wait()
                return bytes(line.report)
            progress.show(line.done or 0.0, line.stage)
        code = process.wait()
        raise RunError(f"the replay ended with exit code {code}; what it printed stands above")
    finally:
        progress.clear()
        process.terminate()
        process.wait()
        if process.stdout is not None:
            process.stdout.close()


class _Progress:
    """A line on a terminal that says how far it is."""

    def __init__(self) -> None:
        self._shown = ""
        self._is_on = sys.stderr.isatty()

    def show(self, done: float, stage: str) -> None:
        text = f"{stage} {done:.0%}"
        if self._is_on and text != self._shown:
            self._shown = text
            self._write(text)

    def clear(self) -> None:
        if self._shown:
            self._shown = ""
            self._write("")

    @staticmethod
    def _write(text: str) -> None:
        sys.stderr.write(own("\r\x1b[K") + text)
        sys.stderr.flush()


def _painted(line: str) -> str:
    colour = _COLOURS.get(line.partition(" ")[0])
    return paint(line, colour) if colour is not None else line


def _path(path: os.PathLike[str] | None) -> str | None:
    return None if path is None else os.fspath(path)
