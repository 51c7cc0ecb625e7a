"""A supervised node's sign of life: once a second it tells its supervisor what it has done so far.

A beat is sent under the node's turn: a callback that does not return holds it back, and so does a
process that is stopped. In its place goes a message beside the turn, which names that callback; so it
does where a callback with a turn of its own does not return. Both
travel on a socket that the supervisor hands down, so that they say nothing about the network and need
none.
"""

import errno
import os
import socket
import sys
import threading
import time
from collections.abc import Callable

import msgspec

from robo.environment import HEARTBEAT_VARIABLE, WATCH_VARIABLE
from robo.node.node import Node
from robo.wire.reports import Beat, NodeStatus

_BEHIND = (errno.EAGAIN, errno.ENOBUFS)
"""What the system says where the supervisor has not read for a while; the latter on macOS."""


def begin(node: Node) -> None:
    """Let a node that has started tell its supervisor, if it has one, that it lives."""
    given = os.environ.pop(HEARTBEAT_VARIABLE, None)  # not for what the node starts
    watched = os.environ.pop(WATCH_VARIABLE, None)
    if given is None:
        return
    descriptor, _, period = given.partition(":")
    os.set_inheritable(int(descriptor), False)
    supervisor = socket.socket(fileno=int(descriptor))
    Heart(node, supervisor, float(period), own_files() if watched else []).begin()


LATE = 1.2
"""A callback that runs for longer than so many periods is told as one that holds the beat back."""


class Heart:
    """Sends what a node says of itself."""

    def __init__(
        self,
        node: Node,
        supervisor: socket.socket,
        period: float,
        files: list[str],
        used: Callable[[], float | None] = lambda: None,
    ) -> None:
        """
        Args:
            node: whose it is, which has started.
            supervisor: the socket.
            period: the time from one beat to the next, s.
            files: for the first beat.
            used: says how much processor time the node has used, where that is not all that its process has, s.
        """
        self._socket = supervisor
        self._socket.setblocking(False)
        self._node = node
        self._period = period
        self._files = files
        self._used = used
        self._last = time.monotonic()

    def begin(self) -> None:
        """Let it beat."""
        self.beat()
        self._node.beat_every(self._period, self.beat)
        threading.Thread(target=self.watch, name="robo-heart", daemon=True).start()

    def beat(self) -> None:
        """Send one beat; called under the node's turn."""
        self._last = time.monotonic()
        status = self._node.status
        # What runs in the node's own turn is this: nothing worth telling.
        held = max(status.turns.values(), key=lambda turn: turn.running_for, default=None)
        late = held is not None and held.running_for > LATE * self._period
        running, running_for = (held.running, held.running_for) if held is not None and late else ("", 0.0)
        status = msgspec.structs.replace(status, running=running, running_for=running_for)
        files, self._files = self._files, []
        self._send(Beat(status, late=late, files=files, cpu=self._used()))

    def watch(self) -> None:
        """While a callback holds the beat back, say so; runs in a thread beside the node's turn."""
        wait = self._period
        while not self._node.wait(wait):
            overdue = time.monotonic() - self._last - LATE * self._period
            if overdue > 0:
                self._send(Beat(self._node.status, late=True))
            wait = self._period if overdue > 0 else -overdue + 0.01

    def _send(self, beat: Beat) -> None:
        try:
            try:
                self._socket.send(msgspec.msgpack.encode(beat))
            except OSError as error:
                if error.errno != errno.EMSGSIZE:
                    raise
                self._socket.send(msgspec.msgpack.encode(_brief(beat)))
        except OSError as error:
            if error.errno in _BEHIND:
                return  # the next beat says it all again
            self._node.logger.fatal("the supervisor is gone; ending")
            self._node.shutdown(1)


def _brief(beat: Beat) -> Beat:
    """A beat without its counters and files: of a thousand topics they are more than a socket takes at once."""
    status = beat.status
    little = NodeStatus(status.node, {}, {}, {}, {}, status.callback_errors)
    return Beat(
        msgspec.structs.replace(little, uptime=status.uptime, running=status.running, running_for=status.running_for),
        beat.late,
        cpu=beat.cpu,
    )


def own_files() -> list[str]:
    """The source files of this process, Python's own and installed ones left out."""
    places = [sys.prefix, sys.base_prefix]
    files = {str(getattr(module, "__file__", None) or "") for module in list(sys.modules.values())}
    return sorted(os.path.abspath(f) for f in files if f.endswith(".py") and not f.startswith(tuple(places)))
