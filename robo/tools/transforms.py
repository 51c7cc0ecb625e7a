"""The frames of a running robot, as its topics tell them."""

import time

import zenoh

import robo_messages
from robo.errors import TopicNotFound, UsageError
from robo.samples.stream import Arrival, Stream
from robo.text.unreadable import UNREADABLE
from robo.tf import Buffer
from robo.tf.broadcasters import TF, TF_STATIC
from robo.tools import topics
from robo.wire import discovery, names
from robo.wire.keys import source_id
from robo_messages import TFMessage

TYPE = "tf2/TFMessage"

ASKED_AGAIN = 1.0
"""How long to wait until it is asked again who says something whose publisher was not known, s."""


def namespace_of(session: zenoh.Session, robot: str | None, timeout: float) -> str:
    """The namespace whose transforms are meant: the robot's that is named, or the only one that has some.

    Raises:
        TopicNotFound: no node publishes transforms.
        UsageError: several robots' nodes do.
    """
    if robot is not None:
        return robot
    found = sorted(
        {
            topic.key.rpartition("/")[0]
            for topic in topics.list_topics(session, timeout, ())
            if topic.type == TYPE and topic.publishers and topic.key.rpartition("/")[2] in (TF, TF_STATIC)
        }
    )
    if not found:
        raise TopicNotFound("no node publishes transforms (tf2/TFMessage on tf or tf_static)")
    if len(found) > 1:
        raise UsageError(f"{', '.join(one or '/' for one in found)} have transforms; say which with --robot-name")
    return found[0]


class Frames:
    """Keeps what is said of the frames of one namespace while it is looked at."""

    def __init__(self, session: zenoh.Session, namespace: str, timeout: float) -> None:
        """`timeout` is how long routers may take to say who publishes, s."""
        self.buffer = Buffer()
        """All that has come."""
        self.malformed = 0
        """Messages that could not be read."""
        self._session = session
        self._timeout = timeout
        self.keys = [names.join(namespace, topic) for topic in (TF, TF_STATIC)]
        """Where they are told: those that move, and those that do not."""
        self._senders: dict[str, str] = {}
        self._asked = float("-inf")
        self._stream = Stream(session, self.keys, latched=True)

    def follow(self, until: float) -> None:
        """Take in what is said until a time by the monotonic clock."""
        while (arrival := self._stream.get(until)) is not None:
            self._take(arrival)
            if time.monotonic() >= until and not self._stream.waiting:
                return

    def close(self) -> None:
        """Listen no more."""
        self._stream.close()

    def _take(self, arrival: Arrival) -> None:
        try:
            message = robo_messages.decode(arrival.sample.payload.to_bytes(), TFMessage)
        except UNREADABLE:
            self.malformed += 1
            return
        self.buffer.insert_all(message.transforms, arrival.key == self.keys[1], self._sender(arrival))

    def _sender(self, arrival: Arrival) -> str:
        """Who has sent a message, as its node is called."""
        source = arrival.sample.source_info
        if source is None:
            return "a plain Zenoh client"
        sender = source_id(source.source_id)
        if sender not in self._senders and time.monotonic() > self._asked + ASKED_AGAIN:
            self._asked = time.monotonic()
            for key in self.keys:
                announced = discovery.publishers_of(self._session, key, self._timeout)
                self._senders |= {token.id: token.full_name for token in announced}
        return self._senders.get(sender, "somebody unannounced")
