"""Plays a recording: publishes what is due by the monotonic clock; any thread may pause it, jump, change its rate."""

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NamedTuple, TypeVar

from robo.recording.play.ahead import Ahead
from robo.recording.play.outputs import ClockOutput, Outputs
from robo.recording.play.playback import Item, Over, Playback, Say, Wait
from robo.recording.play.tape import BagTape, Ready

R = TypeVar("R")

STOOD_STILL = 0.5
"""Who wakes so much too late was stopped, or the machine was, s: what is due then comes later, and not all at once."""

_HANGS = 0.2
"""A message that takes longer to go out waits for a receiver, s; nobody waits for that."""
_LONGEST_WAIT = 3600.0
"""s."""
_SWITCH = 0.5e-3
"""How long the thread that reads may keep the one that publishes waiting, s; Python's own 5 ms is too late."""


class State(NamedTuple):
    """How far it has come."""

    position: int
    """ns since the epoch."""
    rate: float
    paused: bool
    played: int
    """Messages."""
    coming: int | None = None
    """The time of the next message, ns since the epoch; None at the end, and while it is looked for."""


class _Tape:
    """A tape that is read ahead, or by whoever wants its messages."""

    def __init__(self, tape: BagTape, *, ahead: bool) -> None:
        self.begin, self.end = tape.begin, tape.end
        self._tape = tape
        self._ahead: Ahead[Ready] | None = Ahead(tape.run, _size_of) if ahead else None
        self._wanted = object()

    def run(self, at: int) -> Iterator[Item[Ready]]:
        """What is said from a time on; what was asked for before is wanted no more."""
        if self._ahead is not None:
            return self._ahead.run(at)
        this = self._wanted = object()
        return self._tape.run(at, lambda: this is self._wanted)

    def stop(self) -> None:
        """Nothing more is wanted; who waits for something waits no longer."""
        self._wanted = object()
        if self._ahead is not None:
            self._ahead.stop()

    def close(self) -> None:
        """After this the recording may be closed."""
        self.stop()
        if self._ahead is not None:
            self._ahead.close()


def _size_of(message: Ready) -> int:
    return len(message.payload)


