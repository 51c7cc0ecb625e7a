"""Messages of all topics of a robot, taken out of Zenoh's channels in batches: nothing runs for a single one.

That costs two thirds of what a call of Python for each message does, and a third less than to be woken for each; for
that, the time of arrival is known from two looks at the channels and from when a message was published.
"""

from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

import zenoh

from robo.recording.conversion import Conversion, Converted
from robo.recording.flight.windows import CLOCKS_AGREE, arrivals
from robo.recording.intake import LIVE, Intake
from robo.recording.odometry import TransformsOfOdometry
from robo.recording.selection import Selection
from robo.wire.shared_buffers import LARGE, is_torn

SLOTS = 2048
"""Messages that wait in a channel; of more the oldest are left out, and missing in the numbers. Even a small one takes
10 kB there (zenoh 1.10.2)."""
MOST_AT_ONCE = 64_000_000
"""Of one look, bytes: where nobody could look for a while, the oldest messages are left out."""


class Batch(NamedTuple):
    """What has come since the last look, in order."""

    messages: list[Converted]
    large: bool
    """Whether messages are among them that hold shared memory of their publishers for as long as nobody looks."""


class FlightIntake(Intake):
    """Takes in messages, and what latched publishers have said before. `batch` is called by one thread at a time."""

    def __init__(
        self,
        session: zenoh.Session,
        selection: Selection,
        tell: Callable[[str], object],
        replaced: Callable[[str, str], object],
        now: int,
    ) -> None:
        """
        Args:
            session: the network.
            selection: which topics.
            tell: is told once of each topic that cannot be written down as it should.
            replaced: is told of each latched publisher whose node has another one now: its topic and its id.
            now: ns since the epoch, by the recorder's clock.
        """
        self.torn = 0
        """Messages that were lost because this process was stopped while they were in shared memory."""
        self.dropped = 0
        """Messages that were left out, as too many had waited."""
        self._looked = now
        self._tell = tell
        self._channels: list[tuple[int, Any]] = []
        self._conversion = Conversion(tell, lambda key: self.offers.of(key))
        self._transforms = TransformsOfOdometry()
        super().__init__(session, selection, offer_changed=self._conversion.forget, replaced=replaced)

    def batch(self, now: int, behind: int = 0) -> Batch:
        """What has come since the last look.

        Args:
            now: ns since the epoch, by the recorder's clock.
            behind: by how much the machine's clock, and so those of publishers here, is ahead of that one, ns.
        """
        self._empty_channels(now)
        before: list[Converted] = []
        live: list[Converted] = []
        large = False
        for came in self.take():
            try:
                message = self._conversion.convert(came)
                if len(came.sample.payload) >= LARGE:
                    large = True
                    if is_torn(came.sample.payload):
                        self.torn += 1
                        continue
                if message is None:
                    continue
                made = self._transforms.take(message)
            except Exception as error:  # a message that nobody has thought of: all others are kept
                self._tell(f"{came.key}: a message cannot be kept: {type(error).__name__}")
                continue
            (live if came.arrived == now else before).append(message)
            if made is not None:
                live.append(made)
        published = [one.published - behind if one.published != now else None for one in live]
        times = arrivals(published, self._looked, now)
        # What has come before has the time of the machine's clock, which may have been set since.
        found = [one if abs(one.arrived - now) < CLOCKS_AGREE else one._replace(arrived=now) for one in before]
        found += [one._replace(arrived=at) for one, at in zip(live, times, strict=True)]
        found.sort(key=_arrived)
        self._looked = now
        return Batch(found, large)

    def _empty_channels(self, now: int) -> None:
        """Take out of the channels what waits there."""
        came: deque[tuple[int, int, Any, str, int]] = deque()
        source_of, put = self._selection.source, zenoh.SampleKind.PUT
        size = 0
        for number, handler in self._channels:
            try_recv = handler.try_recv
            while (sample := try_recv()) is not None:
                key, here = str(sample.key_expr), len(sample.payload)
                if source_of(key) != number or sample.kind != put:
                    continue
                came.append((now, LIVE, sample, key, here))
                size += here
                while size > MOST_AT_ONCE and len(came) > 1:
                    size -= came.popleft()[4]
                    self.dropped += 1
        self._row.extend(came)

    def _subscribe(self, number: int, key: str) -> Any:
        subscriber = self._session.declare_subscriber(key, zenoh.handlers.RingChannel(SLOTS))
        self._channels.append((number, subscriber.handler))
        return subscriber


def _arrived(message: Converted) -> int:
    return message.arrived
