"""Receiving what is recorded, without ever holding up who publishes.

A thread for each expression blocks in Zenoh's channel and puts each message with the time of its arrival into a row;
whoever records takes out all that has come, some twenty times a second. A callback on Zenoh's own threads costs twice
as much, for they have to wait for Python. What waits has a limit in bytes; beyond it new messages are left out and
counted.
"""

import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any

import zenoh

from robo.recording.conversion import Came
from robo.recording.latched import LatchedFirst
from robo.recording.offers import Offers
from robo.recording.selection import Selection
from robo.wire import keys, liveliness
from robo.wire.keys import EndpointToken
from robo.wire.latched import ASK_TIMEOUT, kept
from robo.wire.qos import KEEP_ALL
from robo.wire.targets import OF_ALL

MOST_BYTES = 256_000_000
"""What may wait to be written down."""

LONGEST_LOOK = 0.5
"""How long to wait, at first, for a latched publisher that does not say what it keeps, s."""

ASK_AGAIN = (1.0, 5.0)
"""After how long all latched publishers are asked once more, s: a token that is announced while two routers are
linking may be lost (zenoh 1.10.2, about one in three)."""

LIVE, _KEPT, _DONE, _PUBLISHER, _KEEPER = range(5)


class Intake:
    """The messages of a selection. `take` is called by one thread at a time."""

    def __init__(
        self,
        session: zenoh.Session,
        selection: Selection,
        most_bytes: int = MOST_BYTES,
        offer_changed: Callable[[str], object] = lambda _: None,
        replaced: Callable[[str, str], object] = lambda _topic, _publisher: None,
    ) -> None:
        """
        Args:
            session: the network.
            selection: what is wanted.
            most_bytes: what may wait.
            offer_changed: is told, by the thread that takes, of each topic of which publishers say another thing now.
            replaced: is told, by that thread, of each latched publisher whose node has another one now: its topic and
                its id.
        """
        self._left_out: Counter[str] = Counter()
        self.offers = Offers(replaced)
        """What publishers say of their topics."""
        self._session = session
        self._selection = selection
        self._most_bytes = most_bytes
        self._offer_changed = offer_changed
        self._row: deque[tuple[int, int, Any, str, int]] = deque()
        """Times of arrival, what it is, what has come; of messages their topic and their bytes."""
        self._bytes = 0
        self._taken = 0
        self._latched = LatchedFirst()
        self._closed = False
        self._threads: list[threading.Thread] = []
        self._begin()
        begun = time.monotonic()
        self._ask_at = [begun + pause for pause in ASK_AGAIN]

    def take(self) -> list[Came]:
        """All that has come since it was called last, in order; at first what latched topics have said before."""
        found = self._take_first()
        if self._ask_at and time.monotonic() >= self._ask_at[0] and not self._closed:
            del self._ask_at[0]
            for key in self._selection.keys:
                self._ask(key, "", whole=True)
        row, latched = self._row, self._latched
        taken = 0
        for _ in range(len(row)):
            arrived, kind, sample, key, size = row.popleft()
            if kind != LIVE:
                found += self._learn(arrived, kind, sample)
                continue
            taken += size
            came = Came(key, arrived, sample)
            if key in latched:
                found += latched.live(came)
            else:
                found.append(came)
        self._taken += taken
        found += latched.all_held() if self._closed else latched.overdue()
        if not row:  # what threads have added at the same moment may have been lost
            self._bytes = self._taken = 0
        return found

    def left_out(self) -> Counter[str]:
        """How many messages were not handed out, as too many waited, so far: by topic. Who counts sequence numbers
        finds them missing.
        """
        return Counter(dict(self._left_out))  # copied at once: other threads count

    def close(self) -> None:
        """Receive no more; what has come may still be taken."""
        self._closed = True
        for end in self._ends:
            with suppress(zenoh.ZError):  # the network has been left already
                end.undeclare()
        for thread in self._threads:  # what is in its channel comes before the end
            thread.join(_END)

    def _begin(self) -> None:
        """Listen; tokens first, so that publishers are known before they speak."""
        listen = partial(liveliness.hear, self._session)
        expressions = self._selection.keys
        begin = time.time_ns()
        tokens = keys.tokens_of_publishers("*")
        self._ends: list[Any] = [listen(tokens, _at_once(partial(self._post, _PUBLISHER)))]
        self._ends += [self._subscribe(number, key) for number, key in enumerate(expressions)]
        # What was said before has come, as a recording has it, before all that is said from now on.
        self._first = [
            (begin, sample) for key in expressions for sample in kept(self._session, key, KEEP_ALL, LONGEST_LOOK)
        ]
        keepers = partial(self._post, _KEEPER)
        self._ends += [listen(keys.tokens_of_latched(key), _at_once(keepers)) for key in expressions]

    def _take_first(self) -> list[Came]:
        first, self._first = self._first, []
        if not first:
            return []
        # Publishers are known first: what they offer stands in the file before what they say.
        for arrived, kind, news, *_ in [one for one in list(self._row) if one[1] == _PUBLISHER]:
            self._learn(arrived, kind, news)
        return [came for arrived, sample in first for came in self._learn(arrived, _KEPT, sample)]

    def _subscribe(self, number: int, key: str) -> Any:
        """Begin to receive one of the selection's expressions, by its number."""
        subscriber = self._session.declare_subscriber(key, zenoh.handlers.FifoChannel(_CHANNEL))
        drain = threading.Thread(target=self._drain, args=(number, subscriber.handler), name="robo-intake", daemon=True)
        self._threads.append(drain)
        drain.start()
        return subscriber

    def _drain(self, number: int, handler: "zenoh.handlers.Handler[zenoh.Sample]") -> None:
        recv, append, now = handler.recv, self._row.append, time.time_ns
        source_of, put = self._selection.source, zenoh.SampleKind.PUT
        while True:
            try:
                sample = recv()
            except zenoh.ZError:
                return  # undeclared
            arrived, key = now(), str(sample.key_expr)
            if source_of(key) != number or sample.kind != put:
                continue
            attachment = sample.attachment
            size = len(sample.payload) + (len(attachment) if attachment is not None else 0) + _SAMPLE
            if self._bytes - self._taken + size > self._most_bytes and self._row:
                if key in self._left_out or len(self._left_out) < _MOST_LEFT_OUT:
                    self._left_out[key] += 1
                continue
            self._bytes += size
            append((arrived, LIVE, sample, key, size))

    def _post(self, kind: int, news: Any = None) -> None:
        """Called by Zenoh's threads."""
        if len(self._row) < _MOST_NEWS or kind == _DONE:
            self._row.append((time.time_ns(), kind, news, "", 0))

    def _learn(self, arrived: int, kind: int, news: Any) -> list[Came]:
        """What follows of a token, a reply, or the end of the replies of a publisher."""
        if kind == _DONE:
            return self._latched.done(news)
        key = str(news.key_expr)
        if kind == _KEPT:
            if self._selection.source(key) < 0:
                return []
            if self.offers.latch(key):  # its token is still on its way, or it is no node's
                self._offer_changed(key)
            return self._latched.kept(Came(key, arrived, news))
        is_there = news.kind == zenoh.SampleKind.PUT
        if kind == _PUBLISHER:
            self._meet(keys.parse_token(key), is_there=is_there)
        elif is_there and (publisher := keys.latched_id(key)):
            topic = key.rpartition("/@adv/pub/")[0]
            if self._selection.source(topic) >= 0 and not self._closed and self._latched.keeper(topic, publisher):
                self._ask(key, publisher, whole=False)
        return []

    def _meet(self, token: keys.Token | None, *, is_there: bool) -> None:
        if not isinstance(token, EndpointToken) or self._selection.source(token.topic) < 0:
            return
        if is_there:
            self._latched.meet(token)
            if self.offers.put(token):
                self._offer_changed(token.topic)
        else:
            self._latched.part(token)
            self.offers.delete(token)

    def _ask(self, key: str, publisher: str, *, whole: bool) -> None:
        """Ask one publisher for what it has said, by the key of its token; or all of a topic."""

        def tell(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                self._post(_KEPT, reply.ok)

        done = partial(self._post, _DONE, publisher)
        handler = zenoh.handlers.Callback(tell, done, indirect=False)
        self._session.get(
            keys.latched_key(key, KEEP_ALL, whole=whole),
            handler,
            accept_replies=zenoh.ReplyKeyExpr.ANY,
            timeout=ASK_TIMEOUT,
            **OF_ALL,
        )


_CHANNEL = 10_000
"""Messages that Zenoh may hand over before the thread has run."""
_SAMPLE = 1_200
"""Bytes that a message takes while it waits, beside its payload (zenoh 1.10.2)."""
_MOST_LEFT_OUT = 10_000
"""Topics of which what is left out is counted."""
_END = 1.0
"""How long what is in a channel may take at the end, s."""
_MOST_NEWS = 1_000_000
"""Tokens and replies that may wait."""


def _at_once(act: Callable[[Any], None]) -> Any:
    """A handler on Zenoh's own thread: no thread more has to be woken."""
    return zenoh.handlers.Callback(act, indirect=False)
