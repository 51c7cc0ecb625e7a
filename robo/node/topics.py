"""A node's live ends of topics: what `create_publisher` and `create_subscription` return."""

import itertools
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from datetime import UTC, datetime, timedelta
from functools import partial
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar

import msgspec
import zenoh

import robo_messages
from robo.node.clock import Clock
from robo.node.intake import Intake
from robo.node.loops import SubscriptionLoop
from robo.node.message_check import MessageCheck
from robo.node.shapes import BYTES, holds
from robo.node.turn import Turn
from robo.wire import codec, sources
from robo.wire.keys import EndpointKind, EndpointToken, source_id
from robo.wire.qos import KEEP_ALL, QoS, zenoh_priority
from robo.wire.reports import Refused
from robo_messages import Message

if TYPE_CHECKING:
    from robo.node.large import Carrier
    from robo.wire.latched import LatchedPublisher

M = TypeVar("M", bound=Message)
P = TypeVar("P", bound=Message, contravariant=True)


LONGEST_PUT = 0.2
"""How long a publisher waits, when it is undeclared, for other threads that publish, s."""


LONGEST_AGE = 1e9
"""The age that is told of what is older, or of an age that nobody knows, s: 30 years."""

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


FLOOD = 10_000
"""A publisher that sends more than so many messages a second leaves its id out of them, Hz."""

_COUNTED = 32
"""After so many messages a publisher looks how fast they went."""


class Publish(Protocol[P]):
    """`publish` of a publisher."""

    def __call__(self, message: P, age: float = 0.0) -> None:
        """Send one message; it gets the next sequence number and the time of now.

        Args:
            message: what to send.
            age: how long ago it was said, s, where it passes on what others have said: whoever receives
                it counts its age from then. Infinity, or NaN, where that is not known.
        """


class Endpoint:
    """One end of a topic and the token that announces it."""

    def __init__(self, session: zenoh.Session, token: EndpointToken) -> None:
        self.announced = token
        self._token = session.liveliness().declare_token(token.key())

    @property
    def topic(self) -> str:
        """The topic's key expression, after namespace and remapping."""
        return self.announced.topic

    @property
    def qos(self) -> QoS:
        """What holds of it, what its launch says included."""
        return self.announced.qos

    def undeclare(self) -> None:
        """Withdraw the announcement."""
        self._token.undeclare()


class TopicPublisher(Endpoint, Generic[M]):
    """Publishes messages of one type on one topic."""

    publish: Publish[M]
    """Send one message; it gets the next sequence number and the time of now. Once the node has stopped
    it sends nothing: a thread of one's own need not know the moment.

    Raises:
        TypeError: it is no message of the topic's type, or a field holds something that cannot be sent or
            (see `message_check` for when this is noticed) is of another type than declared.
    """

    def __init__(
        self, session: zenoh.Session, token: EndpointToken, message_type: type[M], clock: Clock | None = None
    ) -> None:
        """`clock` says what messages are stamped with; by default the wall clock."""
        self.zenoh_publisher = _declare_publisher(session, token, codec.encoding_of(message_type))
        with ExitStack() as made:
            made.callback(self.zenoh_publisher.undeclare)
            super().__init__(session, msgspec.structs.replace(token, id=source_id(self.zenoh_publisher.id)))
            made.pop_all()
        self._numbers = itertools.count(1)
        self.publish, self._silence = _fast_publish(
            self.zenoh_publisher,
            token.qos.latched,
            message_type,
            token.topic,
            self._numbers,
            session.new_timestamp().get_id(),
            (clock or Clock()).time_ns,
            _carrier(session, message_type, token.qos),
        )
        if token.qos.latched:
            self.publish = _in_order(self.publish)

    @property
    def id(self) -> str:
        """Zenoh's id of it, which its messages carry: `MessageInfo.source_id` of those who receive them."""
        return self.announced.id

    @property
    def published(self) -> int:
        """Messages published so far."""
        # The next number, as its text has it: whoever publishes pays nothing for being counted.
        return int(repr(self._numbers)[len("count(") : -1]) - 1

    @property
    def has_subscribers(self) -> bool:
        """Whether anybody on the network listens."""
        status: Any = self.zenoh_publisher.matching_status  # zenoh's stub says bool, it is an object
        return bool(status.matching)

    def undeclare(self) -> None:
        """Stop publishing."""
        self._silence()
        super().undeclare()
        _undeclare_when_free(self.zenoh_publisher)


