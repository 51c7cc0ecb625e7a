"""All viewers that are connected: what each is offered, wants and gets. Used by one thread, that of the event loop."""

import asyncio
import itertools
import threading
from collections.abc import Callable, Coroutine, Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from functools import partial
from typing import Any, NamedTuple

import zenoh

from robo.bridges.foxglove import protocol
from robo.bridges.foxglove.about import About
from robo.bridges.foxglove.audience import Audience
from robo.bridges.foxglove.calls import all_parameters
from robo.bridges.foxglove.client import Client
from robo.bridges.foxglove.driving import Driving
from robo.bridges.foxglove.feed import Delivery, Feed
from robo.bridges.foxglove.offered import Numbers, Offer, ServedService, Topic, offer, robots_drawn_into_one
from robo.bridges.foxglove.playback import Place, Playback
from robo.bridges.foxglove.presence import Presence
from robo.bridges.foxglove.publications import Publications
from robo.bridges.foxglove.watches import ParameterWatch
from robo.text.once import Once

_SETTLE = 0.1
"""Nodes come and go together: it is looked so long after the first of them, s."""
_BEAT = 0.1
"""How often viewers are told what time it is in a recording that has no clock, s."""
_SLOW = 20
"""Each so many beats they are told what they have missed."""
_MOST_BATCHES = 4
"""Of messages that wait for the event loop; more stay where only the newest are kept."""
_END = 2.0
"""How long it may take to tell robots to stand whose drivers are gone, s."""
_AGAIN = 0.3
"""How soon what is latched is told again, s: who forgets once often does so several times."""
_MOST_SERVICES = 10_000
"""That are remembered, of all that were there."""
_MOST_SOURCES = 1_000
"""Publishers of one latched topic whose last message a viewer is known to have."""

Tell = Callable[[str], None]


class Pools(NamedTuple):
    """What blocks is done here."""

    calls: ThreadPoolExecutor
    """What viewers ask for."""
    own: ThreadPoolExecutor
    """What the bridge does for all of them."""

    @classmethod
    def new(cls) -> "Pools":
        """Threads begin when they are needed."""
        words = ("call", 16), ("own", 8)
        return cls(*(ThreadPoolExecutor(count, f"robo-foxglove-{word}") for word, count in words))

    def close(self) -> None:
        """What waits is not done."""
        for pool in self:
            pool.shutdown(wait=False, cancel_futures=True)


