"""Nodes that share a process: each lives on a thread of its own, from its class to its exit code."""

import os
import socket
import sys
import threading
import time
import traceback
from collections.abc import Callable
from contextlib import ExitStack, suppress
from typing import TextIO

import msgspec
import zenoh

from robo.node import log
from robo.node.loading import load_node_class
from robo.node.node import Node
from robo.process import runner, threads
from robo.process.heartbeat import Heart, own_files
from robo.process.spec import NodeSpec
from robo.wire.network import Network
from robo.wire.session import close_session, open_session

_OURS = (os.path.join(os.path.dirname(os.path.dirname(__file__)), ""), threading.__file__)
"""Where code is that every node runs."""

GRACE = 1.0
"""How long the threads of a node that has stopped have to end, s."""


_building = threading.Lock()
"""One node after the other: msgspec may not come to know a type in two threads at once."""


class Channels(msgspec.Struct, frozen=True):
    """Where a node of a supervised process is heard."""

    output: int
    """The descriptor of its lines."""
    heart: int
    """The descriptor of its heartbeats."""
    level: str | None = None
    """The least level that it prints."""
    period: float = 1.0
    """The time from one heartbeat to the next, s."""
    watched: bool = False
    """Whether its source files are told."""


class SharedSession:
    """The session of a process, opened when its first node comes."""

    def __init__(self, name: str) -> None:
        """`name` is what it is called where somebody asks who is there."""
        self._name = name
        self._lock = threading.Lock()
        self._session: zenoh.Session | None = None
        self.network = Network()
        """How it has joined the network."""

    def join(self, spec: NodeSpec) -> zenoh.Session:
        """The session; the first node says how it joins the network, and all do so in the same way.

        Raises:
            NetworkError: the network cannot be reached.
        """
        with self._lock:
            if self._session is None:
                self.network = spec.network()
                self._session = open_session(msgspec.structs.replace(self.network, name=self._name))
            return self._session

    def close(self) -> bool:
        """Leave the network. Returns whether that was possible in time."""
        return self._session is None or close_session(self._session)


class Lodging:
    """One node in a process that it shares."""

    def __init__(self, spec: NodeSpec, session: SharedSession, channels: Channels | None) -> None:
        """
        Args:
            spec: all that there is to know of it.
            session: of the process.
            channels: where a supervisor hears it; None where it is one of a process that was started by hand.
        """
        self.exit_code = 0
        """Once it has ended."""
        self.stays: list[str] = []
        """The names of threads that it has started and that have not ended with it."""
        self._spec = spec
        self._session = session
        self._channels = channels
        self._lock = threading.Lock()
        self._node: Node | None = None
        self._out: TextIO | None = None
        self._told: int | None = None
        """With what exit code at least it is to end."""

    def begin(self, ended: Callable[[], None]) -> None:
        """Run it, on a thread of its own; `ended` is called there at the end."""

        def run() -> None:
            try:
                self._run()
            finally:
                ended()

        thread = threading.Thread(target=run, name=f"robo-node-{self._spec.name or self._spec.service}", daemon=True)
        threads.give(thread, self)
        thread.start()

    def end(self, code: int = 0) -> None:
        """Tell the node to end; with a `code` of 1 as one that has failed, whatever it says itself."""
        with self._lock:
            self._told = max(code, self._told or 0)
            if self._node is not None:
                self._node.shutdown(self._node.exit_code or code)

    def tell_where(self) -> None:
        """Write to its output where its threads are that run code which is not robo's."""
        frames = sys._current_frames()
        for thread in threads.of(self):
            frame = frames.get(thread.ident or 0)
            stack = traceback.extract_stack(frame) if frame is not None else []
            if self._out is not None and any(not _is_ours(entry.filename) for entry in stack):
                lines = "".join(traceback.format_list(stack))
                self._out.write(f"The thread {thread.name} (most recent call last):\n{lines}")

    def thread_died(self, died: threading.ExceptHookArgs) -> None:
        """End the node, for a thread of it has died."""
        if self._node is not None:
            runner.thread_died(self._node, died)
        else:  # which it is only about to become
            threading.__excepthook__(died)
            self.end(1)

    def _run(self) -> None:
        with ExitStack() as held:
            out = heart = None
            if self._channels is not None:
                out = held.enter_context(os.fdopen(self._channels.output, "w", buffering=1, errors="backslashreplace"))
                self._out = out
                heart = held.enter_context(socket.socket(fileno=self._channels.heart))
            try:
                with _building:
                    node = runner.build(load_node_class(self._spec.service), self._spec)
                if self._channels is not None and out is not None:
                    held.callback(log.apart(node.logger.logger, out, self._channels.level))
                with self._lock:
                    self._node = node
                    told = self._told
                if told is None:
                    session = self._session.join(self._spec)
                    runner.live(node, session, self._spec, lambda: self._started(node, heart))
                self.exit_code = node.exit_code or self._told or 0
            except BaseException as error:
                self.exit_code = runner.report(error, out)
            self._wait_for_threads(out or sys.stderr)

    def _started(self, node: Node, heart: socket.socket | None) -> None:
        channels = self._channels
        if channels is None or heart is None:
            runner.tell_place(node, self._session.network)
        else:
            files = own_files() if channels.watched else []
            Heart(node, heart, channels.period, files, threads.Used(self).total).begin()

    def _wait_for_threads(self, out: TextIO) -> None:
        """A thread that goes on holds what it has opened: then nothing but the end of the process ends it."""
        deadline = time.monotonic() + GRACE
        left = [thread for thread in threads.of(self) if thread is not threading.current_thread()]
        for thread in left:
            thread.join(max(0.0, deadline - time.monotonic()))
        self.stays = [thread.name for thread in left if thread.is_alive()]
        if self.stays:
            text = f"{', '.join(self.stays)} of it goes on, so that the process ends with it"
            if self._node is not None:
                self._node.logger.fatal(text)
            else:
                print(f"FATAL {text}", file=out, flush=True)