def _declare_publisher(
    session: zenoh.Session, token: EndpointToken, encoding: str
) -> "zenoh.Publisher | LatchedPublisher":
    qos = token.qos
    control = zenoh.CongestionControl.BLOCK if qos.reliable else zenoh.CongestionControl.DROP
    priority = zenoh_priority(qos.priority)
    if qos.latched:
        from robo.wire.latched import LatchedPublisher  # nodes carry it only if they need it

        return LatchedPublisher(session, token.topic, qos.depth, encoding, control, priority)
    return session.declare_publisher(token.topic, encoding=encoding, congestion_control=control, priority=priority)


def _carrier(session: zenoh.Session, message_type: type[M], qos: QoS) -> "Carrier[M] | None":
    """What puts its large messages into shared memory; latched ones would hold it for as long as they are kept."""
    if qos.latched or not holds(message_type, BYTES):
        return None
    from robo.node.large import carrier_of  # nodes carry it only if they need it

    return carrier_of(session, message_type, wait=qos.reliable)


def _declare_subscriber(session: zenoh.Session, token: EndpointToken, slots: int) -> Any:
    depth = token.qos.depth
    if token.qos.latched:
        from robo.wire.latched import LatchedSubscriber

        # A session that stands before Zenoh's, as a test's, has its own.
        declare: Any = getattr(session, "declare_latched_subscriber", partial(LatchedSubscriber, session))
        return declare(token.topic, depth, slots)
    channel_type: Any = zenoh.handlers.FifoChannel if depth == KEEP_ALL else zenoh.handlers.RingChannel
    return session.declare_subscriber(token.topic, channel_type(slots))


def _undeclare_when_free(publisher: "zenoh.Publisher | LatchedPublisher") -> None:
    """Zenoh refuses, with a RuntimeError, while another thread is just in a `put`."""
    end = time.monotonic() + LONGEST_PUT
    while True:
        try:
            publisher.undeclare()
        except RuntimeError:
            if time.monotonic() > end:
                return  # the put waits for a receiver; both end with the session
            time.sleep(0.0005)
        else:
            return


def _fast_publish(
    publisher: "zenoh.Publisher | LatchedPublisher",
    signs: bool,
    message_type: type[M],
    topic: str,
    numbers: Iterator[int],
    clock_id: zenoh.TimestampId,
    time_ns: Callable[[], int],
    carrier: "Carrier[M] | None",
) -> tuple[Publish[M], Callable[[], None]]:
    """`publish`, and what makes it send nothing any more.

    As closures: attribute look-ups would cost a tenth of the whole call. `signs` where the publisher says by itself
    whose its messages are.
    """
    bare: Callable[..., None] = publisher.put
    signed = bare if signs else _signing(publisher)
    put: Callable[..., None] = signed
    encode = msgspec.msgpack.Encoder().encode
    # pack_attachment(1, now), pack_attachment(2, now), …: one call that runs in C from end to end, so
    # it is quick and any thread may publish.
    stamp = map(codec.pack_attachment, numbers, iter(time_ns, None)).__next__
    check = MessageCheck(message_type, topic)
    checked = -1  # the size of the last message that was looked at
    left, begun = _COUNTED, time.monotonic()
    silent = False

    def publish(message: M, age: float = 0.0) -> None:
        nonlocal checked, left
        if message.__class__ is not message_type and not isinstance(message, message_type):
            raise TypeError(f"{topic} takes {robo_messages.type_name(message_type)}, not {type(message).__name__}")
        payload = carrier(message, check) if carrier is not None else None
        if payload is None:
            payload = encode(message)
            if len(payload) != checked:
                checked = check(payload)
        left -= 1
        if left <= 0:
            look_at_the_pace()
        try:
            if age:
                put(payload, attachment=stamp(), timestamp=_said(age, time_ns(), clock_id))
            else:
                put(payload, attachment=stamp())
        except zenoh.ZError:
            if not silent:  # else undeclared between the look-up of `put` and its call
                raise

    def look_at_the_pace() -> None:
        nonlocal put, left, begun
        now = time.monotonic()
        if not silent:
            put = signed if now - begun > _COUNTED / FLOOD else bare
        left, begun = _COUNTED, now

    def silence() -> None:
        nonlocal put, silent
        put, silent = _nowhere, True

    return publish, silence


