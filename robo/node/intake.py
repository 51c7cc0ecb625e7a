"""Who sent a message and how old it is: from a sample and the announcements of publishers to a `MessageInfo`."""

import math
from collections.abc import Callable
from datetime import UTC, datetime, timedelta

import zenoh

from robo.node.clock import Clock
from robo.node.message_info import Clocks, MessageInfo, SoleSource
from robo.wire import codec, keys, liveliness
from robo.wire.keys import EndpointToken
from robo.wire.reports import Refused

_INTRODUCTION = 500_000_000
"""How long a publisher's announcement may come after its first message, ns."""

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_MICROSECOND = timedelta(microseconds=1)

_MOST_NAMES = 1024


class Intake:
    """Examines the samples of one topic before they are decoded."""

    def __init__(
        self,
        session: zenoh.Session,
        topic: str,
        wanted: Callable[[], str] | None,
        tell: Callable[[str, int], None],
        clock: Clock,
        lifespan: float | None = None,
    ) -> None:
        """
        Args:
            session: whose announcements of publishers count.
            topic: the key expression.
            wanted: says whose messages alone count, see `SoleSource.admits`; None: everybody's.
            tell: is told of a sender whose messages are refused, and of how many so far.
            clock: by which messages arrive.
            lifespan: how old a message may be, s. Of a plain client's nobody knows.
        """
        self._wanted = wanted
        self._tell = tell
        self._clock = clock
        self._lifespan = math.inf if lifespan is None else lifespan
        self.expired = 0
        """Messages that were too old."""
        self._clocks = Clocks()
        self._sole = SoleSource()
        self._names: dict[str, str] = {}
        """Full names of nodes by the ids of their publishers; those of nodes that have left included,
        since their messages may come later than the news."""
        self._strangers: dict[str, int] = {}
        """Since when messages come of ids that nobody has announced."""
        # On Zenoh's own thread: it only writes into a dict, and a thread of its own would cost each subscription more.
        self._announcements = liveliness.hear(
            session, keys.tokens_of_publishers(topic), zenoh.handlers.Callback(self._meet, indirect=False)
        )

    @property
    def refused(self) -> list[Refused]:
        """Whose messages were refused so far."""
        return self._sole.refused(self._clock.arrival_ns() * 1e-9)

    def examine(self, sample: zenoh.Sample) -> MessageInfo | None:
        """What is known of a sample; None where its sender's messages do not count."""
        arrival = self._clock.arrival_ns()
        info = self._info(sample, arrival)
        if self._lifespan < info.age_at_arrival < math.inf:
            self.expired += 1
            return None
        if self._wanted is None:
            return info
        if info.source_id and not info.source and not self._has_had_time(info.source_id, arrival):
            return None  # it may be the node that is wanted, or be told of as a stranger: soon we know
        return info if self._sole.admits(info, self._wanted(), arrival * 1e-9, self._tell) else None

    def close(self) -> None:
        """Listen for no more announcements."""
        self._announcements.undeclare()

    def _info(self, sample: zenoh.Sample, arrival: int) -> MessageInfo:
        source = sample.source_info
        source_id = keys.source_id(source.source_id) if source is not None else ""
        name = self._names.get(source_id, "")
        stamp = codec.unpack_attachment(sample.attachment.to_bytes()) if sample.attachment is not None else None
        if stamp is None:
            return MessageInfo(math.inf, name, source_id)
        age = self._clocks.age(source_id, stamp.source_time, arrival, self._clock.time_ns())
        said = _said_at(sample.timestamp, source_id)
        if said is not None:
            age += max(0.0, (stamp.source_time - said) * 1e-9)
        number, sent = stamp
        return MessageInfo(age, name, source_id, number, sent, arrival, self._clock.arrival_ns)

    def _has_had_time(self, source_id: str, arrival: int) -> bool:
        if len(self._strangers) >= _MOST_NAMES:
            self._strangers.clear()
        return arrival - self._strangers.setdefault(source_id, arrival) > _INTRODUCTION

    def _meet(self, sample: zenoh.Sample) -> None:
        token = keys.parse_token(str(sample.key_expr))
        if sample.kind == zenoh.SampleKind.PUT and isinstance(token, EndpointToken) and token.id:
            if len(self._names) >= _MOST_NAMES:
                self._names.pop(next(iter(self._names)))
            self._names[token.id] = token.full_name
            self._strangers.pop(token.id, None)


def _said_at(timestamp: zenoh.Timestamp | None, source_id: str) -> int | None:
    """When what a message says was first said, by its publisher's clock, ns since the epoch.

    It is a Zenoh timestamp by the publisher; None where there is none, or another (a router stamps
    what comes without one).

    Args:
        timestamp: of the sample.
        source_id: of the publisher, `<session>:<entity>`.
    """
    if timestamp is None:  # as nearly always
        return None
    # As numbers: Zenoh writes ids without their leading zeros.
    session = int(source_id.partition(":")[0] or "0", 16)
    if int.from_bytes(bytes(timestamp.get_id()), "little") != session:
        return None
    return (timestamp.get_time() - _EPOCH) // _MICROSECOND * 1000
