"""Where the threads of nodes and the loop of their async callbacks meet: who hands work over, and who waits for it."""

from __future__ import annotations

import selectors
import threading
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import asyncio


class Stage:
    """All threads run as they like; `robo.testing` has one that steps them."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.loop: asyncio.AbstractEventLoop | None = None
        """That of the async callbacks, once there are any. Under `lock`, as its users."""
        self.users = 0
        """How many nodes have async callbacks."""

    def selector(self) -> selectors.BaseSelector | None:
        """What the loop waits with; None for the system's best."""
        return None

    def posted(self) -> None:
        """Take note that the loop is about to be handed something; in the thread that does so."""

    def taken(self) -> None:
        """Take note that the loop begins with it."""

    def question(self) -> object:
        """Something to tell by that a thread of a node is going to wait for the loop; in that thread."""
        return None

    def waiting(self, question: object) -> AbstractContextManager[None]:
        """What stands below waits for the answer."""
        del question
        return nullcontext()

    def answered(self, question: object) -> None:
        """Take note that the answer is there; in the loop, before whoever waits goes on."""
