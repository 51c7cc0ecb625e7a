"""Where a recording that is played goes: publishers of its topics, and of the time that nodes follow."""

from contextlib import suppress

import zenoh

import robo_messages
from robo.recording.play.tape import Ready
from robo.recording.play.topics import CLOCK, Played
from robo.samples.publishing import Sender
from robo.wire import keys, names
from robo.wire.qos import KEEP_ALL, QoS
from robo_messages import Clock, Time


class Outputs:
    """Publishers, each made when its topic's turn comes first. One thread at a time publishes."""

    def __init__(self, session: zenoh.Session, played: list[Played], node: str) -> None:
        """
        Args:
            session: the network.
            played: the topics.
            node: the full name by which they are announced.
        """
        self._session = session
        self._node = node
        self.played = played
        self.counts = [0] * len(played)
        """Messages that were published, of each topic."""
        self._senders: dict[tuple[int, int], Sender] = {}
        for number in range(len(played)):
            self._sender(number, 0)

    def send(self, message: Ready) -> None:
        """Publish a message. Where a receiver that wants them all is full, it waits."""
        sender = self._senders.get((message.number, message.part)) or self._sender(message.number, message.part)
        sender.send(message.payload, self.played[message.number].encoding or None)
        self.counts[message.number] += 1

    def arrive(self, timeout: float = 5.0) -> None:
        """Wait until the nodes of the robots that are played to have all that was published.

        A query of the least priority follows the messages before it on the same links, so a node that answers has them.

        Args:
            timeout: how long to wait for a node that does not answer, s.
        """
        last, each = zenoh.Priority.BACKGROUND, zenoh.ConsolidationMode.NONE
        robots = {one.key.partition("/")[0] if "/" in one.key else "" for one in self.played}
        for robot in robots if "" not in robots else [""]:
            everybody = keys.status_key(names.join(robot, "**"), "*")
            list(self._session.get(everybody, timeout=timeout, priority=last, consolidation=each))

    def close(self) -> None:
        """Publish no more; what was latched is there no more."""
        for sender in self._senders.values():
            with suppress(RuntimeError):  # the last message waits for a receiver; both end with the session
                sender.close()
        self._senders.clear()

    def _sender(self, number: int, part: int) -> Sender:
        topic = self.played[number]
        # Of two publishers of one node a late reader takes the newer one's word alone.
        node = f"{self._node}_part_{part + 1}" if part else self._node
        made = Sender(self._session, topic.key, topic.type, topic.qos, node, remembered=0)
        self._senders[number, part] = made
        return made


class ClockOutput:
    """Says what time it is in the recording, for nodes that follow `/clock`."""

    def __init__(self, session: zenoh.Session, node: str) -> None:
        self._sender = Sender(session, CLOCK, robo_messages.type_name(Clock), QoS(depth=KEEP_ALL), node, remembered=0)

    def send(self, time: int) -> None:
        """Publish a time, ns since the epoch."""
        self._sender.send(robo_messages.encode(Clock(Time.from_nanoseconds(time))))

    def close(self) -> None:
        """Publish no more."""
        with suppress(RuntimeError):
            self._sender.close()
