"""What latched publishers have said before comes before what they say now, and nothing twice. Pure."""

import time
from collections.abc import Callable

import zenoh

from robo.recording.conversion import Came
from robo.wire import codec, keys
from robo.wire.keys import EndpointToken
from robo.wire.latched import Order

_MOST_PUBLISHERS = 10_000
_MOST_TOPICS = 10_000

LONGEST_HELD = 0.15
"""How long what a publisher says waits for what it has said before, s: whoever is killed meanwhile loses it."""


class LatchedFirst:
    """Puts the messages of latched publishers in order."""

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        """`now` is a clock that never goes back, s."""
        self._now = now
        self._orders: dict[str, Order] = {}
        """By topic."""
        self._known: set[str] = set()
        self._held: dict[str, tuple[float, list[Came]]] = {}
        """By publishers that are being asked, until when it is waited for that, and what they have said meanwhile."""

    def __contains__(self, topic: str) -> bool:
        """Whether a topic has latched publishers, as far as is known."""
        return topic in self._orders

    def meet(self, token: EndpointToken) -> None:
        """A publisher of a node is there."""
        if token.id and token.qos.latched:
            self._order(token.topic).meet(token.id, token.full_name)

    def part(self, token: EndpointToken) -> None:
        """A publisher of a node is gone."""
        if token.id and token.topic in self._orders:
            self._orders[token.topic].part(token.id)

    def keeper(self, topic: str, publisher: str) -> bool:
        """A latched publisher is there: whether it is to be asked for what it has said; its news are held until `done`.

        Args:
            topic: its topic.
            publisher: Zenoh's id of it, as `keys.source_id` makes it.
        """
        order = self._order(topic)
        if publisher in self._known or len(self._known) >= _MOST_PUBLISHERS:
            return False
        self._known.add(publisher)
        order.follow(publisher)
        self._held[publisher] = self._now() + LONGEST_HELD, []
        return True

    def kept(self, came: Came) -> list[Came]:
        """What a publisher has said before: what of it is to be written down."""
        publisher = _publisher(came.sample)
        order = self._order(came.key)
        if publisher:
            self._known.add(publisher)
            order.follow(publisher)
        return [came._replace(is_kept=True)] if self._admits(came, publisher) else []

    def live(self, came: Came) -> list[Came]:
        """What somebody says now on a topic that has latched publishers: what is to be written down."""
        publisher = _publisher(came.sample)
        held = self._held.get(publisher)
        if held is not None:
            held[1].append(came)
            return []
        return [came] if self._admits(came, publisher) else []

    def done(self, publisher: str) -> list[Came]:
        """All has come that a publisher has said before: what it has said meanwhile."""
        _, held = self._held.pop(publisher, (0.0, []))
        return [came for came in held if self._admits(came, publisher)]

    def overdue(self) -> list[Came]:
        """What those have said meanwhile whose answer takes too long; called often."""
        if not self._held:
            return []
        now = self._now()
        late = [publisher for publisher, (until, held) in self._held.items() if held and now >= until]
        return [came for publisher in late for came in self.done(publisher)]

    def all_held(self) -> list[Came]:
        """No more answers come: what all have said meanwhile."""
        return [came for publisher in list(self._held) for came in self.done(publisher)]

    def _order(self, topic: str) -> Order:
        order = self._orders.get(topic)
        if order is None:
            if len(self._orders) >= _MOST_TOPICS:
                del self._orders[next(iter(self._orders))]
            order = self._orders[topic] = Order()
        return order

    def _admits(self, came: Came, publisher: str) -> bool:
        if not publisher:
            return True
        sample = came.sample
        source, attachment = sample.source_info, sample.attachment
        stamp = codec.unpack_attachment(attachment.to_bytes()) if attachment is not None else None
        order = self._order(came.key)
        if stamp is None:
            return source is None or order.admits(publisher, source.source_sn, 0)
        return order.admits(publisher, stamp.sequence_number, stamp.source_time)


def _publisher(sample: zenoh.Sample) -> str:
    source = sample.source_info
    return keys.source_id(source.source_id) if source is not None else ""