class Player:
    """Plays in the thread that calls `run`; all else may be called by any other."""

    def __init__(
        self,
        tape: BagTape,
        outputs: Outputs,
        *,
        rate: float = 1.0,
        paused: bool = False,
        loop: bool = False,
        clock: ClockOutput | None = None,
        clock_period: float | None = None,
        on_change: Callable[[], None] = lambda: None,
    ) -> None:
        """
        Args:
            tape: what is played.
            outputs: where it goes.
            rate: how many times as fast as recorded; 0 for as fast as nothing is lost.
            paused: whether it begins with a pause.
            loop: whether it begins again at its end.
            clock: says what time it is, before each message.
            clock_period: says it also so often, s of the wall clock, whether it stands or not.
            on_change: called when somebody has paused it, jumped, and so on.

        Raises:
            UsageError: the rate makes no sense.
        """
        # Who does not wait for anything to be due has no time in which another thread could read: both would only wait
        # for each other.
        self._tape = _Tape(tape, ahead=rate != 0)
        self._outputs = outputs
        self._clock = clock
        self._clock_period = round(clock_period * 1e9) if clock_period else None
        self._clock_due = 0
        self._clock_said = -1
        self._on_change = on_change
        self._changed = threading.Condition()
        self._in_hand = False
        """Whether something is on its way out; it is not the lock that is held meanwhile, for receivers may be slow."""
        self._awaited = 0
        """How many wait until it is out."""
        self._stopped = False
        self.played = 0
        """Messages that were published."""
        self.latest = 0.0
        """How late the latest of them was, s."""
        try:
            now = time.monotonic_ns()
            self._playback: Playback[Ready] = Playback(self._tape, now, rate=rate, paused=paused, loop=loop)
        except BaseException:
            self.close()
            raise

    def run(self) -> bool:
        """Play, until everything was said or somebody stops it. Returns whether everything was.

        Raises:
            DamagedBag: a part of the recording is damaged; what comes before it was played.
        """
        with _quick_turns():
            while True:
                told = None
                with self._changed:
                    self._in_hand = False
                    if self._awaited:
                        self._changed.notify_all()
                    if self._stopped:
                        return False
                    coming = self._playback.coming
                    now = time.monotonic_ns()
                    said = self._playback.next(now) if coming is None else None
                    if isinstance(said, Over):
                        return True
                    if isinstance(said, Wait):
                        told = self._time_to_tell(now)
                        if told is None:
                            self._wait(said.until, now)
                            continue
                    self._in_hand = coming is None
                if coming is not None:
                    self._look_for(coming)
                elif isinstance(said, Say):
                    self._say(said, now)
                elif told is not None:
                    self._tell_time(told)

    def pause(self) -> None:
        """Stand where it is."""
        self._do(self._playback.pause)

    def resume(self) -> None:
        """Go on."""
        self._do(self._playback.resume)

    def toggle(self) -> None:
        """Stand, or go on."""
        self._do(lambda now: self._playback.resume(now) if self._playback.paused else self._playback.pause(now))

    def step(self, count: int = 1) -> bool:
        """Say so many messages while it stands. Returns whether it does, and is not at its end."""
        return self._do(lambda _: self._playback.step(count))

    def seek(self, at: int) -> int:
        """Go to a time, ns since the epoch. Returns where that is: within what is played."""
        return self._do(lambda now: self._playback.seek(at, now))

    def skip(self, by: float) -> int:
        """Go on or back by so many seconds of the recording. Returns where that is, ns since the epoch."""
        return self._do(lambda now: self._playback.seek(self._playback.position(now) + round(by * 1e9), now))

    def hurry(self) -> int:
        """Go to the time of the next message. Returns where that is, ns since the epoch."""
        return self._do(self._playback.hurry)

    def change_rate(self, rate: float) -> None:
        """Be quicker or slower.

        Raises:
            UsageError: the rate makes no sense.
        """
        self._do(lambda now: self._playback.change_rate(rate, now))

    def put_off(self, by: float) -> None:
        """Whoever plays has stood still for so long, s."""
        self._do(lambda _: self._playback.put_off(round(by * 1e9)))

    def stop(self) -> None:
        """Play no more."""
        with self._changed:
            self._stopped = True
            self._changed.notify_all()
        self._tape.stop()

    @property
    def stopped(self) -> bool:
        """Whether somebody has stopped it."""
        return self._stopped

    @property
    def state(self) -> State:
        """How far it has come."""
        with self._changed:
            playback = self._playback
            at = playback.position(time.monotonic_ns())
            return State(at, playback.rate, playback.paused, self.played, playback.next_time)

    @property
    def span(self) -> tuple[int, int]:
        """From when to when goes what is played, ns since the epoch."""
        return self._tape.begin, self._tape.end

    def close(self) -> None:
        """Read no more; after this the recording may be closed."""
        self.stop()
        self._tape.close()

    def _do(self, what: Callable[[int], R]) -> R:
        with self._changed:
            done = what(time.monotonic_ns())
            self._changed.notify_all()
            # What was due before is out before whoever wanted this hears of it, unless a receiver hangs.
            self._awaited += 1
            self._changed.wait_for(lambda: not self._in_hand or self._stopped, _HANGS)
            self._awaited -= 1
        self._on_change()
        return done

    def _look_for(self, coming: Iterator[Item[Ready]]) -> None:
        """Find what comes next; whatever somebody wants meanwhile, he need not wait for it."""
        try:
            item = next(coming, None)
        except BaseException:
            with self._changed:
                if self._playback.coming is coming:
                    raise
            return  # it is of a part that nobody wants any more
        with self._changed:
            self._playback.take(coming, item)

    def _time_to_tell(self, now: int) -> int | None:
        """What time to tell, ns since the epoch, though no message is due; None as long as that is not due."""
        if self._clock is None or self._clock_period is None or now < self._clock_due:
            return None
        due = self._clock_due + self._clock_period
        self._clock_due = due if due > now else now + self._clock_period
        return self._playback.position(now)

    def _wait(self, until: int | None, now: int) -> None:
        """Wait until something is due, or is changed; the lock is held."""
        if self._clock is not None and self._clock_period is not None:
            until = min(until, self._clock_due) if until is not None else self._clock_due
        left = (until - now) * 1e-9 if until is not None else _LONGEST_WAIT
        if not self._changed.wait(min(left, _LONGEST_WAIT)) and until is not None:
            late = time.monotonic_ns() - until
            if late > STOOD_STILL * 1e9:
                self._playback.put_off(late)

    def _say(self, said: Say[Ready], now: int) -> None:
        if self._clock is not None and (said.jumped or said.item.time > self._clock_said):
            self._tell_time(said.item.time)
        self._outputs.send(said.item.what)
        self.played += 1
        self.latest = max(self.latest, (now - said.due) * 1e-9)

    def _tell_time(self, at: int) -> None:
        assert self._clock is not None
        self._clock_said = at
        self._clock.send(at)


@contextmanager
def _quick_turns() -> Iterator[None]:
    """Threads of this process take turns more often."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(min(before, _SWITCH))
    try:
        yield
    finally:
        sys.setswitchinterval(before)
