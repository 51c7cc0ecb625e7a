"""A supervised node's sign of life: once a second it tells its supervisor what it has done so far.

A beat is sent under the node's turn: a callback that does not return holds it back, and so does a
process that is stopped. It travels on a socket that the supervisor hands down, so that it says nothing
about the network and needs none.
"""

import os
import socket
import sys
from collections.abc import Callable

import msgspec

from robo.clock import Clock
from robo.node import Node
from robo.node_status import NodeStatus

HEARTBEAT_VARIABLE = "ROBO_HEARTBEAT"
"""`FD:PERIOD`: the socket, and the time from one beat to the next, s."""

WATCH_VARIABLE = "ROBO_WATCH"
"""Set where the supervisor wants to know a node's source files."""


class Beat(msgspec.Struct, frozen=True):
    """What a beat says."""

    status: NodeStatus
    files: list[str] = []
    """The source files of the process, Python's own and installed ones left out; in the first beat only."""


def begin(node: Node) -> None:
    """Let a node that has started tell its supervisor, if it has one, that it lives."""
    given = os.environ.pop(HEARTBEAT_VARIABLE, None)  # not for what the node starts
    watched = os.environ.pop(WATCH_VARIABLE, None)
    if given is None:
        return
    descriptor, _, period = given.partition(":")
    beat = _Heart(node, int(descriptor), _own_files() if watched else [])
    beat()
    node.create_timer(float(period), beat, Clock())


class _Heart:
    def __init__(self, node: Node, descriptor: int, files: list[str]) -> None:
        os.set_inheritable(descriptor, False)
        self._socket = socket.socket(fileno=descriptor)
        self._socket.setblocking(False)
        self._node = node
        self._files = files
        self._send: Callable[[bytes], int] = self._socket.send

    def __call__(self) -> None:
        """Send one beat."""
        beat, self._files = Beat(self._node.status, self._files), []
        try:
            self._send(msgspec.msgpack.encode(beat))
        except BlockingIOError:
            pass  # the supervisor is behind; the next beat says it all again
        except OSError:
            self._node.logger.fatal("the supervisor is gone; ending")
            self._node.shutdown(1)


def _own_files() -> list[str]:
    places = [sys.prefix, sys.base_prefix]
    files = {str(getattr(module, "__file__", None) or "") for module in list(sys.modules.values())}
    return sorted(os.path.abspath(f) for f in files if f.endswith(".py") and not f.startswith(tuple(places)))
