"""Messages of all topics of a robot, taken out of Zenoh's channel in batches: nobody is woken for a single one.

The time of arrival of a message is then known from two looks at the channel and from when it was published: see
`windows.arrivals`.
"""

import threading
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any, NamedTuple

import zenoh

from robo.recording.conversion import Conversion, Converted, Offer
from robo.recording.windows import arrivals
from robo.wire import keys, names
from robo.wire.keys import EndpointToken
from robo.wire.qos import QoS
from robo.wire.shared_buffers import LARGE, is_torn

SLOTS = 8192
"""Messages that wait in the channel; of more the oldest are left out, and missing in the numbers."""

_ASK_TIMEOUT = 2.0
"""How long a latched publisher may take to say what it has said, s."""
_MOST_TOPICS = 10_000
"""Of which something is remembered: a stranger that makes up names fills no memory."""
_REMEMBERED = 100
"""Messages of a latched publisher that are known when they come twice."""


class Batch(NamedTuple):
    """What has come since the last look."""

    messages: list[Converted]
    large: bool
    """Whether messages are among them that hold shared memory of their publishers for as long as nobody looks."""


class Selection:
    """Which topics are wanted."""

    def __init__(self, wanted: Sequence[str], unwanted: Sequence[str]) -> None:
        """Both are key expressions.

        Raises:
            zenoh.ZError: one is none.
        """
        self.expressions = [zenoh.KeyExpr(key) for key in dict.fromkeys(wanted)]
        self._unwanted = [zenoh.KeyExpr(key) for key in unwanted]
        self._known: dict[str, int] = {}

    def of(self, key: str) -> int:
        """The number of the first expression that a topic is of, so that it counts once; -1 for one not wanted."""
        number = self._known.get(key)
        if number is None:
            number = self._find(zenoh.KeyExpr(key))
            if len(self._known) < _MOST_TOPICS:
                self._known[key] = number
        return number

    def _find(self, key: zenoh.KeyExpr) -> int:
        if any(one.intersects(key) for one in self._unwanted):
            return -1
        return next((number for number, one in enumerate(self.expressions) if one.intersects(key)), -1)


class FlightIntake:
    """Takes in messages, and what latched publishers have said before; `take` by one thread at a time."""

    def __init__(
        self, session: zenoh.Session, namespace: str, selection: Selection, tell: Callable[[str], None], now: int
    ) -> None:
        """
        Args:
            session: the network.
            namespace: of the robot.
            selection: which topics.
            tell: is told once of each topic that cannot be written down as it should.
            now: ns since the epoch.
        """
        self._session = session
        self._selection = selection
        self._last = now
        self._offers: dict[str, Offer] = {}
        self._changed: deque[str] = deque()
        self._said: deque[tuple[int, zenoh.Sample]] = deque()
        """What latched publishers had said before."""
        self._numbers: dict[str, deque[int]] = {}
        """By latched publisher, the numbers of its messages that have come."""
        self.torn = 0
        """Messages that were lost because this process was stopped while they were in shared memory."""
        self.conversion = Conversion(tell, lambda key: self._offers.get(key, Offer()))
        self._lock = threading.Lock()
        at_once = zenoh.handlers.Callback(self._meet, indirect=False)
        tokens = names.join(keys.PREFIX, namespace, "**/pub/*/*/*/*")
        self._ends: list[Any] = [
            session.declare_subscriber(key, zenoh.handlers.RingChannel(SLOTS)) for key in selection.expressions
        ]
        self._handlers = [(number, end.handler) for number, end in enumerate(self._ends)]
        self._ends.append(session.liveliness().declare_subscriber(tokens, at_once, history=True))

    def ask_again(self) -> None:
        """Ask all latched publishers once more what they have said: a token may have been lost. Returns at once."""
        for number, key in enumerate(self._selection.expressions):
            self._ask(number, f"{key}/@adv/**")

    def take(self, now: int) -> Batch:
        """What has come since the last look, in about the order in which it came; `now` is in ns since the epoch."""
        while self._changed:
            self.conversion.forget(self._changed.popleft())
        found: list[Converted] = []
        large = False
        convert, which = self.conversion.convert, self._selection.of
        for number, handler in self._handlers:
            try_recv = handler.try_recv
            while (sample := try_recv()) is not None:
                key = str(sample.key_expr)
                if which(key) != number or sample.kind != zenoh.SampleKind.PUT:
                    continue
                message = convert(key, now, sample)
                if len(sample.payload) >= LARGE:
                    large = True
                    if is_torn(sample.payload):
                        self.torn += 1
                        continue
                if message is not None and self._is_new(message):
                    found.append(message)
        times = arrivals([one.published if one.published != now else None for one in found], self._last, now)
        messages = [one._replace(arrived=at) for one, at in zip(found, times, strict=True)]
        self._last = now
        messages = [*self._kept(now), *messages] if self._said else messages
        messages.sort(key=_arrived)
        return Batch(messages, large)

    def close(self) -> None:
        """Take in no more."""
        for end in self._ends:
            end.undeclare()

    def _kept(self, now: int) -> Iterable[Converted]:
        """What was said before this began: it comes now."""
        while self._said:
            number, sample = self._said.popleft()
            key = str(sample.key_expr)
            if self._selection.of(key) == number and sample.kind == zenoh.SampleKind.PUT:
                message = self.conversion.convert(key, now, sample)
                if message is not None and self._is_new(message, kept=True):
                    yield message

    def _is_new(self, message: Converted, *, kept: bool = False) -> bool:
        """Whether a message has not come before, as one that a latched publisher has kept, or is newer than that."""
        qos = message.topic.qos
        if not qos.latched or message.source is None or message.sequence is None:
            return True
        came = self._numbers.get(message.source)
        if came is None:
            if len(self._numbers) >= _MOST_TOPICS:
                del self._numbers[next(iter(self._numbers))]
            came = self._numbers[message.source] = deque(maxlen=_REMEMBERED)
        if message.sequence in came or (kept and qos.depth == 1 and came and message.sequence < max(came)):
            return False
        came.append(message.sequence)
        return True

    def _meet(self, sample: zenoh.Sample) -> None:
        """A publisher is there. On a thread of Zenoh's."""
        token = keys.parse_token(str(sample.key_expr))
        if not isinstance(token, EndpointToken) or sample.kind != zenoh.SampleKind.PUT:
            return
        offer = Offer(token.qos, token.type_name)
        with self._lock:
            known = self._offers.get(token.topic)
            if known is None and len(self._offers) >= _MOST_TOPICS:
                return
            self._offers[token.topic] = _both(known, offer)
            if self._offers[token.topic] != known:
                self._changed.append(token.topic)
        if token.qos.latched and (number := self._selection.of(token.topic)) >= 0:
            self._ask(number, keys.latched_key(token.topic, token.qos.depth))

    def _ask(self, number: int, key: str) -> None:
        handler = zenoh.handlers.Callback(partial(self._hear, number), indirect=False)
        self._session.get(
            key,
            handler,
            timeout=_ASK_TIMEOUT,
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            accept_replies=zenoh.ReplyKeyExpr.ANY,
        )

    def _hear(self, number: int, reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            self._said.append((number, reply.ok))


def _arrived(message: Converted) -> int:
    return message.arrived


def _both(known: Offer | None, other: Offer) -> Offer:
    """What several publishers of a topic offer together: latched where one is, with the largest depth."""
    if known is None:
        return other
    type_ = known.type if known.type == other.type else ""
    latched = [one.qos for one in (known, other) if one.qos.latched]
    qos: QoS = max(latched, key=lambda one: one.depth) if latched else known.qos
    return Offer(qos, type_)
