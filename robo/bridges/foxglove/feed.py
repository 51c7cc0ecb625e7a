"""The topics that viewers want: received from Zenoh, made CDR, and handed on some fifty times a second.

Nothing runs for a single message: Zenoh keeps the newest ones of each topic, and one thread looks. What is not wanted
is not subscribed.
"""

import threading
import time
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import msgspec
import zenoh

from robo.bag.options import CDR
from robo.bridges.foxglove.offered import CLOCK, Topic
from robo.bridges.foxglove.trail import Trail
from robo.interfaces import cdr
from robo.recording.conversion import Converted
from robo.recording.forms import Form, form_of
from robo.recording.odometry import TransformsOfOdometry
from robo.text.unreadable import UNREADABLE
from robo.wire import codec
from robo.wire.codec import Malformed
from robo.wire.keys import source_id
from robo.wire.latched import kept
from robo.wire.qos import KEEP_ALL
from robo_messages import Clock, Odometry, Path

PERIOD = 0.02
"""How often somebody looks, s."""
_BEHIND = 100_000_000
"""What was published so recently came from this machine, or from one of its time: its time is the message's, ns."""
_LATCHED_WAIT = 0.5
"""For what latched publishers keep, s."""
_MOST_KEPT = 1_000
"""Messages of a latched topic that a late client gets."""
_MOST_FORMS = 10_000


class Delivery(NamedTuple):
    """A message for those who want it."""

    channel: int
    time: int
    """ns since the epoch, or by the clock of a simulation or of a recording."""
    data: bytes
    source: str
    """Who has sent it, and which of his it is: empty and 0 where he does not say."""
    number: int


