"""A supervised node's sign of life: once a second it tells its supervisor what it has done so far.

A beat is sent under the node's turn: a callback that does not return holds it back, and so does a
process that is stopped. In its place goes a message beside the turn, which names that callback. Both
travel on a socket that the supervisor hands down, so that they say nothing about the network and need
none.
"""

import errno
import os
import socket
import sys
import threading
import time

import msgspec

from robo.environment import HEARTBEAT_VARIABLE, WATCH_VARIABLE
from robo.node.clock import Clock
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
    heart = Heart(node, socket.socket(fileno=int(descriptor)), float(period), _own_files() if watched else [])
    heart.beat()
    node.create_timer(float(period), heart.beat, Clock())
    threading.Thread(target=heart.watch, name="robo-heart", daemon=True).start()


class Heart:
    """Sends what a node says of itself."""

    def __init__(self, node: Node, supervisor: socket.socket, period: float, files: list[str]) -> None:
        """
        Args:
            node: whose it is.
            supervisor: the socket.
            period: the time from one beat to the next, s.
            files: for the first beat.
        """
        self._socket = supervisor
        self._socket.setblocking(False)
        self._node = node
        self._period = period
        self._files = files
        self._last = time.monotonic()

    def beat(self) -> None:
        """Send one beat; called under the node's turn."""
        self._last = time.monotonic()
        # What runs is this: nothing worth telling.
        status = msgspec.structs.replace(self._node.status, running="", running_for=0.0)
        files, self._files = self._files, []
        self._send(Beat(status, files=files))

    def watch(self) -> None:
        """While a callback holds the beat back, say so; runs in a thread beside the node's turn."""
        wait = self._period
        while not self._node.wait(wait):
            overdue = time.monotonic() - self._last - 1.2 * self._period
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
    )


def _own_files() -> list[str]:
    places = [sys.prefix, sys.base_prefix]
    files = {str(getattr(module, "__file__", None) or "") for module in list(sys.modules.values())}
    return sorted(os.path.abspath(f) for f in files if f.endswith(".py") and not f.startswith(tuple(places)))
