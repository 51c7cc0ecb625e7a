"""What a subscription knows of a message beside its content: how old it is, and who sent it.

The age of a message counts from when it was sent, by the publisher's stamp, so that the time in queues
and on the wire is in it. Stamps are the publisher's wall clock; what makes them comparable is the least
difference between arrival and stamp that was seen of this publisher: no message comes before it is sent.
The receiver's side of that difference is its monotonic clock, so its own wall clock may jump.
"""

import math
from collections.abc import Callable

import msgspec

from robo.text.brief import brief
from robo.wire.reports import Refused

DRIFT = 1e-3
"""How much two clocks may drift apart, s a second: quartz and what NTP slews, with room."""

SETTLE = 300_000_000
"""How long the least difference has to hold before it is believed, ns: a queue that is drained shows
ever smaller ones, all within a moment."""

STEP = 20_000_000
"""A stamp that contradicts what was learnt by more than this means a clock that was set, ns."""

LONGEST_SILENCE = round(STEP / DRIFT)
"""Over a longer one the clocks may have drifted so far apart that a message may be late by more than STEP
unnoticed, ns: the publisher's clock is learnt anew."""

PLAIN = "plain"
"""What a sole source is called that says no name: any plain Zenoh client."""

LEASE = 0.5
"""A sole source that has been silent for this long, s, has left; another may take its place."""

_LONGEST_SENDER = 200
"""How much of a sender's name is told, characters."""

_MOST_SOURCES = 256
"""So many publishers are remembered; a stranger that makes up ids fills no memory."""


class MessageInfo(msgspec.Struct, frozen=True):
    """What is known of a message; a callback with a second parameter gets it."""

    age_at_arrival: float
    """How old it was when it came, s; infinite where that cannot be known."""
    source: str = ""
    """The full name of the node that published it, "" for a plain Zenoh client."""
    source_id: str = ""
    """Zenoh's id of the publisher, `<session>:<entity>`; "" where it says none."""
    sequence_number: int | None = None
    """Counts the publisher's messages, from 1."""
    source_time: int | None = None
    """When it was published, by the publisher's clock, ns since the Unix epoch."""
    arrival: int = 0
    """When it came, by `clock`, ns."""
    clock: Callable[[], int] | None = None
    """The receiver's, that goes on while a callback waits; None where the message gets no older."""

    @property
    def age(self) -> float:
        """How long ago its content was said, s; infinite where that cannot be known: no stamp, or one of a
        clock that nobody knows yet. Whoever passes on what others have said hands its age on.

        It counts to the moment when it is asked for: a process that is stopped between the arrival of a
        message and its callback finds it old.
        """
        if self.clock is None:
            return self.age_at_arrival
        return self.age_at_arrival + (self.clock() - self.arrival) * 1e-9

    @property
    def sender(self) -> str:
        """Who sent it, in words; anybody may announce a name of any length."""
        return brief(self.source, _LONGEST_SENDER) or "a plain Zenoh client"


class SourceClock:
    """Learns how the clock of one publisher stands to this machine's. All times in ns."""

    def __init__(self) -> None:
        self._least = 0
        """The least difference between arrival and stamp so far, as of `_seen`."""
        self._seen = 0
        self._begun: int | None = None
        """Since when it is learnt: no stamp has contradicted it, and no silence was too long."""
        self._stamp = 0

    def age(self, stamp: int, arrival: int, wall: int) -> float:
        """How old a message is, s; infinite where that is not known.

        Until the publisher's clock is known, the two wall clocks are compared: they are one on one
        machine, and as good as one where both are set by NTP. A stamp from the future shows that they
        are not.

        Args:
            stamp: the publisher's wall clock when it was sent.
            arrival: this machine's monotonic clock now.
            wall: this machine's wall clock now.
        """
        difference = arrival - stamp
        silence = arrival - self._seen
        least = self._least + int(silence * DRIFT)
        contradicts = stamp < self._stamp - STEP or difference < least - STEP
        if self._begun is None or contradicts or silence > LONGEST_SILENCE:
            self._begun, least = arrival, difference
        self._least, self._seen, self._stamp = min(least, difference), arrival, stamp
        learnt = difference - self._least
        if arrival - self._begun >= SETTLE:
            return learnt * 1e-9
        compared = wall - stamp
        return max(compared, learnt) * 1e-9 if compared >= -STEP else math.inf


class Clocks:
    """The clocks of all publishers of a topic."""

    def __init__(self) -> None:
        self._clocks: dict[str, SourceClock] = {}

    def age(self, source_id: str, stamp: int, arrival: int, wall: int) -> float:
        """How old a message of this publisher is, s; see `SourceClock.age`."""
        clock = self._clocks.pop(source_id, None) or SourceClock()
        self._clocks[source_id] = clock  # the newest last
        if len(self._clocks) > _MOST_SOURCES:
            del self._clocks[next(iter(self._clocks))]
        return clock.age(stamp, arrival, wall)


class SoleSource:
    """Lets the messages of one source at a time through, and knows who else tries.

    That source is the one that is wanted by name, or else the first that comes. It stays until it has
    been silent for LEASE. Plain Zenoh clients, which say no name, count only where PLAIN is wanted.
    """

    def __init__(self) -> None:
        self._holder: str | None = None
        self._heard = -math.inf
        self._waiting: dict[str, int] = {}
        """Messages of others since the holder was last heard, by sender."""
        self._refused: dict[str, tuple[int, float]] = {}
        """Messages refused so far and when the last one was, by sender."""

    def refused(self, now: float) -> list[Refused]:
        """Whose messages were refused so far; `now` as for `admits`."""
        return [Refused(sender, count, now - last) for sender, (count, last) in list(self._refused.items())]

    def admits(self, info: MessageInfo, wanted: str, now: float, tell: Callable[[str, int], None]) -> bool:
        """Whether a message counts.

        Args:
            info: of the message.
            wanted: full name of the node whose messages count, PLAIN, or "" for the first that comes.
            now: monotonic, s.
            tell: is told of a sender who is refused, and of how many messages so far. Whoever merely
                takes over from a source that has died is not told of.
        """
        may = not info.source if wanted == PLAIN else bool(info.source) and wanted in ("", info.source)
        if may and (self._holder in (None, info.source_id) or now - self._heard > LEASE):
            if self._holder == info.source_id:
                for sender, count in self._waiting.items():
                    self._refuse(sender, count, now, tell)
            self._waiting.clear()
            self._holder, self._heard = info.source_id, now
            return True
        if may:
            self._waiting[info.sender] = self._waiting.get(info.sender, 0) + 1
        else:
            self._refuse(info.sender, 1, now, tell)
        return False

    def _refuse(self, sender: str, count: int, now: float, tell: Callable[[str, int], None]) -> None:
        if sender not in self._refused and len(self._refused) >= _MOST_SOURCES:
            sender = "others"
        so_far = self._refused.get(sender, (0, now))[0] + count
        self._refused[sender] = so_far, now
        tell(sender, so_far)
