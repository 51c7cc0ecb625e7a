"""What robots say, live or in a recording, to Rerun."""

import time
from collections.abc import Callable, Sequence

import zenoh

import robo_messages
from robo.bag.progress import Tell, counted
from robo.bag.read.readable import Readable
from robo.bag.read.reader import Bag
from robo.bridges.rerun.pace import Pace
from robo.bridges.rerun.scene import Scene
from robo.bridges.rerun.sink import Sink
from robo.errors import RunError
from robo.interfaces import catalogue
from robo.samples.stream import Arrival, Stream
from robo.text.unreadable import UNREADABLE
from robo.wire import codec
from robo_messages import Message

_MOST_WAITING = 64_000_000
"""What may wait for a slow viewer, bytes; beyond it the oldest is left out."""
_FLUSH = 0.5
"""How often a viewer gets what is new, s; longer where it takes longer."""
_MOST_TOPICS, _MOST_PATHS = 5_000, 20_000
"""That are drawn, and what stands where: somebody may invent more and more."""
_PATIENCE = 60.0
"""For how long a viewer may take nothing: a laptop sleeps, a debugger holds it; s."""
_LOOK = 0.2
"""How often it is looked whether it goes on, s."""


class Feed:
    """Draws messages."""

    def __init__(self, sink: Sink, pace: Pace) -> None:
        self.drawn = 0
        """Messages of which something was drawn."""
        self.left_out = 0
        """Messages that the viewer was too slow for."""
        self._sink, self._pace = sink, pace
        self._scene = Scene()
        self._recorded = Readable()
        self._strange = 0
        self._topics: set[str] = set()
        self._paths: set[str] = set()
        self._laid_out: tuple[list[str], list[str]] | None = None
        self._lay_out()

    @property
    def unreadable(self) -> int:
        """Messages that make no sense here."""
        return self._strange + self._recorded.left_out

    def live(
        self, session: zenoh.Session, keys: Sequence[str], goes_on: Callable[[], bool], end: float | None = None
    ) -> None:
        """Draw what comes.

        Args:
            session: the network.
            keys: of topics.
            goes_on: whether somebody still looks.
            end: when it ends, by the monotonic clock.

        Raises:
            RunError: the viewer takes nothing more.
        """
        stream = Stream(session, keys, _MOST_WAITING, latched=True)
        flushed = 0.0

        def is_wanted() -> bool:
            return goes_on() and (end is None or time.monotonic() < end)

        try:
            while is_wanted():
                wait = time.monotonic() + _LOOK
                arrival = stream.get(wait if end is None else min(wait, end))
                if arrival is not None:
                    self._arrived(arrival)
                if time.monotonic() - flushed > _FLUSH:
                    self.flush(is_wanted)
                    flushed = time.monotonic()
        finally:
            self.left_out = stream.left_out
            stream.close()

    def recorded(self, bag: Bag, names: Sequence[str], goes_on: Callable[[], bool], tell: Tell) -> None:
        """Draw a recording.

        Args:
            bag: the recording.
            names: of topics.
            goes_on: whether somebody still looks.
            tell: is told how far it is.

        Raises:
            BagError: it cannot be read.
            RunError: the viewer takes nothing more.
        """
        flushed = time.monotonic()
        self._scene = Scene(names)
        total = sum(bag.topics[name].count for name in names)
        for message, value in self._recorded.of(counted(bag.messages(names), total, tell)):
            self.take(message.topic.name, value, message.published or message.arrived)
            if time.monotonic() - flushed > _FLUSH:
                self.flush(goes_on)
                flushed = time.monotonic()
                if not goes_on():
                    return
        self.flush(goes_on)

    def flush(self, goes_on: Callable[[], bool]) -> None:
        """Wait until what was drawn has arrived; what comes meanwhile waits as well.

        Args:
            goes_on: whether somebody still looks; who has closed the viewer needs nothing more.

        Raises:
            RunError: the viewer has taken nothing for a long time, or the file takes nothing more.
        """
        since = time.monotonic()
        while not self._sink.flush():
            if not goes_on():
                return
            if self._sink.is_full or time.monotonic() - since > _PATIENCE:
                raise RunError(f"Rerun takes nothing more: {self._sink.reason}")
            time.sleep(_LOOK)  # where the link is lost it is told at once

    def _arrived(self, arrival: Arrival) -> None:
        kind, _, name = str(arrival.sample.encoding).partition(";")
        type_ = catalogue.find_here(name) if kind in (codec.MSGPACK, "") and name else None
        if type_ is None:
            return
        try:
            message = robo_messages.decoder_of(type_).decode(arrival.sample.payload.to_bytes())
        except (*UNREADABLE, ValueError):
            self._strange += 1
            return
        time_ = arrival.attachment.source_time if arrival.attachment is not None else arrival.arrived
        self.take(arrival.key, message, time_, (time.time_ns() - arrival.arrived) * 1e-9)

    def take(self, key: str, message: Message, time_: int, late: float = 0.0) -> None:
        """Draw a message, unless there are too many.

        Args:
            key: its topic.
            message: it.
            time_: when it was published, ns since the epoch.
            late: for how long it has waited, s.
        """
        if not 0 < time_ < 2**63 or not _has_room(self._topics, key, _MOST_TOPICS):
            return
        if not self._pace.draws(key, message, time_, late):
            return
        try:
            marks = [mark for mark in self._scene.take(key, message) if _has_room(self._paths, mark.path, _MOST_PATHS)]
            self._sink.draw(marks, time_)
        except (ValueError, TypeError, OverflowError):  # of one message: it ends the view of no other
            self._strange += 1
            return
        if marks:
            self.drawn += 1
            self._lay_out()

    def _lay_out(self) -> None:
        """Say anew which views there are, where there is something that had none."""
        wanted = (list(self._scene.pictures), self._scene.trails)
        if wanted != self._laid_out:
            self._laid_out = wanted
            self._sink.lay_out(*wanted)


def _has_room(known: set[str], name: str, most: int) -> bool:
    if name in known:
        return True
    if len(known) >= most:
        return False
    known.add(name)
    return True
