"""A flight recorder: the last seconds of a robot in a ring of files, and a file of its own for what has happened.

It has a thread that looks a few times a second, and another one while a file is written. What fails is told once, and
what goes on goes on: whatever becomes of its disks, no robot stops for it.
"""

import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial

import msgspec
import zenoh

from robo.recording.flight.clock import SteadyClock
from robo.recording.flight.evidence import Witnesses
from robo.recording.flight.files import FlightFiles, Job, Log, Recorder, Settings
from robo.recording.flight.intake import FlightIntake
from robo.recording.flight.keeping import Keeping, Place
from robo.recording.flight.left_behind import LeftBehind
from robo.recording.flight.ring import Limits
from robo.recording.flight.windows import CLOCKS_AGREE, Kind, Reason, Windows
from robo.recording.selection import Selection
from robo.text.once import Once
from robo.text.readable import readable
from robo.text.unreadable import UNREADABLE
from robo.wire.keys import event_key
from robo.wire.reports import Event
from robo_messages import Snapshot

LOOK = 0.25
"""How often the channels are emptied, s: the less often, the less it costs."""
MOST_WAITING = 200
"""Messages that are to wait for a look: where more would come, it is looked more often."""
LOOK_LARGE = 0.02
"""The same while messages come that hold their publishers' shared memory as long as they wait, s."""
_TEND = 1.0
"""How often files are looked after, s."""
_FIRST_PARAMETERS = 1.0
"""After how long nodes are asked for their parameters, s."""
_PARAMETERS = 30.0
"""And how often from then on, s; what others have left and could not be written is tried again as often."""
_PATIENCE = 1.0
"""With a supervisor that does not answer, s."""
_LAST_PATIENCE = 0.5
"""The same when the recorder itself is to end, s."""
_MOST_EVENTS = 1000
"""That wait."""
_SAME = 10_000_000
"""Whose times differ by less may be one and the same, ns: a file has them by way of another clock."""


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
        self._clock = SteadyClock()
        now = self._clock.now()
        self._windows = Windows(settings.before, settings.after, settings.again)
        self._jobs: dict[int, Job] = {}
        self._lock = threading.Lock()
        """Around windows and jobs."""
        self._tell_once = Once(partial(log.warning, "%s"))
        place = Place(settings.ring_bases, recorder.namespace, recorder.run)
        # A file may have to wait until the one before it is written.
        duration = settings.before + 2 * settings.after
        limits = Limits(duration=duration, size=settings.ring_size, compression=settings.compression)
        self.keeping = Keeping(place, limits, log, now)
        run = recorder.run if recorder.launched else ""
        self._witnesses = Witnesses(session, recorder.namespace, run)
        self.files = FlightFiles(recorder, settings, self._witnesses, log, self._tell_once, publish)
        self._left_behind = LeftBehind(self.files, place)
        self._intake = FlightIntake(session, selection, self._tell_once, self.keeping.forget, now)
        self._events = session.declare_subscriber(event_key("**"), zenoh.handlers.RingChannel(_MOST_EVENTS))
        self._seen_events: dict[tuple[int, str], None] = {}
        self._missed: deque[tuple[Event, bool]] = deque()
        """What happened before this recorder was there, and whether there is a file of it."""
        self._begun = time.time_ns()
        self._looked = now
        self._pause = LOOK
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="robo-flight", daemon=True)

    def start(self) -> None:
        """Begin to keep what comes."""
        self._thread.start()

    @property
    def alive(self) -> bool:
        """Whether it keeps what comes, as far as its disk lets it."""
        return self._thread.is_alive()

    @property
    def left_out(self) -> int:
        """Messages that came and were not kept: too much had come at once."""
        return self._intake.dropped + self._intake.torn

    def happened(self, kind: Kind, node: str, text: str) -> Job | None:
        """Something has happened now, by any thread: the file that it will be in; None where there is one already.

        Args:
            kind: what.
            node: the full name of the node that it concerns; empty for none.
            text: in words.
        """
        return self._add(Reason(self._clock.now(), kind, node, text))

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
        # What could not be written in time is found by whoever comes next.
        self.keeping.close(remove=finished)

    # -- its thread ------------------------------------------------------------------------------

    def _run(self) -> None:
        begin = time.monotonic()
        tend, ask = begin, begin + _FIRST_PARAMETERS
        self._beside(self._look_back)
        while not self._stop.wait(self._pause):
            self._pause = LOOK
            self._try(self._look)
            now = time.monotonic()
            if now >= tend:
                tend = now + _TEND
                self._try(lambda: self.keeping.tend(self._clock.now()))
            if now >= ask:
                ask = now + _PARAMETERS
                self._try(self._witnesses.ask_parameters, keeps=False)
                if self._left_behind.remain:
                    self._beside(self._left_behind.write)
        self._end()

    def _try(self, step: Callable[[], object], *, keeps: bool = True) -> None:
        """Do something whose failure ends nothing; where it `keeps` something, what is kept may have a hole then."""
        try:
            step()
        except Exception as error:
            self._tell_once(f"the flight recorder has failed, and goes on: {type(error).__name__}: {error}")
            if keeps:
                self.keeping.lose(error)

    def _beside(self, step: Callable[[], object]) -> None:
        """Do something that may take long."""
        threading.Thread(target=lambda: self._try(step, keeps=False), name="robo-flight-beside", daemon=True).start()

    def _look(self, *, last: bool = False) -> None:
        """Take in what has come, and write what is due."""
        now, behind = self._clock.now(), self._clock.behind()
        batch = self._intake.batch(now, behind)
        self.keeping.keep(batch.messages)
        self._hear_events()
        with self._lock:
            if self.files.busy and not last:  # each file holds a ring until it is written
                self._windows.wait(now)
                window = None
            else:
                window = self._windows.take(now, at_once=last)
            job = self._jobs.pop(id(window)) if window is not None else None
        if job is not None:
            job.behind = behind
            self.files.begin(job, self.keeping.hold(now), _LAST_PATIENCE if last else _PATIENCE)
        span, self._looked = (now - self._looked) * 1e-9, now
        often = span * MOST_WAITING / max(len(batch.messages), 1)
        self._pause = LOOK_LARGE if batch.large else min(max(often, LOOK_LARGE), LOOK)

    def _end(self) -> None:
        """Whoever ends a run may do so because of what has just happened."""
        if self._recorder.launched:
            self._try(self._hear_last_events, keeps=False)
        self._try(lambda: self._look(last=True))

    def _look_back(self) -> None:
        """See what happened before this recorder was there: to itself, or to those of runs that are over."""
        self._try(lambda: self._witnesses.find_run(_PATIENCE), keeps=False)
        if self.keeping.follows and self._recorder.launched:
            self._try(self._recall, keeps=False)
        self._left_behind.write()

    # -- what happens ----------------------------------------------------------------------------

    def _recall(self) -> None:
        """The recorder before this one may have been killed before it had written its file."""
        now = time.time_ns()
        known = self.files.reasons(now - round(self._settings.again * 1e9) - CLOCKS_AGREE)
        until = time.monotonic() + self._settings.before
        events = self._witnesses.events(_PATIENCE)
        # That a recorder died is one of them: where there is none, nobody has answered yet.
        while not events and time.monotonic() < until and not self._stop.wait(LOOK):
            events = self._witnesses.events(_PATIENCE)
        for event in events:
            is_known = any(abs(at - event.time) < _SAME for at in known)
            if is_known or (now - event.time) * 1e-9 < self._settings.before:
                self._missed.append((event, is_known))

    def _hear_last_events(self) -> None:
        recently = time.time_ns() - round(2e9 * max(self._settings.after, 1.0))
        for event in self._witnesses.events(_LAST_PATIENCE):
            if event.time >= max(recently, self._begun):
                self._take_event(event)

    def _hear_events(self) -> None:
        while self._missed:
            event, is_known = self._missed.popleft()
            self._take_event(event, longest=round(self._settings.before * 1e9), is_known=is_known)
        while (sample := self._events.handler.try_recv()) is not None:
            with suppress(*UNREADABLE):
                self._take_event(msgspec.msgpack.decode(sample.payload.to_bytes(), type=readable(Event)))

    def _take_event(self, event: Event, *, longest: int = CLOCKS_AGREE, is_known: bool = False) -> None:
        """Something has happened in a run, at most `longest` ns ago; where it `is_known`, there is a file of it."""
        within = (
            event.node.startswith(f"/{self._recorder.namespace}/") if self._recorder.namespace else bool(event.node)
        )
        what = event.time, event.node
        if not event.alarm or not within or event.node == self._recorder.full_name or what in self._seen_events:
            return
        self._seen_events[what] = None
        if len(self._seen_events) > _MOST_EVENTS:
            del self._seen_events[next(iter(self._seen_events))]
        now = self._clock.now()
        at = event.time - self._clock.behind()  # of a supervisor on another machine the clock may be another one
        at = at if -longest < at - now < CLOCKS_AGREE else now
        reason = Reason(at, event.alarm, event.node, event.reason)
        if is_known:
            with self._lock:
                self._windows.note(reason)
        else:
            self._add(reason)

    def _add(self, reason: Reason) -> Job | None:
        with self._lock:
            window = self._windows.add(reason)
            return self._jobs.setdefault(id(window), Job(window, self._recorder.run)) if window is not None else None
