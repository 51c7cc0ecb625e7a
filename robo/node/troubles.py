"""What goes wrong in a node's callbacks and with the messages that it gets: counted, and told in its log."""

import threading
import time
from collections.abc import Callable, Sequence
from functools import partial

import zenoh

from robo.errors import NotActive
from robo.node.ending import NodeStopping
from robo.node.log import NodeLogger
from robo.node.message_info import PLAIN
from robo.node.turn import name_of
from robo.wire import discovery, keys
from robo.wire.keys import EndpointToken

MALFORMED_PERIOD = 60.0
"""How often a topic on which malformed messages come is told of, s: at once, and then with how many there were."""

LEFT_OUT_PERIOD = 60.0
"""How often a sender whose messages are left out is told of, s."""


class Troubles:
    """Counts and tells what goes wrong in one node."""

    def __init__(
        self,
        logger: NodeLogger,
        obey: Callable[[SystemExit], None],
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        """
        Args:
            logger: the node's.
            obey: ends the node as a SystemExit says.
            now: the time, s.
        """
        self._logger = logger
        self._obey = obey
        self._now = now
        self._malformed_told: dict[str, float] = {}
        self.callback_errors = 0
        """Exceptions that callbacks raised."""
        self.listener: Callable[[BaseException], None] = lambda _: None
        """Takes each of them, where the log has those alone that are not like the one before."""

    def handler(self, callback: Callable[..., object]) -> Callable[[BaseException], None]:
        """What to do with an exception of a callback: it ends neither its thread nor, unless asked, the node."""
        name = name_of(callback)

        def handle(error: BaseException) -> None:
            if isinstance(error, SystemExit):
                self._obey(error)
                return
            if isinstance(error, (NotActive, NodeStopping)):
                return  # whoever has called is told
            self.callback_errors += 1
            self.listener(error)
            self._logger.error(f"{name} raised", throttle=1.0, exception=error)

        return handle

    def held_loop(self, callback: str, seconds: float) -> None:
        """Tell of an async callback that has kept the loop to itself."""
        text = "%s held up all async callbacks of this process for %.1f s: await what waits, or asyncio.to_thread(…)"
        self._logger.warning(text, callback, seconds, throttle=10.0)

    def left_out(self, topic: str, wanted: str, sender: str, count: int) -> None:
        """Tell of messages that do not count.

        Args:
            topic: where they came.
            wanted: whose count: a node's full name, PLAIN, or empty for the first that came.
            sender: whose they are.
            count: how many there were so far.
        """
        source = {"": "the node that came first", PLAIN: "a plain Zenoh client"}.get(wanted, wanted)
        text = f"left out messages of {sender} on {topic}, %d so far: it takes those of %s alone"
        self._logger.warning(text, count, source, throttle=LEFT_OUT_PERIOD)

    def late(self, topic: str, deadline: float, again: bool) -> None:
        """Tell that no message has come within a deadline, s; or, after that, that messages come `again`."""
        if again:
            self._logger.info("messages come again on %s", topic)
        else:
            self._logger.warning("no message on %s within its deadline of %g s", topic, deadline)

    def malformed(self, session: zenoh.Session, topic: str, count: int, reason: str, sample: zenoh.Sample) -> None:
        """Tell, now and then, of a message that cannot be read.

        Args:
            session: the network, which is asked whose it is.
            topic: where it came.
            count: how many there were so far.
            reason: why it cannot be read.
            sample: the message.
        """
        now = self._now()
        if now - self._malformed_told.get(topic, float("-inf")) < MALFORMED_PERIOD:
            return
        self._malformed_told[topic] = now
        # Whoever has sent it is asked of the network: not in the thread that runs callbacks.
        work = partial(self._tell_malformed, session, topic, count, reason, sample.source_info)
        threading.Thread(target=work, name="robo-malformed", daemon=True).start()

    def _tell_malformed(
        self, session: zenoh.Session, topic: str, count: int, reason: str, source: zenoh.SourceInfo | None
    ) -> None:
        announced: Sequence[EndpointToken] = ()
        if source is not None:
            try:
                announced = discovery.publishers_of(session, topic, timeout=0.5)
            except zenoh.ZError:  # the node has just left
                announced = ()
        text = "dropped a malformed message on %s (%d so far): %s; from %s"
        self._logger.warning(text, topic, count, reason, _sender(source, announced))


def _sender(source: zenoh.SourceInfo | None, announced: Sequence[EndpointToken]) -> str:
    """Whose a message is, by its source and the publishers of its topic."""
    if source is None:
        return "a plain Zenoh client"
    wanted = keys.source_id(source.source_id)
    return next((token.full_name for token in announced if token.id == wanted), f"{wanted}, unannounced")