class Bridge:
    """Knows all clients, and what there is for them."""

    def __init__(
        self,
        session: zenoh.Session,
        name: str,
        pools: Pools,
        tell: Tell,
        covers: Callable[[str], bool],
        lost: Callable[[], str],
    ) -> None:
        """
        Args:
            session: the network.
            name: that viewers show.
            pools: do what blocks.
            tell: is told what whoever runs the bridge should know.
            covers: which topics and services are offered, by their keys.
            lost: that the network is lost; empty where it is not.
        """
        self.session = session
        self.pools = pools
        self.driving = Driving(session, covers)
        self.clients: set[Client] = set()
        self.offer: Offer = offer((), numbers := Numbers())
        self.covers = covers
        self._audience = Audience(self.clients, lost)
        self._numbers, self._tell_once = numbers, Once(tell)
        self._loop = asyncio.get_running_loop()
        self._names = itertools.count(1)
        self._readers: dict[int, list[tuple[Client, int]]] = {}
        """Who wants a channel, and by which number."""
        self._about = About(name)
        self._place: Place | None = None
        self._nodes: frozenset[str] = frozenset()
        self._renewing: asyncio.TimerHandle | None = None
        self._services: dict[int, ServedService] = {}
        """All that there are and were."""
        self._again: asyncio.TimerHandle | None = None
        self._tasks: set[asyncio.Task[None]] = set()
        self._leaving: set[Future[None]] = set()
        self._room = threading.Semaphore(_MOST_BATCHES)
        self._closed = False
        self._beats = itertools.count(1)
        self.presence = Presence(session, self._soon(self._renew_soon))
        self.playback = Playback(session, self._soon(self._played))
        self.feed = Feed(
            session, self._hand_over, self._soon(self._refused), self.presence.is_published, self.playback.now
        )
        self._watch = ParameterWatch(session, self._soon(self._audience.tell_parameters), covers)
        self._tasks.add(self._loop.create_task(self._beat()))

    def join(self, *, drives: bool, knows_playback: bool) -> Client:
        """A viewer has connected."""
        name = f"viewer {next(self._names)}"
        publications = Publications(self.session, name, self.driving.drivers, self.covers)
        client = Client(name, publications, drives=drives, knows_playback=knows_playback)
        client.say(self._about.info(client))
        client.offer(None, self.offer)
        client.tell_unknown(self.offer.unknown)
        if self._place is not None and knows_playback:
            client.say(self._place.state())
        self._audience.welcome(client)
        self.want()
        return client

    def leave(self, client: Client) -> None:
        """A viewer is gone."""
        self.clients.discard(client)
        client.subscriptions.clear()
        if (done := client.close()) is not None:
            self._leaving.add(done)
            done.add_done_callback(self._leaving.discard)
        self.want()
        self.watch()

    def want(self) -> None:
        """Receive what clients want, and nothing else."""
        self._readers = {}
        for client in self.clients:
            for number, wanted in client.subscriptions.items():
                self._readers.setdefault(wanted.channel, []).append((client, number))
        topics = [self.offer.topics[channel] for channel in self._readers if channel in self.offer.topics]
        if not self._closed:
            self.feed.want(topics, clock=self.offer.has_clock and bool(self.clients))

    def watch(self) -> None:
        """Hear of changed parameters, as long as a client wants to."""
        self._watch.set(any(client.watched is None or client.watched for client in self.clients))

    def say_again(self, readers: Sequence[tuple[Client, int]], topic: Topic) -> None:
        """Clients get, by their subscriptions, what a latched topic has said last: they come late, or forgot it."""

        async def ask() -> None:
            found = await self._loop.run_in_executor(self.pools.own, self.feed.kept, topic)
            for delivery in found:
                for client, number in readers:
                    self._give(client, number, delivery, is_kept=True)

        self.do(ask())

    def say_all_again_soon(self) -> None:
        """Viewers forget all in a new session and when time goes back, and ask for nothing: maps would be lost."""
        if self._again is None and not self._closed:
            self._again = self._loop.call_later(_AGAIN, self._say_all_again)

    def _say_all_again(self) -> None:
        self._again = None
        for channel, readers in self._readers.items():
            topic = self.offer.topics.get(channel)
            if topic is not None and topic.latched:
                for client, number in readers:
                    if (wanted := client.subscriptions.get(number)) is not None:
                        wanted.numbers.clear()
                self.say_again(readers, topic)

    def service(self, number: int) -> ServedService | None:
        """A service by its number, also one that was there: its node may just begin anew."""
        return self._services.get(number)

    def do(self, work: Coroutine[Any, Any, None]) -> None:
        """Have something done that is not waited for."""
        task = self._loop.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._over)

    def _over(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            self._tell_once(f"the bridge has failed: {type(error).__name__}: {error}")

    async def close(self) -> None:
        """Everything ends, with its threads."""
        self._closed = True
        for timer in (self._renewing, self._again):
            if timer is not None:
                timer.cancel()
        for task in (tasks := list(self._tasks)):
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        for client in list(self.clients):
            self.leave(client)
        wait(list(self._leaving), _END)  # while there still is a network by which robots are told to stand
        for part in (self.presence, self._watch, self.playback, self.feed, self.driving):
            part.close()

    def _soon(self, work: Callable[..., None]) -> Callable[..., None]:
        """The same, to be called by any thread."""

        def call(*what: object) -> None:
            if not self._closed:
                self._loop.call_soon_threadsafe(partial(work, *what))

        return call

    def _hand_over(self, found: list[Delivery], now: int | None) -> None:
        """Called by the thread that receives: it waits where the event loop is behind."""
        while not (self._closed or self._room.acquire(timeout=0.2)):
            pass
        if not self._closed:
            self._loop.call_soon_threadsafe(self._deliver, found, now)

    def _deliver(self, found: Iterable[Delivery], now: int | None) -> None:
        self._room.release()
        if now is not None:
            self._say_time(now)
        for delivery in found:
            for client, number in self._readers.get(delivery.channel, ()):
                self._give(client, number, delivery)

    def _say_time(self, now: int) -> None:
        if self._audience.say_time(now):
            self.say_all_again_soon()

    def _give(self, client: Client, number: int, delivery: Delivery, *, is_kept: bool = False) -> None:
        wanted = client.subscriptions.get(number)
        if wanted is None or wanted.channel != delivery.channel:
            return
        if delivery.source:
            topic = self.offer.topics.get(delivery.channel)
            if topic is not None and topic.latched:
                if is_kept and delivery.number <= wanted.numbers.get(delivery.source, -1):
                    return  # it has come meanwhile
                if len(wanted.numbers) < _MOST_SOURCES:
                    wanted.numbers[delivery.source] = delivery.number
        client.put(number, delivery.time, delivery.data)

    def _renew_soon(self) -> None:
        if self._renewing is None:
            self._renewing = self._loop.call_later(_SETTLE, lambda: self.do(self._renew()))

    async def _renew(self) -> None:
        """Look at what there is, and tell everyone what has changed."""
        ends, nodes = self.presence.ends(), self.presence.nodes()
        try:
            found = await self._loop.run_in_executor(self.pools.own, offer, ends, self._numbers, self.covers)
        except Exception as error:  # nobody has thought of it: the next change is looked at all the same
            self._tell_once(f"what there is cannot be offered: {type(error).__name__}: {error}")
            return
        finally:
            self._renewing = None
        before, self.offer = self.offer, found
        self._services = (self._services if len(self._services) < _MOST_SERVICES else {}) | found.services
        if (self.presence.ends(), self.presence.nodes()) != (ends, nodes):
            self._renew_soon()
        news = {name: why for name, why in found.unknown.items() if name not in before.unknown}
        for name, why in news.items():
            self._tell_once(f"{name}: {why}")
        if robots := robots_drawn_into_one(found):
            self._tell_once(f"3D panels draw {' and '.join(robots[:3])} into one: --robot-name offers one robot alone")
        for client in self.clients:
            client.offer(before, found)
            client.tell_unknown(news)
        self.playback.follow(found.players[0] if found.players else "")
        self._look_at_times()
        self.want()
        came, self._nodes = nodes - self._nodes, nodes
        if came:
            for client in self.clients:
                if client.wants_all_parameters:
                    self.do(tell_all_parameters(self, client))

    def _look_at_times(self) -> None:
        if self._about.look(has_clock=self.offer.has_clock, place=self._place):
            for client in self.clients:
                client.say(self._about.info(client))
            self.say_all_again_soon()

    def _played(self, place: Place | None, jumped: bool) -> None:
        self._place = place
        self._look_at_times()
        if jumped:
            self.say_all_again_soon()
        for client in self.clients:
            if client.knows_playback and place is not None:
                client.say(place.state(jumped=jumped))

    def _refused(self, topic: str, why: str) -> None:
        if self._tell_once(f"{topic}: a message cannot be shown: {why}"):
            self._audience.status(protocol.WARNING, f"{topic}: a message cannot be shown: {why}")

    async def _beat(self) -> None:
        while True:
            await asyncio.sleep(_BEAT)
            if not self.offer.has_clock and (played := self.playback.now()) is not None:
                self._say_time(played)
            self._audience.look_at_link()
            if next(self._beats) % _SLOW == 0:
                self._audience.tell_left_out(self.offer, self._loop.time())


async def tell_all_parameters(bridge: Bridge, client: Client, id_: str | None = None) -> None:
    """Tell a client the parameters of all nodes; `id_` is of its question, where it has asked."""
    work = partial(all_parameters, bridge.session, bridge.covers)
    found = await asyncio.get_running_loop().run_in_executor(bridge.pools.calls, work)
    if id_ is not None:
        client.say(protocol.word("parameterValues", parameters=found, id=id_))
    else:
        client.say_newest("parameters", protocol.word("parameterValues", parameters=found))
