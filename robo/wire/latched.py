"""Latched topics: whoever comes later gets the last messages of the publishers that are there.

A latched publisher is one of Zenoh's advanced publishers: it keeps its last messages, answers for them and has a
token, so that any Zenoh client may be the late one. The late reader is robo's own (the architecture page says why):
what tokens, replies and messages tell goes to the one thread that takes messages out; only the way there needs a lock.
"""

import threading
import time
from collections import deque
from collections.abc import Iterator
from functools import partial
from typing import Any, Literal

import zenoh

from robo.wire import codec, keys, liveliness
from robo.wire.keys import EndpointToken
from robo.wire.qos import KEEP_ALL
from robo.wire.targets import OF_ALL

ASK_TIMEOUT = 2.0
"""How long an answer may take, s. Meanwhile a publisher's newer messages wait behind what it has kept."""

ASK_AGAIN = (0.2, 0.3, 0.5, 1.0, 2.0, 5.0)
"""After how long one who has heard nothing asks again, s; the last one from then on. A token that is announced while
two routers are linking may be lost (zenoh 1.10.2, about one in three)."""

_MOST_PUBLISHERS = 1024
"""So many are remembered; a stranger that makes up ids fills no memory."""


class LatchedPublisher:
    """In the place of a `zenoh.Publisher`: it keeps the last messages, and says by itself whose they are."""

    def __init__(
        self,
        session: zenoh.Session,
        topic: str,
        depth: int,
        encoding: str,
        congestion_control: zenoh.CongestionControl,
        priority: zenoh.Priority,
    ) -> None:
        """`depth` says how many messages it keeps."""
        from zenoh import ext  # nodes carry it only if they need it

        # A session that stands before Zenoh's, as a test's, declares it itself.
        declare: Any = getattr(session, "declare_advanced_publisher", None)
        self._publisher = (declare or partial(ext.declare_advanced_publisher, session))(
            topic,
            encoding=encoding,
            congestion_control=congestion_control,
            priority=priority,
            cache=ext.CacheConfig(max_samples=depth),
            # It counts its messages: else it wants `timestamping`, a setting of the whole session.
            sample_miss_detection=ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=None),
            publisher_detection=True,
        )
        self._session = session
        self._topic = topic
        self._plain: zenoh.Publisher | None = None
        self.id: zenoh.EntityGlobalId = self._publisher.id
        self.put = self._publisher.put

    @property
    def matching_status(self) -> object:
        """Whether anybody listens: an advanced publisher cannot tell, so a plain one is asked."""
        if self._plain is None:
            self._plain = self._session.declare_publisher(self._topic)
        return self._plain.matching_status

    def undeclare(self) -> None:
        """Stop publishing; nobody gets any more what it has said.

        Raises:
            RuntimeError: another thread is just in a `put`.
        """
        self._publisher.undeclare()
        if self._plain is not None:
            self._plain.undeclare()


def kept(
    session: zenoh.Session, key: str, depth: int, timeout: float = ASK_TIMEOUT, *, whole: bool = True
) -> Iterator[zenoh.Sample]:
    """What latched publishers of a key expression have said last, of each in order.

    Args:
        session: the network.
        key: of the topics; or that of a publisher's token.
        depth: how many messages of each; KEEP_ALL for all that they keep.
        timeout: how long to wait for one that hangs, s.
        whole: whether the key is of topics.
    """
    for reply in session.get(keys.latched_key(key, depth, whole=whole), timeout=timeout, **_OF_ALL):
        if reply.ok is not None:
            yield reply.ok


_OF_ALL: dict[str, Any] = {**OF_ALL, "accept_replies": zenoh.ReplyKeyExpr.ANY}


