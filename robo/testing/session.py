"""The network as a node under test sees it: what it publishes is noted, and what comes waits its turn.

It stands before a real Zenoh session and hands all on; only where threads of a node would wait for Zenoh, they
wait for the stepper.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator
from functools import partial
from typing import Any, NamedTuple

import zenoh
import zenoh.ext

from robo.testing.stepper import Call, Inbox, Stepper
from robo.wire import sources
from robo.wire.latched import kept


class Sent(NamedTuple):
    """A message that was published."""

    key: str
    payload: bytes
    type: str
    """The name of its type; empty where its publisher does not say."""


Note = Callable[[Sent], None]


class NodeSession:
    """The session of one node."""

    def __init__(self, session: zenoh.Session, stepper: Stepper, note: Note | None = None) -> None:
        """`note` takes what is published, in the thread that does so, in the place of `sent`."""
        self.sent: list[Sent] = []
        """All that was published, in order."""
        self._note: Note = note if note is not None else self.sent.append
        self.inboxes: list[tuple[str, Inbox]] = []
        """Those of its subscriptions, by key expression."""
        self.services: list[str] = []
        """The keys on which it answers, as it declared them."""
        self.topics: list[str] = []
        """The keys on which it publishes."""
        self.unheard: set[str] = set()
        """The keys on which nobody hears what it says from now on; it is noted all the same."""
        self._session = session
        self._stepper = stepper

    def __getattr__(self, name: str) -> Any:
        return getattr(self._session, name)

    def put(self, key: str, payload: Any, **more: Any) -> None:
        """Publish without a publisher."""
        self._note(Sent(str(key), bytes(zenoh.ZBytes(payload)), _type(more.get("encoding"))))
        if str(key) not in self.unheard:
            self._session.put(key, payload, **more)

    def declare_publisher(self, key: str, **more: Any) -> Any:
        """A publisher, whose messages are noted."""
        self.topics.append(key)
        publisher = self._session.declare_publisher(key, **more)
        return _Publisher(publisher, self._note, self.unheard, _type(more.get("encoding")))

    def declare_subscriber(self, key: str, handler: Any = None, **more: Any) -> Any:
        """A subscriber; where it is one with a channel, the stepper's is its."""
        if not isinstance(handler, zenoh.handlers.RingChannel | zenoh.handlers.FifoChannel):
            return self._session.declare_subscriber(key, handler, **more)
        inbox = Inbox(self._stepper)
        self.inboxes.append((key, inbox))
        handlers = _at_once(partial(self._stepper.post, inbox)), _Messages(inbox)
        return _Receiver(self._session.declare_subscriber(key, handlers, **more), inbox)

    def declare_advanced_publisher(self, key: str, **more: Any) -> Any:
        """A publisher that keeps what it has said, whose messages are noted."""
        self.topics.append(key)
        publisher = zenoh.ext.declare_advanced_publisher(self._session, key, **more)
        return _Publisher(publisher, self._note, self.unheard, _type(more.get("encoding")), signs=True)

    def declare_latched_subscriber(self, key: str, depth: int, _slots: int) -> Any:
        """A subscriber that begins with what was said before; the stepper's channel is its."""
        receiver = self.declare_subscriber(key, zenoh.handlers.FifoChannel(1))
        for sample in kept(self._session, key, depth):
            self._stepper.post(self.inboxes[-1][1], sample)
        return receiver

    def declare_queryable(self, key: str, handler: Any = None, **more: Any) -> Any:
        """A queryable; where it is one with a channel, the stepper's is its."""
        if not isinstance(handler, zenoh.handlers.RingChannel | zenoh.handlers.FifoChannel):
            return self._session.declare_queryable(key, handler, **more)
        inbox = Inbox(self._stepper)
        self.services.append(key)
        handlers = _at_once(partial(self._stepper.post_question, inbox)), _Questions(inbox, self._stepper)
        return _Receiver(self._session.declare_queryable(key, handlers, **more), inbox)

    def get(self, key: str, *arguments: Any, **more: Any) -> Any:
        """Ask; others run while the answers are waited for."""
        call = self._stepper.call()
        return _Answers(self._session.get(key, *arguments, **more), self._stepper, call)


