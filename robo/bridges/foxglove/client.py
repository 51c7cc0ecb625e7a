"""One viewer that is connected: what it wants, and what it has been told. Used by the event loop."""

import asyncio
import time
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import Future
from contextlib import suppress

import msgspec

from robo.bridges.foxglove import protocol
from robo.bridges.foxglove.offered import Ends, Offer, graph_changes
from robo.bridges.foxglove.outbox import Full, Outbox
from robo.bridges.foxglove.protocol import Parameter
from robo.bridges.foxglove.publications import Publications
from robo.bridges.foxglove.publishing import Publishing

MOST_ASKED = 100
"""Calls and the like of one client that wait to be answered."""
MOST_ASKED_BY_LOOKER = 4
"""The same, of one who may look and not drive."""
MOST_STOPS = 20
"""Emergency stops of one robot that one client waits for, apart from all else: whoever is in need presses often."""
MOST_SUBSCRIPTIONS = 2_000
_MOST_NAMED = 4
"""Topics beyond which no more are told that come late."""
_WELL = 10.0
"""Without a loss for so long, s, a client is told no more that it is slow."""


class Subscription(msgspec.Struct):
    """What a client gets, by the number that it has given it."""

    channel: int
    numbers: dict[str, int] = {}
    """Of a latched topic, the newest message of each publisher that it has been given."""


class Client:
    """One that is connected."""

    def __init__(self, name: str, publications: Publications, *, drives: bool, knows_playback: bool) -> None:
        """
        Args:
            name: by which people know it.
            publications: where it publishes.
            drives: whether it may do more than look.
            knows_playback: whether its protocol has that.
        """
        self.name = name
        self.drives = drives
        self.most_asked = MOST_ASKED if drives else MOST_ASKED_BY_LOOKER
        self.knows_playback = knows_playback
        self.outbox = Outbox()
        self.wake = asyncio.Event()
        self.is_full = False
        """Whether it takes nothing, so that it has to go."""
        self.subscriptions: dict[int, Subscription] = {}
        self.watched: set[str] | None = set()
        """Parameters of which each change is wanted; None for all."""
        self.wants_all_parameters = False
        self.asked = 0
        """Calls and the like that are not answered yet."""
        self.stops: Counter[str] = Counter()
        """Emergency stops that are not, by the key of the service."""
        self.fresh = time.monotonic()
        """What comes from it now was said later than this, s by the monotonic clock."""
        self.publications = publications
        self.publishing = Publishing(publications, self._not_published)
        self._loop = asyncio.get_running_loop()
        self._graph: Ends | None = None
        self._wants_graph = False
        self._left_out: Counter[int] = Counter()
        """Messages that it had not been given when that was looked at last, by subscription."""
        self._told_left_out: set[str] = set()
        """Topics of which it was told that it does not get all."""
        self._lost_at = 0.0

    def say(self, word: str | bytes) -> None:
        """Tell it something."""
        try:
            self.outbox.say(word)
        except Full:
            self.is_full = True
        self.wake.set()

    def say_time(self, now: int) -> None:
        """Tell it what time it is, ns since the epoch."""
        self.say_newest("time", protocol.time_of(now))

    def say_newest(self, what: str, word: str | bytes) -> None:
        """Tell it something of which only the last one counts."""
        self.outbox.say_newest(what, word)
        self.wake.set()

    def status(self, level: int, text: str, id_: str = "") -> None:
        """Tell the person before it something."""
        self.say(protocol.status(level, text, id_))

    def put(self, subscription: int, at: int, data: bytes) -> None:
        """Give it a message; its time is in ns since the epoch."""
        self.outbox.put(subscription, at, data)
        self.wake.set()

    def offer(self, before: Offer | None, now: Offer) -> None:
        """Tell it what has come and what has gone, of topics and services.

        Args:
            before: what it knows; None for nothing.
            now: what there is.
        """
        old_topics, old_services = (before.topics, before.services) if before is not None else ({}, {})
        gone = [one for one in old_topics if one not in now.topics]
        if gone:
            self.say(protocol.word("unadvertise", channelIds=gone))
            self.unsubscribe([one for one, wanted in self.subscriptions.items() if wanted.channel in {*gone}])
        new = [topic.channel for number, topic in now.topics.items() if number not in old_topics]
        if new:
            self.say(protocol.word("advertise", channels=new))
        if self.drives:
            unserved = [one for one in old_services if one not in now.services]
            if unserved:
                self.say(protocol.word("unadvertiseServices", serviceIds=unserved))
            served = [one.service for number, one in now.services.items() if number not in old_services]
            if served:
                self.say(protocol.word("advertiseServices", services=served))
        self.tell_graph(now.ends)

    def tell_unknown(self, unknown: dict[str, str]) -> None:
        """Tell the person before it of what there is that nobody knows: why, by name."""
        for name, why in unknown.items():
            self.status(protocol.INFO, f"{name}: {why}")

    def watch_graph(self, ends: Ends, *, wants: bool) -> None:
        """It wants to know who is at which end, or no longer."""
        self._wants_graph, self._graph = wants, None
        self.tell_graph(ends)

    def tell_graph(self, ends: Ends) -> None:
        """Tell it who is at which end, where it wants to know and something has changed."""
        if self._wants_graph:
            changes = graph_changes(self._graph, ends)
            self._graph = ends
            if changes is not None:
                self.say(protocol.word("connectionGraphUpdate", **changes))

    def unsubscribe(self, subscriptions: Iterable[int]) -> None:
        """It wants these no more."""
        for one in subscriptions:
            if self.subscriptions.pop(one, None) is not None:
                self.outbox.forget(one)

    def tell_parameters(self, changed: Iterable[Parameter]) -> None:
        """Tell it what has changed, as far as it wants to know."""
        wanted = [one for one in changed if self.watched is None or one.name in self.watched]
        if wanted:
            self.say(protocol.word("parameterValues", parameters=wanted))

    def tell_left_out(self, offer: Offer, now: float) -> None:
        """Tell it of which topics it does not get all, where these are others than it was told, and when it does again.

        Viewers show each text once more that is another one: no counts are told.

        Args:
            offer: what there is.
            now: s, by a clock that never goes back.
        """
        lost = self.outbox.left_out - self._left_out
        self._left_out = self.outbox.left_out.copy()
        if lost:
            self._lost_at = now
            worst = [one for one, _ in lost.most_common(3)]
            keys = {offer.topics[self.subscriptions[one].channel].key for one in worst if one in self.subscriptions}
            if not self._told_left_out or (keys - self._told_left_out and len(self._told_left_out) < _MOST_NAMED):
                self._told_left_out |= keys
                named = ", ".join(f"/{key}" for key in sorted(self._told_left_out))
                text = f"this viewer or its link is too slow: older messages are left out, most of {named}"
                self.status(protocol.WARNING, text, "left_out")
        elif self._told_left_out and now - self._lost_at > _WELL:
            self._told_left_out = set()
            self.say(protocol.no_status("left_out"))

    def close(self) -> "Future[None] | None":
        """It is gone: what it has driven is told to stand. Returns what is done once that is; None for nothing."""
        return self.publishing.close()

    def _not_published(self, why: str) -> None:
        """Called by the thread that publishes."""
        with suppress(RuntimeError):  # the loop is over
            self._loop.call_soon_threadsafe(self.status, protocol.ERROR, why)
