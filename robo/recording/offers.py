"""What publishers say of their topics, by the tokens of their nodes. Pure."""

from robo.recording.conversion import Offer
from robo.wire.keys import EndpointToken
from robo.wire.qos import KEEP_ALL, QoS

_MOST_TOKENS = 50_000
"""That are remembered: a stranger that makes some up fills no memory."""


class Offers:
    """Which publishers there are."""

    def __init__(self) -> None:
        self._topics: dict[str, dict[str, EndpointToken]] = {}
        self._count = 0

    def put(self, token: EndpointToken) -> bool:
        """A publisher is there; returns whether what is said of its topic is another thing now."""
        before = self.of(token.topic)
        publishers = self._topics.setdefault(token.topic, {})
        if token.key() not in publishers:
            if self._count >= _MOST_TOKENS:
                return False
            self._count += 1
        publishers[token.key()] = token
        return self.of(token.topic) != before

    def delete(self, token: EndpointToken) -> None:
        """A publisher is gone; what it has said of its topic holds until another one says something else."""
        publishers = self._topics.get(token.topic)
        if publishers is not None and len(publishers) > 1 and publishers.pop(token.key(), None) is not None:
            self._count -= 1

    def of(self, topic: str) -> Offer:
        """What is known of a topic: one latched publisher makes it latched, and the deepest says how deep."""
        publishers = list(self._topics.get(topic, {}).values())
        if not publishers:
            return Offer()
        types = {token.type_name for token in publishers}
        return Offer(_together([token.qos for token in publishers]), types.pop() if len(types) == 1 else "")


def _together(offered: list[QoS]) -> QoS:
    latched = [qos for qos in offered if qos.latched]
    candidates = latched or offered
    return max(candidates, key=lambda qos: (qos.depth == KEEP_ALL, qos.depth))
