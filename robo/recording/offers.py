"""What publishers say of their topics, by the tokens of their nodes. Pure."""

from collections.abc import Callable, Iterable

from robo.recording.conversion import Offer
from robo.wire.keys import EndpointToken
from robo.wire.qos import KEEP_ALL, QoS

_MOST_TOKENS = 50_000
"""That are remembered: a stranger that makes some up fills no memory."""
_MOST_LEFT = 10_000


class Offers:
    """Which publishers there are."""

    def __init__(self, replaced: Callable[[str, str], object] = lambda _topic, _publisher: None) -> None:
        """`replaced` is told of each latched publisher, by its topic and its id, whose node has another one now."""
        self._replaced = replaced
        self._left: dict[tuple[str, str], list[str]] = {}
        """By topic and node, the ids of latched publishers that are gone."""
        self._topics: dict[str, dict[str, EndpointToken]] = {}
        self._offers: dict[str, Offer] = {}
        self._gone: set[str] = set()
        """Topics that nobody publishes any more; what was said last of them holds."""
        self._count = 0

    def put(self, token: EndpointToken) -> bool:
        """A publisher is there; returns whether type or QoS of its topic are other ones now."""
        topic = token.topic
        if topic in self._gone:
            self._gone.remove(topic)
            self._count -= len(self._topics.pop(topic))
        if self._count >= _MOST_TOKENS:
            return False
        if token.qos.latched and token.id:
            for gone in self._left.pop((topic, token.full_name), ()):
                if gone != token.id:
                    self._replaced(topic, gone)
        publishers = self._topics.setdefault(topic, {})
        self._count += token.key() not in publishers
        publishers[token.key()] = token
        before, after = self.of(topic), _offer(list(publishers.values()))
        self._offers[topic] = after
        return (after.qos, after.type) != (before.qos, before.type)

    def delete(self, token: EndpointToken) -> None:
        """A publisher is gone."""
        publishers = self._topics.get(token.topic, {})
        if token.key() not in publishers:
            return
        if token.qos.latched and token.id:
            self._leave(token, publishers.values())
        if len(publishers) == 1:
            self._gone.add(token.topic)
            return
        del publishers[token.key()]
        self._count -= 1
        self._offers[token.topic] = _offer(list(publishers.values()))

    def _leave(self, token: EndpointToken, present: Iterable[EndpointToken]) -> None:
        """A latched publisher is gone: what it has said holds until its node says something else."""
        if any(one.full_name == token.full_name and one.id != token.id for one in present):
            self._replaced(token.topic, token.id)
            return
        if len(self._left) >= _MOST_LEFT:
            del self._left[next(iter(self._left))]
        self._left.setdefault((token.topic, token.full_name), []).append(token.id)

    def latch(self, topic: str) -> bool:
        """A topic turns out to be latched before any node has said so; returns whether that is new."""
        offer = self.of(topic)
        if offer.qos.latched or len(self._offers) >= _MOST_TOKENS:
            return False
        self._offers[topic] = offer._replace(qos=QoS(latched=True))
        return True

    def of(self, topic: str) -> Offer:
        """What is known of a topic: one latched publisher makes it latched, and the deepest says how deep."""
        return self._offers.get(topic, _NOTHING)


_NOTHING = Offer()


def _offer(publishers: list[EndpointToken]) -> Offer:
    types = {token.type_name for token in publishers}
    ids = tuple(token.id for token in publishers if token.id)
    return Offer(_together([token.qos for token in publishers]), types.pop() if len(types) == 1 else "", ids)


def _together(offered: list[QoS]) -> QoS:
    latched = [qos for qos in offered if qos.latched]
    candidates = latched or offered
    return max(candidates, key=lambda qos: (qos.depth == KEEP_ALL, qos.depth))
