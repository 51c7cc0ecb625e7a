"""Helpers for tests: waiting for events, and a robot as a process."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import msgpack
import psutil
import zenoh

PATIENCE = 15.0
"""How long an event may take on a slow machine, s. Nothing waits that long unless it fails."""


def eventually(condition: Callable[[], bool], what: str, timeout: float = PATIENCE) -> None:
    """Wait until something is true that no event tells of."""
    end = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < end, f"not within {timeout} s: {what}"
        time.sleep(0.005)


class Inbox:
    """The messages of a key, as a plain Zenoh client with any MessagePack library reads them."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self._changed = threading.Condition()
        self.samples: list[zenoh.Sample] = []
        self.messages: list[dict[str, Any]] = []
        self._subscriber = session.declare_subscriber(key, self._on_sample)

    def _on_sample(self, sample: zenoh.Sample) -> None:
        with self._changed:
            self.samples.append(sample)
            self.messages.append(msgpack.unpackb(sample.payload.to_bytes()))
            self._changed.notify_all()

    def wait_for(self, count: int = 1, timeout: float = PATIENCE) -> list[dict[str, Any]]:
        """At least `count` messages."""
        self.wait_until(lambda messages: len(messages) >= count, f"{count} messages", timeout)
        return self.messages

    def wait_until(
        self, condition: Callable[[list[dict[str, Any]]], bool], what: str, timeout: float = PATIENCE
    ) -> None:
        """Wait until the messages so far fulfil a condition."""
        with self._changed:
            there = self._changed.wait_for(lambda: bool(self.messages) and condition(self.messages), timeout)
            assert there, f"not within {timeout} s: {what}"

    def forget(self) -> None:
        with self._changed:
            self.samples.clear()
            self.messages.clear()

    def close(self) -> None:
        self._subscriber.undeclare()


class Command:
    """A `robo` command that runs beside the test; its output is collected by a thread."""

    def __init__(self, *arguments: str, cwd: str | None = None) -> None:
        environment = {key: value for key, value in os.environ.items() if not key.startswith("ROBO_")}
        self.process = subprocess.Popen(
            [sys.executable, "-m", "robo", *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            cwd=cwd,
            env=environment,
        )
        self._changed = threading.Condition()
        self._lines: list[str] = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            with self._changed:
                self._lines.append(line.rstrip("\n"))
                self._changed.notify_all()

    @property
    def output(self) -> str:
        return "\n".join(self._lines)

    def wait_for(self, text: str, timeout: float = PATIENCE) -> str:
        """The first line that holds a text."""
        with self._changed:
            found = self._changed.wait_for(lambda: next((line for line in self._lines if text in line), None), timeout)
        assert found, f"{text!r} not within {timeout} s in:\n{self.output}"
        return found

    def wait(self, timeout: float = PATIENCE) -> int:
        """The exit code."""
        code = self.process.wait(timeout)
        self._reader.join(5)
        return code

    def interrupt(self) -> None:
        self.process.send_signal(signal.SIGINT)

    def children(self) -> list[psutil.Process]:
        """The processes that the command has started."""
        return psutil.Process(self.process.pid).children(recursive=True)

    def child(self, part: str) -> psutil.Process:
        """The child whose command line holds a text."""
        for process in self.children():
            try:
                if any(part in word for word in process.cmdline()):
                    return process
            except psutil.Error:  # it is just ending
                continue
        raise AssertionError(f"no child process of {part!r}")


@contextmanager
def robo(*arguments: str, cwd: str | None = None) -> Iterator[Command]:
    """Run a `robo` command; whatever happens, nothing of it survives the test."""
    command = Command(*arguments, cwd=cwd)
    try:
        yield command
    finally:
        if command.process.poll() is None:
            children = command.children()
            command.interrupt()
            try:
                command.wait(10)
            except subprocess.TimeoutExpired:
                for process in [*children, psutil.Process(command.process.pid)]:
                    process.kill()
                command.wait(10)
        assert command.process.stdout is not None
        command.process.stdout.close()


def run_robo(*arguments: str, timeout: float = 30.0) -> "subprocess.CompletedProcess[str]":
    """Run a `robo` command to its end."""
    return subprocess.run(
        [sys.executable, "-m", "robo", *arguments], capture_output=True, text=True, timeout=timeout, check=False
    )
