"""Nodes forked from a template process, which has imported already all that a node needs (Linux)."""

import asyncio
import os
import socket
import subprocess
from collections.abc import Awaitable, Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial

import msgspec

from robo.process.template import LARGEST


class Forked:
    """A process that the template has forked; like asyncio's, as far as a supervisor needs it."""

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self.returncode: int | None = None
        self._ended: asyncio.Future[int] = asyncio.get_running_loop().create_future()

    async def wait(self) -> int:
        """Wait for its end. Returns the exit code, negative for a signal."""
        return await asyncio.shield(self._ended)

    def end(self, code: int) -> None:
        """It has ended."""
        self.returncode = code
        if not self._ended.done():
            self._ended.set_result(code)


Fork = Callable[[Mapping[str, str], Sequence[int]], Awaitable[Forked | None]]
"""Forks a process with this environment and these descriptors; None where it has to be started in another way."""


class Template:
    """The template process of one run."""

    def __init__(self, process: "subprocess.Popen[bytes]", ours: socket.socket) -> None:
        self.process = process
        self._socket = ours
        self._asked: asyncio.Future[Forked] | None = None
        self._turn = asyncio.Lock()
        self._forked: dict[int, Forked] = {}
        self.usable = True

    def listen(self) -> None:
        """Begin to hear of ends, in the running loop."""
        asyncio.get_running_loop().add_reader(self._socket, self._read)

    def module(self, words: Sequence[str]) -> Fork:
        """What forks a module with its words, as they stand after `python -m`."""
        return partial(self.fork, words)

    async def fork(
        self, words: Sequence[str], environment: Mapping[str, str], descriptors: Sequence[int]
    ) -> Forked | None:
        """Fork a node.

        Args:
            words: the module to run and its arguments, as after `python -m`.
            environment: of the node.
            descriptors: for its stdout and its stderr, and a node's for heartbeats, which it finds at `HEART`.

        Returns:
            None where it has to be started in another way.
        """
        try:
            data = msgspec.msgpack.encode((words, environment))
        except UnicodeEncodeError:  # a variable of the user's that is not UTF-8, which a process may have all the same
            return None
        async with self._turn:
            if not self.usable or len(data) > LARGEST:
                return None
            self._asked = asyncio.get_running_loop().create_future()
            try:
                socket.send_fds(self._socket, [data], list(descriptors))
                return await self._asked
            except OSError:
                return None
            finally:
                self._asked = None

    def close(self) -> None:
        """Let it end."""
        self.usable = False
        with suppress(ValueError, RuntimeError):
            asyncio.get_running_loop().remove_reader(self._socket)
        self._socket.close()
        self.process.wait()

    def _read(self) -> None:
        try:
            data = self._socket.recv(4096)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self._lost()
            return
        pid, code = msgspec.msgpack.decode(data, type=tuple[int, int | None])
        if code is None:
            forked = Forked(pid)
            self._forked[pid] = forked
            if self._asked is not None and not self._asked.done():
                self._asked.set_result(forked)
        elif pid in self._forked:
            self._forked.pop(pid).end(code)

    def _lost(self) -> None:
        """The template has died: its nodes live on, adopted by this process, which waits for them itself."""
        self.usable = False
        loop = asyncio.get_running_loop()
        loop.remove_reader(self._socket)
        self.process.kill()
        self.process.wait()
        if self._asked is not None and not self._asked.done():
            self._asked.set_exception(ConnectionResetError())
        for forked in self._forked.values():
            try:
                descriptor = os.pidfd_open(forked.pid)
            except OSError:
                forked.end(-9)
                continue
            loop.add_reader(descriptor, self._collect, descriptor, forked)
        self._forked = {}

    def _collect(self, descriptor: int, forked: Forked) -> None:
        asyncio.get_running_loop().remove_reader(descriptor)
        os.close(descriptor)
        try:
            _, status = os.waitpid(forked.pid, 0)
        except ChildProcessError:  # somebody else has
            forked.end(-9)
        else:
            forked.end(os.waitstatus_to_exitcode(status))
