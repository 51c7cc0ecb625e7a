"""Messages of all topics of a robot, taken out of Zenoh's channels in batches: nothing runs for a single one.

That costs two thirds of what a call of Python for each message does, and a third less than to be woken for each; for
that, the time of arrival is known from two looks at the channels and from when a message was published.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import zenoh

from robo.recording.conversion import Conversion, Converted
from robo.recording.flight.windows import arrivals
from robo.recording.intake import LIVE, Intake
from robo.recording.odometry import TransformsOfOdometry
from robo.recording.selection import Selection
from robo.wire.shared_buffers import LARGE, is_torn

SLOTS = 2048
"""Messages that wait in a channel; of more the oldest are left out, and missing in the numbers. Even a small one takes
10 kB there (zenoh 1.10.2)."""


class Batch(NamedTuple):
    """What has come since the last look, in order."""

    messages: list[Converted]
    large: bool
    """Whether messages are among them that hold shared memory of their publishers for as long as nobody looks."""


class FlightIntake(Intake):
    """Takes in messages, and what latched publishers have said before. `batch` is called by one thread at a time."""

    def __init__(self, session: zenoh.Session, selection: Selection, tell: Callable[[str], None], now: int) -> None:
        """
        Args:
            session: the network.
            selection: which topics.
            tell: is told once of each topic that cannot be written down as it should.
            now: ns since the epoch.
        """
        self.torn = 0
        """Messages that were lost because this process was stopped while they were in shared memory."""
        self._looked = now
        self._channels: list[tuple[int, Any]] = []
        self._conversion = Conversion(tell, lambda key: self.offers.of(key))
        self._transforms = TransformsOfOdometry()
        super().__init__(session, selection, offer_changed=self._conversion.forget)

    def batch(self, now: int) -> Batch:
        """What has come since the last look; `now` is in ns since the epoch."""
        row = self._row
        for number, handler in self._channels:
            try_recv = handler.try_recv
            while (sample := try_recv()) is not None:
                row.append((now, LIVE, sample, number, 0))
        convert, see = self._conversion.convert, self._transforms.take
        before: list[Converted] = []
        live: list[Converted] = []
        large = False
        for came in self.take():
            message = convert(came)
            if len(came.sample.payload) >= LARGE:
                large = True
                if is_torn(came.sample.payload):
                    self.torn += 1
                    continue
            if message is None:
                continue
            (live if came.arrived == now else before).append(message)
            if (made := see(message)) is not None:
                live.append(made)
        times = arrivals([one.published if one.published != now else None for one in live], self._looked, now)
        found = before + [one._replace(arrived=at) for one, at in zip(live, times, strict=True)]
        found.sort(key=_arrived)
        self._looked = now
        return Batch(found, large)

    def _subscribe(self, number: int, key: str) -> Any:
        subscriber = self._session.declare_subscriber(key, zenoh.handlers.RingChannel(SLOTS))
        self._channels.append((number, subscriber.handler))
        return subscriber


def _arrived(message: Converted) -> int:
    return message.arrived