def _in_order(publish: Publish[M]) -> Publish[M]:
    """`publish`, one message after the other.

    Of two that threads sent at once, a later reader of a latched topic would get the other one as the last.
    """
    lock = threading.Lock()

    def ordered(message: M, age: float = 0.0) -> None:
        with lock:
            publish(message, age)

    return ordered


def _said(age: float, now: int, clock_id: zenoh.TimestampId) -> zenoh.Timestamp:
    """When something was said, `age` s before `now`, ns since the epoch."""
    known = age if age < LONGEST_AGE else LONGEST_AGE
    then = _EPOCH + timedelta(microseconds=now / 1000) - timedelta(seconds=known)
    return zenoh.Timestamp(max(_EPOCH, then), clock_id)


def _signing(publisher: "zenoh.Publisher | LatchedPublisher") -> Callable[..., None]:
    """`put` with the publisher's id. It costs both ends 1 µs, so a flood goes without."""
    put: Callable[..., None] = publisher.put
    source = sources.counted(publisher.id)

    def signed(payload: Any, **more: Any) -> None:
        put(payload, source_info=source(), **more)

    return signed


def _nowhere(_payload: object, **_more: object) -> None:
    """Take the place of `put` once the publisher has been undeclared."""


class TopicSubscription(Endpoint, Generic[M]):
    """Receives messages of one type from one topic."""

    def __init__(
        self,
        session: zenoh.Session,
        token: EndpointToken,
        message_type: type[M],
        turn: Turn,
        callback: Callable[..., object],
        on_error: Callable[[BaseException], None],
        on_malformed: Callable[[str, int, str, zenoh.Sample], None],
        intake: Intake | None = None,
    ) -> None:
        """`on_error` is told what the callback raised; `on_malformed` the topic, how many there were, why, and which.

        With an `intake` the callback takes what it makes of each sample as its second argument.
        """
        self._intake = intake
        self._on_malformed = on_malformed
        depth = token.qos.depth
        decoder = codec.Decoder(message_type)
        subscriber = _declare_subscriber(session, token, slots(message_type, depth))
        self._loop = SubscriptionLoop(
            subscriber,
            decoder,
            depth,
            turn,
            callback,
            on_error,
            self._report_malformed,
            intake.examine if intake is not None else None,
            may_be_shared=holds(message_type, BYTES),
        )
        with ExitStack() as made:
            made.callback(subscriber.undeclare)
            super().__init__(session, token)
            made.pop_all()

    @property
    def received(self) -> int:
        """Messages given to the callback so far."""
        return self._loop.received

    @property
    def malformed(self) -> int:
        """Payloads so far that were no message of this type; each was dropped."""
        return self._loop.malformed

    @property
    def dropped(self) -> int:
        """Messages so far that were dropped: the callback fell behind by more than `depth`, or they were too old."""
        return self._loop.dropped + (self._intake.expired if self._intake is not None else 0)

    @property
    def refused(self) -> list[Refused]:
        """Whose messages were left out so far because another source is the one."""
        return self._intake.refused if self._intake is not None else []

    def start(self) -> None:
        """Begin to call the callback."""
        self._loop.start()

    def stop(self, timeout: float) -> bool:
        """Take no more messages in. Returns whether the callback came back within `timeout` seconds."""
        self.undeclare()
        if self._intake is not None:
            self._intake.close()
        return self._loop.stop(timeout)

    def _report_malformed(self, reason: str, sample: zenoh.Sample) -> None:
        self._on_malformed(self.topic, self.malformed, reason, sample)


def endpoint_token(
    namespace: str, node: str, kind: EndpointKind, message_type: type[Message], qos: QoS, topic: str
) -> EndpointToken:
    """The announcement of an endpoint.

    Raises:
        robo_messages.UnknownType: the type was never registered.
    """
    return EndpointToken(namespace, node, kind, robo_messages.type_name(message_type), qos, topic)


def slots(message_type: type[Message], depth: int) -> int:
    """How many messages a subscription's channel holds.

    Room for several network batches makes a flood of small messages twice as quick (measured in
    `benchmarks/`). Messages that may be large get less, so that a full channel stays some megabytes.
    """
    if holds(message_type, BYTES):
        return depth or 16
    if holds(message_type, (list, dict)):
        return max(depth, 256) if depth else 2048
    return max(depth, 4096)
