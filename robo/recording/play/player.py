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


class _Tape:
    """A tape that is read ahead."""

    def __init__(self, tape: BagTape, ahead: "Ahead[Ready]") -> None:
        self.begin, self.end = tape.begin, tape.end
        self._ahead = ahead

    def run(self, at: int) -> Iterator[Item[Ready]]:
        return self._ahead.run(at)


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
        self._ahead = Ahead(tape.run, _size_of) if rate else None
        self._outputs = outputs
        self._clock = clock
        self._clock_period = round(clock_period * 1e9) if clock_period else None
        self._clock_due = 0
        self._clock_said = -1
        self._on_change = on_change
        self._changed = threading.Condition()
        self._stopped = False
        self.played = 0
        """Messages that were published."""
        self.latest = 0.0
        """How late the latest of them was, s."""
        try:
            now = time.monotonic_ns()
            self._playback: Playback[Ready] = Playback(
                _Tape(tape, self._ahead) if self._ahead is not None else tape,
                now,
                rate=rate,
                paused=paused,
                loop=loop,
            )
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
                with self._changed:
                    if self._stopped:
                        return False
                    self._playback.prepare()
                    now = time.monotonic_ns()
                    said = self._playback.next(now)
                    if isinstance(said, Over):
                        return True
                    if isinstance(said, Wait):
                        self._wait(said.until, now)
                        continue
                self._say(said, now)

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

    @property
    def stopped(self) -> bool:
        """Whether somebody has stopped it."""
        return self._stopped

    @property
    def state(self) -> State:
        """How far it has come."""
        with self._changed:
            playback = self._playback
            return State(playback.position(time.monotonic_ns()), playback.rate, playback.paused, self.played)

    def close(self) -> None:
        """Read no more; after this the recording may be closed."""
        self.stop()
        if self._ahead is not None:
            self._ahead.close()

    def _do(self, what: Callable[[int], R]) -> R:
        with self._changed:
            done = what(time.monotonic_ns())
            self._changed.notify_all()
        self._on_change()
        return done

    def _wait(self, until: int | None, now: int) -> None:
        """Wait until something is due, or is changed; the lock is held."""
        if self._clock is not None and self._clock_period is not None:
            if now >= self._clock_due:
                self._tell_time(self._playback.position(now))
                self._clock_due = max(self._clock_due + self._clock_period, now)
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
