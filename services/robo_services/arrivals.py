"""When messages were sent, by the clock of the node that gets them: what safety may rely on."""

import math
from typing import Annotated, Generic, TypeVar

from msgspec import Meta

from robo import READ_ONLY, MessageInfo
from robo_messages import Message

M = TypeVar("M", bound=Message)

Unstamped = Annotated[
    bool,
    Meta(description="take what has no stamp, as of plain Zenoh clients; it counts from its arrival"),
    READ_ONLY,
]
"""The parameter of a node that says what its `Arrivals` take."""

HELD_UP = 0.1
"""A node that has not ticked for this long beyond its period was held up, s."""

DOUBT = 0.25
"""How long after that messages come that may have waited, s."""


class Arrivals:
    """Tells when a message was sent; the distant past for one whose age is not known.

    A message without a stamp, as plain Zenoh clients send them, says nothing of the time it took. Where
    those are taken they count as sent when they came, unless this process was held up just before (it was
    stopped, or the machine was busy or asleep): then they may have waited as long.
    """

    def __init__(self, *, unstamped: bool) -> None:
        """`unstamped`: whether messages without a stamp are taken."""
        self._unstamped = unstamped
        self._ticked: float | None = None
        self._doubted_until = -math.inf

    def tick(self, monotonic: float, period: float) -> None:
        """Say at each tick of a timer of this period, s, that this process runs; by the wall's monotonic clock."""
        if self._was_held_up(monotonic, period):
            self._doubted_until = monotonic + DOUBT
        self._ticked, self._period = monotonic, period

    def sent(self, info: MessageInfo, now: float, monotonic: float) -> float:
        """When a message was sent, s by the clock of `now`; -inf where nobody knows.

        Args:
            info: of the message that has just come.
            now: the node's clock, which may be simulated.
            monotonic: the wall's monotonic clock.
        """
        age = info.age  # after `now` was read: whatever comes between the two makes it older, never younger
        if age < math.inf:
            return now - age
        if info.source_time is not None or not self._unstamped:
            return -math.inf
        if self._ticked is not None and self._was_held_up(monotonic, self._period):
            return -math.inf
        return now if monotonic >= self._doubted_until else -math.inf

    def _was_held_up(self, monotonic: float, period: float) -> bool:
        return self._ticked is not None and monotonic - self._ticked > 2 * period + HELD_UP


class Newest(Generic[M]):
    """Of the messages of a topic the one that was sent last."""

    def __init__(self) -> None:
        self.message: M | None = None
        self._sent = -math.inf

    def take(self, message: M, sent: float, now: float) -> None:
        """Take a message, if it is newer than what there is; times in s, by one clock."""
        if sent >= self._sent or self._sent > now:  # the latter where simulated time has stepped back
            self.message, self._sent = message, sent

    def age(self, now: float) -> float:
        """How old it is, s; infinite where it is not known: simulated time may have stepped back since."""
        return now - self._sent if self._sent <= now else math.inf
