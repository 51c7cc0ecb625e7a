"""A ring, whatever becomes of its disk: what fails is told once, and is tried again."""

import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from robo.errors import BagError, FlightRecorderError
from robo.recording.conversion import Converted
from robo.recording.flight.files import Held, Log
from robo.recording.flight.ring import Limits, Ring, ring_folder

_RETRY = 5.0
"""After how long a ring that could not be written is tried again, s."""
_MOST_LATCHED = 10_000
"""Publishers whose last message is known to be large or not."""


class Place(NamedTuple):
    """Where a ring is."""

    bases: Sequence[Path]
    """Of all rings, the best first."""
    robot: str
    run: str

    @property
    def folders(self) -> list[Path]:
        """Where it may be."""
        return [ring_folder(base, self.robot, self.run) for base in self.bases]


class Keeping:
    """Keeps messages in a ring. Used by one thread at a time."""

    def __init__(self, place: Place, limits: Limits, log: Log, now: int) -> None:
        """
        Args:
            place: where the ring is.
            limits: what it keeps.
            log: where it is told what fails.
            now: ns since the epoch.

        Raises:
            FlightRecorderError: another recorder of this run lives.
        """
        self.problem = ""
        """Why nothing is kept just now; empty where all is well."""
        self.size = 0
        """Of the ring, bytes."""
        self._place = place
        self._limits = limits
        self._log = log
        self._due = 0.0
        """When it is tried again, by the monotonic clock, s."""
        self._latched: dict[tuple[str, str | None], int] = {}
        """How much each publisher of each latched topic has said last, bytes."""
        self._much_latched = False
        self._ring: Ring | None = None
        try:
            self._ring = self._new_ring(place.folders, now)
        except BagError as error:
            self.lose(error)
        self.follows = self._ring is not None and self._ring.follows
        """Whether another recorder of the run has died, whatever it had kept by then."""
        if self._ring is not None and self._ring.taken:
            log.info("took over the last seconds that another recorder had kept before it died")

    def keep(self, messages: Iterable[Converted]) -> None:
        """Write messages down."""
        if self._ring is None or self.problem:
            return
        recording = self._ring.recording
        try:
            for topic, data, arrived, published, sequence, source in messages:
                recording.write(recording.topic(topic), data, arrived, published, sequence, source)
                if topic.qos.latched and len(self._latched) < _MOST_LATCHED:
                    self._latched[topic.name, source] = len(data)
            recording.tick()
        except BagError as error:
            self.lose(error)

    def forget(self, topic: str, publisher: str) -> None:
        """A publisher of a latched topic is replaced: what it has said is not said again in files that follow."""
        self._latched.pop((topic, publisher), None)
        if self._ring is not None:
            self._ring.recording.forget(topic, publisher)

    def tend(self, now: int) -> None:
        """Let go what is too old, or try again; to be called once a second."""
        if self._ring is not None and not self.problem:
            try:
                self._ring.look(now)
            except BagError as error:
                self.lose(error)
            self.size = self._ring.size
            self._look_at_latched()
        elif time.monotonic() >= self._due:
            self._renew(now)

    def hold(self, now: int) -> Held:
        """Keep from going what is there, for a file; nothing where there is no ring."""
        if self._ring is not None:
            try:
                return self._ring.hold(now)
            except BagError as error:
                self.lose(error)
        return None, []

    def lose(self, error: Exception) -> None:
        """Something has failed: nothing is kept until the ring is begun anew."""
        text = str(error) if isinstance(error, BagError) else f"{type(error).__name__}: {error}"
        if not self.problem:
            self._log.warning("nothing is kept: %s; trying again every %g s", text, _RETRY)
        self.problem = text
        self._due = time.monotonic() + _RETRY

    def close(self, *, remove: bool) -> None:
        """End it; what was kept goes, unless somebody is to find it."""
        if self._ring is not None:
            self._ring.close(remove=remove)

    def _new_ring(self, folders: Sequence[Path], now: int) -> Ring:
        """A ring in the first of some folders that takes one.

        Raises:
            FlightRecorderError: another recorder of this run lives.
            BagError: none does; says why the first one does not.
        """
        first: BagError | None = None
        for folder in folders:
            try:
                return Ring(folder, self._limits, now)
            except BagError as error:
                first = first or error
        raise first or BagError("there is no other folder for it")

    def _renew(self, now: int) -> None:
        try:
            if self._ring is None:
                self._ring = self._new_ring(self._place.folders, now)
            else:
                self._begin_anew(self._ring, now)
        except (BagError, FlightRecorderError) as error:
            self.lose(error)
            return
        self.problem = ""
        self._log.info("all topics are kept again")

    def _begin_anew(self, ring: Ring, now: int) -> None:
        """Go on, in another folder if there is no other way.

        Raises:
            BagError, FlightRecorderError: there is none.
        """
        try:
            ring.begin_anew(now)
        except BagError:
            elsewhere = [folder for folder in self._place.folders if folder != ring.folder]
            if not elsewhere:
                raise
            self._ring = self._new_ring(elsewhere, now)
            ring.leave()
            self._log.info("the last seconds are kept in %s from now on", self._ring.folder)

    def _look_at_latched(self) -> None:
        """Each of the ring's files begins with what latched topics have said last."""
        size = sum(self._latched.values())
        if size > self._limits.size / 2 and not self._much_latched:
            self._log.warning(
                "latched topics have said %.1f MB, and the ring has %.1f MB: it keeps few seconds;"
                " a larger ring_size keeps more, or exclude the largest of them",
                size * 1e-6,
                self._limits.size * 1e-6,
            )
        self._much_latched = size > self._limits.size / 2
