"""A flight recorder: the last seconds of a robot in a ring of files, and a file of its own for what has happened.

It has a thread that looks a few times a second, and another one while a file is written. What fails is told once, and
what goes on goes on: whatever becomes of its disks, no robot stops for it.
"""

import shutil
import threading
import time
from collections.abc import Callable
from contextlib import suppress

import msgspec
import zenoh

from robo.errors import BagError
from robo.recording.flight.evidence import Witnesses
from robo.recording.flight.files import FlightFiles, Held, Job, Log, Recorder, Settings
from robo.recording.flight.intake import FlightIntake
from robo.recording.flight.ring import Limits, Ring, ring_folder, rings_without_owner, taken_over
from robo.recording.flight.windows import CLOCKS_AGREE, Reason, Windows
from robo.recording.selection import Selection
from robo.text.unreadable import UNREADABLE
from robo.wire.keys import event_key
from robo.wire.reports import Event
from robo.wire.run_id import supervisor_lives
from robo_messages import Snapshot

LOOK = 0.25
"""How often the channels are emptied, s: the less often, the less it costs."""
MOST_WAITING = 200
"""Messages that are to wait for a look: where more would come, it is looked more often."""
LOOK_LARGE = 0.02
"""The same while messages come that hold their publishers' shared memory as long as they wait, s."""
_TEND = 1.0
"""How often files are looked after, s."""
_RETRY = 5.0
"""After how long a ring that could not be written is tried again, s."""
_FIRST_PARAMETERS = 1.0
"""After how long nodes are asked for their parameters, s."""
_PARAMETERS = 30.0
"""And how often from then on, s."""
_PATIENCE = 1.0
"""With a supervisor that does not answer, s."""
_LAST_PATIENCE = 0.5
"""The same when the recorder itself is to end, s."""
_MOST_EVENTS = 1000
"""That wait."""
_NOTHING_KEPT = "nothing is kept"