class _Publisher:
    """Notes what is published and hands it on."""

    def __init__(
        self, publisher: Any, note: Note, unheard: Container[str], type_name: str, *, signs: bool = False
    ) -> None:
        """`unheard` has its key while nobody is to hear it; `signs` where it says by itself whose its messages are."""
        self._publisher = publisher
        self._note = note
        self._unheard = unheard
        self._key = str(publisher.key_expr)
        self._type = type_name
        self._source = None if signs else sources.counted(publisher.id)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._publisher, name)

    def put(self, payload: bytes, **more: Any) -> None:
        """Publish. Each message says whose it is: under a clock that is stepped all publishers are quick."""
        self._note(Sent(self._key, payload, self._type))
        if self._key in self._unheard:
            return
        if self._source is not None:
            more.setdefault("source_info", self._source())
        self._publisher.put(payload, **more)


class _Receiver:
    """A subscriber or queryable of Zenoh with an inbox."""

    def __init__(self, receiver: Any, inbox: Inbox) -> None:
        self._receiver = receiver
        self._inbox = inbox

    def __getattr__(self, name: str) -> Any:
        return getattr(self._receiver, name)

    def undeclare(self) -> None:
        """Receive no more."""
        self._receiver.undeclare()
        self._inbox.close()


class _Messages:
    """In the place of the channel of a subscription."""

    def __init__(self, inbox: Inbox) -> None:
        self._inbox = inbox

    def recv(self) -> Any:
        """The next one; raises ZError once the subscription is over, as Zenoh's channels do."""
        item = self._inbox.take()
        if item is None:
            raise zenoh.ZError("closed")
        return item

    def try_recv(self) -> None:
        """Nothing: there is one message at a time."""


class _Questions:
    """In the place of the channel of a service."""

    def __init__(self, inbox: Inbox, stepper: Stepper) -> None:
        self._inbox = inbox
        self._stepper = stepper

    def recv(self) -> Any:
        """The next one; raises ZError as Zenoh's channels do."""
        item = self._inbox.take()
        if item is None:
            raise zenoh.ZError("closed")
        query, call = item
        return _Question(query, call, self._stepper)


class _Question:
    """A query; it is answered once it is dropped, which may be long after it was taken."""

    def __init__(self, query: zenoh.Query, call: Call | None, stepper: Stepper) -> None:
        self._query = query
        self._call = call
        self._stepper = stepper

    def __getattr__(self, name: str) -> Any:
        return getattr(self._query, name)

    def __enter__(self) -> _Question:
        return self

    def __exit__(self, *_: object) -> None:
        self.drop()

    def drop(self) -> None:
        """Answer no more."""
        self._query.drop()
        call, self._call = self._call, None
        self._stepper.answered(call)


class _Answers:
    """The answers to a question."""

    def __init__(self, replies: Any, stepper: Stepper, call: Call | None) -> None:
        self._replies = replies
        self._stepper = stepper
        self._call = call

    def __getattr__(self, name: str) -> Any:
        return getattr(self._replies, name)

    def __iter__(self) -> Iterator[Any]:
        replies = iter(self._replies)
        while True:
            with self._stepper.asking(self._call):
                reply = next(replies, None)
            if reply is None:
                return
            yield reply


def _at_once(callback: Callable[[Any], None]) -> Any:
    """Zenoh calls it in the thread that publishes or asks."""
    return zenoh.handlers.Callback(callback, indirect=False)


def _type(encoding: object) -> str:
    """The name of the type of which an encoding speaks."""
    return str(encoding or "").partition(";")[2]
