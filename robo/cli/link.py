"""Whether the network is still there: what goes on until Ctrl-C says when its link is lost, and when it is back."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import zenoh

from robo.cli.printing import note
from robo.cli.reach import Reach
from robo.wire import whereabouts
from robo.wire.network import Network

_LOOK = 0.3
"""How often the link is looked at, s. A cable that is cut is noticed by Zenoh's lease, within some 2 s."""


class Link:
    """A client's link to the router, or the node, that it has dialled."""

    def __init__(self, session: zenoh.Session, reach: Reach) -> None:
        self._session = session
        told = whereabouts.is_told(reach.connect)
        named = Network.from_environment("client", reach.connect).connect if told else ()
        self._where = ", ".join(named) or "the robots of this machine"
        self._since: float | None = None

    def look(self) -> str:
        """See whether it is there; returns what has changed, in a sentence, or nothing."""
        now = time.monotonic()
        info = self._session.info
        if not (info.routers_zid() or info.peers_zid()):
            if self._since is not None:
                return ""
            self._since = now
            return f"{self.lost}; it is dialled until it answers"
        since, self._since = self._since, None
        return f"the link to {self._where} is back, after {now - since:.1f} s" if since is not None else ""

    @property
    def lost(self) -> str:
        """That it is lost; empty where it is not."""
        return f"the link to {self._where} is lost" if self._since is not None else ""


@contextmanager
def watched(session: zenoh.Session, reach: Reach) -> Iterator[Link]:
    """While this goes on, say on stderr when the link is lost, and when it is back."""
    link = Link(session, reach)
    over = threading.Event()

    def look() -> None:
        while not over.wait(_LOOK):
            if changed := link.look():
                note(changed)

    thread = threading.Thread(target=look, name="robo-link", daemon=True)
    thread.start()
    try:
        yield link
    finally:
        over.set()
        thread.join(1.0)