class Flight:
    """One flight recorder."""

    def __init__(
        self,
        session: zenoh.Session,
        recorder: Recorder,
        settings: Settings,
        selection: Selection,
        log: Log,
        publish: Callable[[Snapshot], None],
    ) -> None:
        """
        Args:
            session: the network.
            recorder: which one it is.
            settings: what is kept.
            selection: of which topics.
            log: where it tells what happens.
            publish: is told each file.

        Raises:
            FlightRecorderError: another one of this run lives.
        """
        self._recorder = recorder
        self._settings = settings
        self._log = log
        now = time.time_ns()
        self._windows = Windows(settings.before, settings.after, settings.again)
        self._jobs: dict[int, Job] = {}
        self._lock = threading.Lock()
        """Around windows and jobs."""
        self._told: set[str] = set()
        self.ring_problem = ""
        """Why nothing is kept just now; empty where all is well."""
        self._folder = ring_folder(settings.ring_base, recorder.namespace, recorder.run)
        self._ring_due = 0.0
        """When it is tried again, by the monotonic clock, s."""
        self._ring: Ring | None = self._new_ring(now)
        self.ring_size = 0
        """Of the ring, bytes."""
        run = recorder.run if recorder.launched else ""
        self._witnesses = Witnesses(session, recorder.namespace, run)
        self.files = FlightFiles(recorder, settings, self._witnesses, log, publish)
        self._intake = FlightIntake(session, selection, self._tell_once, now)
        self._events = session.declare_subscriber(event_key("**"), zenoh.handlers.RingChannel(_MOST_EVENTS))
        self._seen_events: dict[tuple[int, str], None] = {}
        self._begun = self._looked = now
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="robo-flight", daemon=True)

    def start(self) -> None:
        """Begin to keep what comes."""
        self._thread.start()

    def happened(self, reason: Reason) -> Job | None:
        """Something has happened, by any thread: the file that it will be in; None where there is one already."""
        with self._lock:
            window = self._windows.add(reason)
            return self._jobs.setdefault(id(window), Job(window)) if window is not None else None

    def close(self, timeout: float) -> None:
        """End it: what is to be written is written with what has come so far, within `timeout` s."""
        until = time.monotonic() + timeout
        self._stop.set()
        self._thread.join(timeout)
        finished = self.files.finish(until)
        self._intake.close()
        self._events.undeclare()
        with self._lock:
            for job in self._jobs.values():  # asked for when it was too late
                job.problem = "the flight recorder ends"
                job.done.set()
        if self._ring is not None:
            # What could not be written in time is found by whoever comes next.
            self._ring.close(remove=finished)

    # -- its thread ------------------------------------------------------------------------------

    def _run(self) -> None:
        begin = time.monotonic()
        tend, ask_parameters, pause = begin, begin + _FIRST_PARAMETERS, LOOK
        threading.Thread(target=self._look_for_the_dead, name="robo-flight-dead", daemon=True).start()
        while not self._stop.wait(pause):
            pause = self._look(time.time_ns())
            now = time.monotonic()
            if now >= tend:
                tend = now + _TEND
                self._tend()
            if now >= ask_parameters:
                ask_parameters = now + _PARAMETERS
                self._witnesses.ask_parameters()
        self._end()

    def _look(self, now: int, *, last: bool = False) -> float:
        """Take in what has come, and write what is due. Returns how long to wait until the next look, s."""
        batch = self._intake.batch(now)
        if self._ring is not None and not self.ring_problem:
            recording = self._ring.recording
            try:
                for topic, data, arrived, published, sequence, source in batch.messages:
                    recording.write(recording.topic(topic), data, arrived, published, sequence, source)
                recording.tick()
            except BagError as error:
                self._lose_ring(error)
        self._hear_events()
        with self._lock:
            window = self._windows.take(now, at_once=last)
            job = self._jobs.pop(id(window)) if window is not None else None
        if job is not None:
            self._begin_writing(job, now, _LAST_PATIENCE if last else _PATIENCE)
        if batch.large:
            return LOOK_LARGE
        span, self._looked = (now - self._looked) * 1e-9, now
        return min(max(span * MOST_WAITING / max(len(batch.messages), 1), LOOK_LARGE), LOOK)

    def _end(self) -> None:
        """Whoever ends a run may do so because of what has just happened."""
        recently = time.time_ns() - round(2e9 * max(self._settings.after, 1.0))
        if self._recorder.launched:
            for event in self._witnesses.events(_LAST_PATIENCE):
                if event.time >= max(recently, self._begun):
                    self._take_event(event)
        self._look(time.time_ns(), last=True)

    def _hear_events(self) -> None:
        while (sample := self._events.handler.try_recv()) is not None:
            with suppress(*UNREADABLE):
                self._take_event(msgspec.msgpack.decode(sample.payload.to_bytes(), type=Event))

    def _take_event(self, event: Event) -> None:
        within = (
            event.node.startswith(f"/{self._recorder.namespace}/") if self._recorder.namespace else bool(event.node)
        )
        what = event.time, event.node
        if not event.alarm or not within or event.node == self._recorder.full_name or what in self._seen_events:
            return
        self._seen_events[what] = None
        if len(self._seen_events) > _MOST_EVENTS:
            del self._seen_events[next(iter(self._seen_events))]
        now = time.time_ns()  # of a supervisor on another machine the clock may be another one
        at = event.time if abs(event.time - now) < CLOCKS_AGREE else now
        self.happened(Reason(at, event.alarm, event.node, event.reason))

    # -- the ring --------------------------------------------------------------------------------

    def _new_ring(self, now: int) -> Ring | None:
        s = self._settings
        limits = Limits(duration=s.before + 2 * s.after, size=s.ring_size, compression=s.compression)
        try:
            ring = Ring(self._folder, limits, now)
        except BagError as error:
            self._lose_ring(error)
            return None
        if ring.taken:
            self._log.info("took over the last seconds that another recorder had kept before it died")
        return ring

    def _lose_ring(self, error: BagError) -> None:
        self.ring_problem = str(error)
        self._tell_once(f"{_NOTHING_KEPT}: {error}; trying again every {_RETRY:g} s")
        self._ring_due = time.monotonic() + _RETRY

    def _tend(self) -> None:
        now = time.time_ns()
        if not self.ring_problem:
            assert self._ring is not None
            try:
                self._ring.look(now)
            except BagError as error:
                self._lose_ring(error)
            self.ring_size = self._ring.size
        elif time.monotonic() >= self._ring_due:
            self._renew_ring(now)

    def _renew_ring(self, now: int) -> None:
        try:
            if self._ring is None:
                self._ring = self._new_ring(now)
                if self._ring is None:
                    return
            else:
                self._ring.begin_anew(now)
        except BagError as error:
            self._lose_ring(error)
            return
        self.ring_problem = ""
        self._told = {text for text in self._told if not text.startswith(_NOTHING_KEPT)}
        self._log.info("all topics are kept again")

    # -- files -----------------------------------------------------------------------------------

    def _begin_writing(self, job: Job, now: int, patience: float) -> None:
        held: Held = (None, [])
        if self._ring is not None:
            try:
                held = self._ring.hold(now)
            except BagError as error:
                self._lose_ring(error)
        self.files.begin(job, held, patience)

    def _look_for_the_dead(self) -> None:
        """Write what was kept by recorders of runs that have ended without a word."""
        who, base = self._recorder, self._settings.ring_base
        for folder in rings_without_owner(base, who.namespace, who.run, supervisor_lives):
            left = [files for _, files in sorted(taken_over(folder).items())]
            if left:
                end = max(one.end for files in left for one in files)
                self.files.write_last_words(folder.name, end, [[one.path for one in files] for files in left])
            shutil.rmtree(folder, ignore_errors=True)

    def _tell_once(self, text: str) -> None:
        if text not in self._told and len(self._told) < _MOST_EVENTS:
            self._told.add(text)
            self._log.warning("%s", text)