class Lodgings:
    """All nodes of one process."""

    def __init__(self, name: str, ended: Callable[[int, int], None], changed: Callable[[], None]) -> None:
        """
        Args:
            name: of the process.
            ended: is told of each that has ended: its number, and its exit code.
            changed: is called when there is one less, or all are to end.
        """
        self.session = SharedSession(name)
        self.closing = False
        """Whether all of them are to end, and the process with them."""
        self._ended = ended
        self._changed = changed
        self._code = 0
        """With what exit code at least all of them end."""
        self._lock = threading.Lock()
        self._there: dict[int, Lodging] = {}

    @property
    def empty(self) -> bool:
        """Whether no node is there."""
        return not self._there

    def begin(self, number: int, spec: NodeSpec, channels: Channels | None) -> None:
        """Take in a node."""
        lodging = Lodging(spec, self.session, channels)
        with self._lock:
            self._there[number] = lodging
        if self.closing:  # who sends it does not know that yet, and may send it elsewhere then
            lodging.end(self._code if channels is None else 1)
        lodging.begin(lambda: self._over(number, lodging))

    def end(self, number: int) -> None:
        """Tell a node to end; one that has ended already hears nothing of it."""
        with self._lock:
            lodging = self._there.get(number)
        if lodging is not None:
            lodging.end()

    def tell_where(self, number: int) -> None:
        """Let a node that hangs say where."""
        with self._lock:
            lodging = self._there.get(number)
        if lodging is not None:
            lodging.tell_where()

    def end_all(self, code: int = 0) -> None:
        """Tell all nodes to end, as failed ones where the code is 1."""
        self.closing, self._code = True, max(code, self._code)
        with self._lock:
            there = list(self._there.values())
        for lodging in there:
            lodging.end(code)
        self._changed()

    def thread_died(self, died: threading.ExceptHookArgs) -> None:
        """A thread has died of an exception, and with it a part of the work of the node that has started it."""
        owner = threads.owner_of(died.thread)
        if isinstance(owner, Lodging):
            owner.thread_died(died)
        else:
            threading.__excepthook__(died)

    def _over(self, number: int, lodging: Lodging) -> None:
        with self._lock:
            del self._there[number]
        self.closing |= bool(lodging.stays)
        with suppress(OSError):  # a supervisor that is gone
            self._ended(number, lodging.exit_code or (1 if lodging.stays else 0))
        if lodging.stays:
            self.end_all(1)
        self._changed()


def _is_ours(file: str) -> bool:
    return file.startswith(_OURS)