class Feed:
    """Receives what is wanted."""

    def __init__(
        self,
        session: zenoh.Session,
        deliver: Callable[[list[Delivery], int | None], None],
        refuse: Callable[[str, str], None],
        is_published: Callable[[str], bool],
        play_time: Callable[[], int | None],
    ) -> None:
        """
        Args:
            session: the network.
            deliver: gets by a thread what has come, and what time it is where there is a clock.
            refuse: is told of each message that cannot be shown: its topic, and why.
            is_published: whether a node publishes a topic.
            play_time: how far a recording is played that has no clock, ns since the epoch; None where none is.
        """
        self._session, self._deliver, self._refuse, self._play_time = session, deliver, refuse, play_time
        self._transforms = TransformsOfOdometry(is_published)
        self._trails: dict[str, Trail] = {}
        self._decode_odometry, self._encode_path = cdr.decoder(Odometry), cdr.encoder(Path)
        self._forms: dict[tuple[str, str], Form] = {}
        self._decode_clock = codec.Decoder(Clock)
        self._clock: int | None = None
        self._changed = threading.Condition()
        self._ends: dict[str, zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]]] = {}
        self._routes: dict[str, list[Topic]] = {}
        self._over = False
        self._thread = threading.Thread(target=self._run, name="robo-foxglove-feed", daemon=True)
        self._thread.start()

    def want(self, topics: Iterable[Topic], *, clock: bool) -> None:
        """Receive these and no others.

        Args:
            topics: that clients want.
            clock: whether what time it is, is wanted too.
        """
        routes: dict[str, list[Topic]] = {}
        slots: dict[str, int] = {}
        for topic in topics:
            for source in topic.sources:
                routes.setdefault(source, []).append(topic)
                slots[source] = max(slots.get(source, 0), topic.slots if source == topic.key else 64)
        if clock:
            routes.setdefault(CLOCK, [])
        with self._changed:
            for key in self._ends.keys() - routes.keys():
                self._ends.pop(key).undeclare()
            for key in routes.keys() - self._ends.keys():
                count = slots.get(key, 1)
                self._ends[key] = self._session.declare_subscriber(key, zenoh.handlers.RingChannel(count))
            if not clock:
                self._clock = None
            self._routes = routes
            self._changed.notify()

    def kept(self, topic: Topic) -> list[Delivery]:
        """What latched publishers of a topic have said last; it blocks until all have told."""
        found = [
            self._delivery(topic, sample)
            for key in topic.sources
            for sample in kept(self._session, key, KEEP_ALL, _LATCHED_WAIT)
            if str(sample.key_expr) == topic.key and sample.kind == zenoh.SampleKind.PUT
        ]
        return [one for one in found if one is not None][-_MOST_KEPT:]

    def close(self) -> None:
        """Receive no more."""
        with self._changed:
            self._over = True
            self._changed.notify()
        self._thread.join()
        for end in self._ends.values():
            end.undeclare()
        self._ends.clear()

    def _run(self) -> None:
        due = time.monotonic()
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._over or bool(self._ends))
                due = max(due + PERIOD, time.monotonic())
                self._changed.wait_for(lambda: self._over, due - time.monotonic())
                if self._over:
                    return
                ends, routes = [(key, end.handler) for key, end in self._ends.items()], self._routes
            told = self._look_at_clock(dict(ends).get(CLOCK))
            found: list[Delivery] = []
            for key, handler in ends:
                if key == CLOCK and not routes.get(key):
                    continue
                for sample in _waiting(handler):
                    try:
                        found += self._of_sample(key, sample, routes.get(key, []))
                    except Exception as error:  # of a user's class of messages, which may raise anything
                        self._refuse(f"/{key}", f"{type(error).__name__}: {error}")
            if found or told is not None:
                self._deliver(found, told)

    def _look_at_clock(self, handler: Any) -> int | None:
        if handler is None or self._routes.get(CLOCK):  # where a viewer shows it, it passes by there
            return None
        told = None
        for sample in _waiting(handler):
            told = self._tick(sample)
        return told

    def _tick(self, sample: zenoh.Sample) -> int | None:
        try:
            clock = self._decode_clock.decode(sample.payload.to_bytes(), str(sample.encoding))
        except Malformed:
            return None
        with self._changed:
            if CLOCK not in self._ends:
                return None  # it is gone meanwhile: no message is to have its time any more
            self._clock = clock.clock.to_nanoseconds()
            return self._clock

    def _of_sample(self, key: str, sample: zenoh.Sample, topics: list[Topic]) -> list[Delivery]:
        """What a message brings about: itself, and what is made of it."""
        found: list[Delivery] = []
        if key == CLOCK and (told := self._tick(sample)) is not None:
            self._deliver([], told)
        made = [topic for topic in topics if topic.key != key]
        for topic in topics:
            if topic.key == key and (delivery := self._delivery(topic, sample)) is not None:
                found.append(delivery)
                if topic.made == "transforms":
                    self._converted(key, sample, delivery.data)  # so that it is known which need not be made
        if made:
            form = self._form(key, str(sample.encoding))
            try:
                data = form.write(sample.payload.to_bytes())
            except Malformed:
                return found
            found += [one for topic in made if (one := self._made(topic, form, data, sample)) is not None]
        return found

    def _made(self, topic: Topic, form: Form, data: bytes, sample: zenoh.Sample) -> Delivery | None:
        key, at = str(sample.key_expr), self._time(sample)
        if topic.made == "transforms":
            made = self._transforms.take(Converted(form.topic, data, time.time_ns(), at, None, None))
            return Delivery(topic.channel.id, at, made.data, "", 0) if made is not None else None
        if form.topic.schema != "nav_msgs/msg/Odometry":
            return None
        path = self._trails.setdefault(key, Trail()).take(self._decode_odometry(data), time.monotonic_ns())
        return Delivery(topic.channel.id, at, self._encode_path(path), "", 0) if path is not None else None

    def _converted(self, key: str, sample: zenoh.Sample, data: bytes) -> None:
        form = self._form(key, str(sample.encoding))
        self._transforms.take(Converted(form.topic, data, time.time_ns(), 0, None, None))

    def _delivery(self, topic: Topic, sample: zenoh.Sample) -> Delivery | None:
        try:
            data = self._data(topic, sample)
        except Malformed as reason:
            self._refuse(topic.channel.topic, str(reason))
            return None
        source = sample.source_info
        signed = (source_id(source.source_id), source.source_sn) if source is not None else ("", 0)
        return Delivery(topic.channel.id, self._time(sample), data, *signed)

    def _data(self, topic: Topic, sample: zenoh.Sample) -> bytes:
        """A message as its channel promises it.

        Raises:
            Malformed: it is another one.
        """
        payload, encoding = sample.payload.to_bytes(), str(sample.encoding)
        if topic.channel.encoding != CDR:
            try:
                return msgspec.json.encode(codec.jsonable(codec.decode_any(payload)))
            except UNREADABLE as error:
                raise Malformed(str(error)) from None
        form = self._form(topic.key, encoding, topic)
        if form.topic.schema != topic.channel.schema_name or form.topic.encoding != CDR:
            said = form.topic.schema or encoding
            raise Malformed(f"it is a {said}, and the topic is a {topic.channel.schema_name}")
        return form.write(payload)

    def _form(self, key: str, encoding: str, topic: Topic | None = None) -> Form:
        form = self._forms.get((key, encoding))
        if form is None:
            if len(self._forms) >= _MOST_FORMS:
                self._forms.clear()
            form = self._forms[key, encoding] = form_of(key, encoding, announced=topic.type if topic else "")
        return form

    def _time(self, sample: zenoh.Sample) -> int:
        if self._clock is not None:
            return self._clock
        played = self._play_time()
        if played is not None:
            return played
        arrived = time.time_ns()
        stamp = codec.unpack_attachment(sample.attachment.to_bytes()) if sample.attachment is not None else None
        return stamp.source_time if stamp is not None and 0 <= arrived - stamp.source_time < _BEHIND else arrived


def _waiting(handler: "zenoh.handlers.Handler[zenoh.Sample]") -> Iterator[zenoh.Sample]:
    """All that has come."""
    while True:
        try:
            sample = handler.try_recv()
        except zenoh.ZError:
            return  # it has just been undeclared
        if sample is None:
            return
        if sample.kind == zenoh.SampleKind.PUT:
            yield sample