class LatchedSubscriber:
    """In the place of a `zenoh.Subscriber` with a channel: what was said before comes first, nothing older later."""

    def __init__(self, session: zenoh.Session, topic: str, depth: int, slots: int) -> None:
        """
        Args:
            session: the network.
            topic: the key expression.
            depth: how many messages of each publisher come first; KEEP_ALL for all that it keeps.
            slots: how many new ones may wait; then the oldest are left out, or with KEEP_ALL the sender waits.
        """
        self.key_expr = topic
        self.handler = channel = Inflow(partial(self._ask, session, depth), topic, slots, waits=depth == KEEP_ALL)
        # On Zenoh's own threads, as all of it is quick; tokens first, so that publishers are known before they speak.
        listen, at_once = partial(liveliness.hear, session), partial(zenoh.handlers.Callback, indirect=False)
        nodes, keeping = keys.tokens_of_publishers(topic), keys.tokens_of_latched(topic)
        self._ends: list[Any] = [
            listen(nodes, at_once(partial(channel.post, "node"))),
            listen(keeping, at_once(partial(channel.post, "keeper"))),
            session.declare_subscriber(topic, at_once(channel.take)),
        ]

    def undeclare(self) -> None:
        """Receive no more."""
        for end in self._ends:
            end.undeclare()
        self.handler.close()

    def _ask(self, session: zenoh.Session, depth: int, key: str, publisher: str) -> None:
        """Ask one publisher, by the key of its token; or all of a topic, where it is empty."""
        channel = self.handler

        def tell(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                channel.post("kept", reply.ok)

        handler = zenoh.handlers.Callback(tell, partial(channel.post, "done", publisher), indirect=False)
        selector = keys.latched_key(key, depth, whole=not publisher)
        session.get(selector, handler, timeout=ASK_TIMEOUT, **_OF_ALL)


What = Literal["node", "keeper", "kept", "done"]


class Inflow:
    """A channel of messages in order, as `Order` has it. Any thread may put in; one takes out and does all the work."""

    def __init__(self, ask: Any, topic: str, slots: int, *, waits: bool) -> None:
        """
        Args:
            ask: asks the publisher of a token's key, and its id; or all of a topic, with an empty id.
            topic: which.
            slots: how many messages may wait.
            waits: whether who puts in one more waits, rather than that the oldest is left out.
        """
        self._ask = ask
        self._topic = topic
        self._slots = slots
        self._waits = waits
        self._changed = threading.Condition()
        self._news: deque[tuple[What, Any]] = deque()
        self._new: deque[zenoh.Sample] = deque()
        self._closed = False
        self._order = Order()
        self._ready: deque[zenoh.Sample] = deque()
        self._held: dict[str, list[zenoh.Sample]] = {}
        """By publishers that are being asked, what they have said meanwhile."""
        self._heard = False
        """Whether anything latched has come."""
        self._pauses = iter(ASK_AGAIN)
        self._pause = next(self._pauses)
        self._again = time.monotonic() + self._pause

    def post(self, what: What, news: Any = None) -> None:
        """Put in a token, a reply, or the end of the replies of a publisher."""
        with self._changed:
            self._news.append((what, news))
            self._changed.notify_all()

    def take(self, sample: zenoh.Sample) -> None:
        """Put in a message as it is published."""
        with self._changed:
            if self._waits:
                self._changed.wait_for(lambda: len(self._new) < self._slots or self._closed)
            elif len(self._new) >= self._slots:
                self._new.popleft()
            self._new.append(sample)
            self._changed.notify_all()

    def close(self) -> None:
        """Nothing comes any more."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def recv(self) -> zenoh.Sample:
        """The next message; raises ZError once the subscription is over, as Zenoh's channels do."""
        while True:
            sample = self.try_recv()
            if sample is not None:
                return sample
            with self._changed:
                if not self._news and not self._new:
                    if self._closed:
                        raise zenoh.ZError("closed")
                    self._changed.wait(None if self._heard else max(0.0, self._again - time.monotonic()))

    def try_recv(self) -> zenoh.Sample | None:
        """The next message that is there already."""
        while not self._ready:
            if not self._heard and time.monotonic() >= self._again and not self._closed:
                self._pause = next(self._pauses, self._pause)
                self._again = time.monotonic() + self._pause
                self._ask(self._topic, "")
            with self._changed:
                news = self._news.popleft() if self._news else None
                sample = self._new.popleft() if news is None and self._new else None
                self._changed.notify_all()
            if news is not None:
                self._learn(*news)
            elif sample is not None:
                self._pass(sample)
            else:
                return None
        return self._ready.popleft()

    def _learn(self, what: What, news: Any) -> None:
        if what == "node":
            self._meet(news)
        elif what == "keeper":
            key = str(news.key_expr)
            publisher = keys.latched_id(key)
            if news.kind == zenoh.SampleKind.PUT and publisher and publisher not in self._held and not self._closed:
                self._held[publisher] = []
                self._order.follow(publisher)
                self._ask(key, publisher)
        elif what == "kept":
            self._heard = True
            if news.source_info is not None:
                self._order.follow(keys.source_id(news.source_info.source_id))
            self._admit(news)
        else:
            for sample in self._held.pop(news, ()):
                self._admit(sample)

    def _meet(self, news: zenoh.Sample) -> None:
        token = keys.parse_token(str(news.key_expr))
        if isinstance(token, EndpointToken) and token.id:
            if news.kind == zenoh.SampleKind.PUT:
                self._order.meet(token.id, token.full_name)
            else:
                self._order.part(token.id)

    def _pass(self, sample: zenoh.Sample) -> None:
        source = sample.source_info
        held = self._held.get(keys.source_id(source.source_id)) if source is not None else None
        if held is not None:
            held.append(sample)
        else:
            self._admit(sample)

    def _admit(self, sample: zenoh.Sample) -> None:
        source = sample.source_info
        if source is not None:
            publisher = keys.source_id(source.source_id)
            stamp = codec.unpack_attachment(sample.attachment.to_bytes()) if sample.attachment is not None else None
            number = source.source_sn if stamp is None else stamp.sequence_number
            if not self._order.admits(publisher, number, 0 if stamp is None else stamp.source_time):
                return
        self._ready.append(sample)


class Order:
    """Tells what comes twice, or after something newer of the same latched publisher or of its node.

    A node that is started again has another publisher; where the one before comes back all the same, from behind a cut
    cable, what it had said last is old. The messages of others than latched publishers pass.
    """

    def __init__(self) -> None:
        self._nodes: dict[str, str] = {}
        """The node of each publisher that is there."""
        self._last: dict[str, int] = {}
        """The number of the last message of each publisher: it may have spoken before its token came."""
        self._latched: dict[str, None] = {}
        """The publishers that are, the newest last."""
        self._newest: dict[str, int] = {}
        """When the newest message of each that is there was published, ns since the epoch."""

    def follow(self, publisher: str) -> None:
        """A publisher is latched."""
        if len(self._latched) >= _MOST_PUBLISHERS:
            del self._latched[next(iter(self._latched))]
        self._latched[publisher] = None

    def meet(self, publisher: str, node: str) -> None:
        """A publisher is there, or there again."""
        if len(self._nodes) >= _MOST_PUBLISHERS:
            self.part(next(iter(self._nodes)))
        self._nodes[publisher] = node

    def part(self, publisher: str) -> None:
        """A publisher is gone: its node may come again with a clock that was set back."""
        self._nodes.pop(publisher, None)
        self._newest.pop(publisher, None)

    def admits(self, publisher: str, number: int, source_time: int) -> bool:
        """Whether neither this publisher nor another one of its node that is there has said something newer before."""
        last = self._last.get(publisher, -1)
        if publisher not in self._latched:
            self._say(publisher, max(number, last))
            return True
        if number <= last:
            return False
        node = self._nodes.get(publisher)
        if node is not None:
            others = (other for other, its in self._nodes.items() if its == node and other != publisher)
            if any(self._newest.get(other, 0) > source_time for other in others):
                return False
            self._newest[publisher] = source_time
        self._say(publisher, number)
        return True

    def _say(self, publisher: str, number: int) -> None:
        if publisher not in self._last and len(self._last) >= _MOST_PUBLISHERS:
            del self._last[next(iter(self._last))]
        self._last[publisher] = number
