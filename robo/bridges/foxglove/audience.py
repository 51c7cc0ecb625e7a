"""What all viewers are told alike: what time it is, that the network is lost, what is left out."""

from collections.abc import Callable

from robo.bridges.foxglove import protocol
from robo.bridges.foxglove.client import Client
from robo.bridges.foxglove.offered import Offer


class Audience:
    """All viewers that are connected. Used by the event loop."""

    def __init__(self, clients: set[Client], lost: Callable[[], str]) -> None:
        """
        Args:
            clients: those that are connected, by and by.
            lost: that the network is lost, in a sentence; empty where it is not.
        """
        self._clients, self._lost = clients, lost
        self._told_time = 0
        """ns since the epoch."""
        self._told_lost = ""

    def welcome(self, client: Client) -> None:
        """One more has come."""
        self._clients.add(client)
        if self._told_lost:
            self._tell_lost(client)

    def status(self, level: int, text: str) -> None:
        """Tell the people before them something."""
        for client in self._clients:
            client.status(level, text)

    def say_time(self, now: int) -> bool:
        """Tell them what time it is, ns since the epoch; whether that was later before."""
        back, self._told_time = now < self._told_time, now
        for client in self._clients:
            client.say_time(now)
        return back

    def tell_parameters(self, changed: list[protocol.Parameter]) -> None:
        """Tell them what has changed, each what it wants to know."""
        for client in self._clients:
            client.tell_parameters(changed)

    def look_at_link(self) -> None:
        """What viewers show stands still, or vanishes, where the robots' network is gone: they are told why."""
        lost = self._lost()
        if lost != self._told_lost:
            self._told_lost = lost
            for client in self._clients:
                self._tell_lost(client)

    def tell_left_out(self, offer: Offer, now: float) -> None:
        """Tell each what it misses; `now` is in s by a clock that never goes back."""
        for client in self._clients:
            client.tell_left_out(offer, now)

    def _tell_lost(self, client: Client) -> None:
        if self._told_lost:
            client.status(protocol.ERROR, f"{self._told_lost}: what is shown is old, and no robot hears", "link")
        else:
            client.say(protocol.no_status("link"))
