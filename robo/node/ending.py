"""Ending a node from within: because its code asks for it, or because a part of it has died."""

import threading
from typing import Protocol

from robo.errors import RoboError
from robo.node.log import NodeLogger


class NodeStopping(RoboError):
    """An async callback was cancelled, or not begun, because its node stops."""

    def __init__(self) -> None:
        super().__init__("the node is told to stop")


class Endable(Protocol):
    """What is needed of a node to end it."""

    logger: NodeLogger
    exit_code: int

    @property
    def stopping(self) -> bool:
        """Whether the node is told to stop."""

    def shutdown(self, exit_code: int = 0) -> None:
        """Tell it; returns at once."""


def exit_code_of(stop: SystemExit) -> int:
    """The exit code that a SystemExit asks for, as Python reads it."""
    return stop.code if isinstance(stop.code, int) else int(stop.code is not None)


def obey(node: Endable, wish: SystemExit) -> None:
    """End a node as `sys.exit(3)` or `sys.exit("why")` says."""
    if exit_code_of(wish) and not isinstance(wish.code, int):
        node.logger.fatal("%s", wish.code)
    node.shutdown(exit_code_of(wish))


def end_without(node: Endable, error: BaseException) -> None:
    """End a node of which a thread has died of an exception, and with it a part of its work.

    It exits with code 1, and its policy decides what then. Called in the thread that dies.
    """
    thread = threading.current_thread().name
    if node.stopping:
        node.logger.warning("%s ended while the node stopped: %s: %s", thread, type(error).__name__, error)
        return
    node.logger.error(f"the thread {thread} died; the node ends", exception=error)
    node.shutdown(node.exit_code or 1)
