"""What has been recorded so far, topic by topic: to be looked at while it goes on. Pure."""

from collections import Counter
from collections.abc import Mapping

import msgspec

from robo.bag.write.counts import Counts
from robo.recording.conversion import Converted

WINDOW = 1.0
"""Over how long rates are measured at the least, s."""


class TopicFigures(msgspec.Struct, frozen=True):
    """What was recorded of a topic."""

    topic: str
    type: str
    """As the file calls it: `geometry_msgs/msg/Twist`; empty where nobody says it."""
    encoding: str
    """`cdr`; of messages that are recorded as the bytes that they are, what they are in."""
    received: int
    lost: int
    """Messages that did not come, by gaps in the sequence numbers of each publisher."""
    malformed: int
    """Messages that came and could not be written down."""
    size: int
    """Of what was written of them, before it is compressed, bytes."""
    rate: float | None
    """Hz, lately; in all, once it is over. None for fewer than two messages."""
    made_of: str = ""
    """The topic of which it was made, where nobody published it: `tf` of odometry."""
    left_out: int = 0
    """Messages that were not written down because too many waited; those that are counted are among the lost."""


class _Topic(msgspec.Struct):
    type: str
    encoding: str
    count: int = 0
    size: int = 0
    first: int = 0
    last: int = 0
    marked: float = 0.0
    """When it was looked at, s."""
    marked_count: int = 0
    rate: float | None = None


class Tally:
    """Counts what is written."""

    def __init__(self) -> None:
        self._topics: dict[str, _Topic] = {}

    @property
    def came(self) -> list[str]:
        """The topics of which anything was written."""
        return list(self._topics)

    def add(self, message: Converted) -> None:
        """A message was written."""
        name = message.topic.name
        found = self._topics.get(name)
        if found is None:
            found = self._topics[name] = _Topic(message.topic.schema, message.topic.encoding, first=message.arrived)
        found.count += 1
        found.size += len(message.data)
        found.last = message.arrived

    def figures(
        self, now: float, counts: Mapping[str, Counts], malformed: Counter[str], made: Mapping[str, str], *, over: bool
    ) -> list[TopicFigures]:
        """What was recorded, by topic.

        Args:
            now: by a monotonic clock, s.
            counts: of messages that came and did not come.
            malformed: messages that could not be written down.
            made: topics that nobody published, with what they are made of.
            over: whether rates are to be those of all of it.
        """
        found = []
        left_out = {name: of_topic.left_out for name, of_topic in counts.items() if of_topic.left_out}
        for name in sorted({*self._topics, *malformed, *left_out}):
            topic = self._topics.get(name, _Topic("", ""))
            rate = _rate(topic) if over else self._rate_lately(topic, now)
            lost = counts[name].lost if name in counts else 0
            bad, origin = malformed[name], made.get(name, "")
            found.append(
                TopicFigures(
                    name, topic.type, topic.encoding, topic.count, lost, bad, topic.size, rate, origin,
                    left_out.get(name, 0),
                )
            )  # fmt: skip
        return found

    def _rate_lately(self, topic: _Topic, now: float) -> float | None:
        if not topic.marked:
            topic.marked, topic.marked_count = now, topic.count
            return _rate(topic)
        if now - topic.marked >= WINDOW:
            topic.rate = (topic.count - topic.marked_count) / (now - topic.marked)
            topic.marked, topic.marked_count = now, topic.count
        return topic.rate if topic.rate is not None else _rate(topic)


def _rate(topic: _Topic) -> float | None:
    span = (topic.last - topic.first) * 1e-9
    return (topic.count - 1) / span if topic.count > 1 and span > 0 else None
