"""What is said next while a recording is played: what is due, what was said before a jump, steps, loops. Pure."""

from collections.abc import Iterator
from typing import Generic, NamedTuple, Protocol, TypeVar

from robo.recording.play.timeline import Timeline

T = TypeVar("T")


class Item(NamedTuple, Generic[T]):
    """A message in its place."""

    time: int
    """When it came, ns since the epoch; of what was said before, the time at which it counts."""
    before: bool
    """Whether it was said before the time at which one begins: what latched topics had said last."""
    what: T


class Tape(Protocol[T]):
    """A recording, as far as playing it goes."""

    @property
    def begin(self) -> int:
        """Where it begins, ns since the epoch."""

    @property
    def end(self) -> int:
        """The time of the last message that is played, ns since the epoch."""

    def run(self, at: int) -> "Iterator[Item[T]]":
        """What latched topics had said last before a time, then all messages from it on, by their times."""


class Say(NamedTuple, Generic[T]):
    """A message that is due."""

    item: Item[T]
    due: int
    """When it was due, by the clock, ns; of what nobody has waited for, now."""
    jumped: bool
    """Whether it is the first one after the time has jumped: at the beginning, after a seek, in each loop."""


class Wait(NamedTuple):
    """Nothing is due."""

    until: int | None
    """Before this time, by the clock, ns; None for as long as nobody does anything."""


class Over:
    """Everything was said."""


class Playback(Generic[T]):
    """Tells what to say next, and is told what somebody wants."""

    def __init__(self, tape: Tape[T], now: int, *, rate: float = 1.0, paused: bool = False, loop: bool = False) -> None:
        """
        Args:
            tape: what is played.
            now: the clock's time, ns.
            rate: how many times as fast as recorded; 0 for as fast as it goes.
            paused: whether it begins with a pause.
            loop: whether it begins again at its end.

        Raises:
            UsageError: the rate makes no sense.
        """
        self._tape = tape
        self._loop = loop
        self._steps = 0
        self._item: Item[T] | None = None
        self._ended = self._said = self._jumped = self._waits = False
        self._time = Timeline(tape.begin, now, rate, paused=paused)
        self._begin_at(tape.begin, now)

    @property
    def rate(self) -> float:
        """How many times as fast as recorded; 0 for as fast as it goes."""
        return self._time.rate

    @property
    def paused(self) -> bool:
        """Whether it stands."""
        return self._time.paused

    @property
    def coming(self) -> Iterator[Item[T]] | None:
        """Where the next message is to be looked for, which may take a while; None where it is known what comes next.

        Whoever must not wait in `next` asks it for the next message, and gives that to `take`.
        """
        return None if self._item is not None or self._ended else self._coming

    def take(self, coming: Iterator[Item[T]], item: Item[T] | None) -> None:
        """What came of `coming`, None at its end. After a jump nobody wants it."""
        if coming is self._coming:
            self._item, self._ended = item, item is None

    @property
    def next_time(self) -> int | None:
        """The time of the next message, ns since the epoch; None at the end, and as long as it is looked for."""
        return None if self._item is None else max(self._item.time, self._first)

    def position(self, now: int) -> int:
        """Where in the recording it is, ns since the epoch: never beyond a message that has not been said."""
        if self._waits or self.coming is not None:
            return self._last
        return min(self._time.at(now), self._tape.end if self.next_time is None else self.next_time)

    def next(self, now: int) -> Say[T] | Wait | Over:
        """What to do at this time; to be called again after it was done, or once anything was changed."""
        if self.coming is not None:
            self.take(self._coming, next(self._coming, None))
        item = self._item
        if self._waits:
            self._waits = False
            self._time.jump(self._first, now)  # time goes on from when there is something to be said
        if item is None:
            if self._time.paused and not (self._steps and self._again):
                return Wait(None)  # somebody may jump back
            if not self._again:
                return Over()
            self._begin_at(self._tape.begin, now)
            return Wait(now)
        if item.before:
            return self._say(item, now)
        due = self._time.due(item.time)
        if due is None:
            if not self._steps:
                return Wait(None)
            self._steps -= 1
            due = now
        elif not self._time.rate:
            due = now
        if due > now:
            return Wait(due)
        self._time.reach(item.time)
        self._said = True
        return self._say(item, due)

    def pause(self, now: int) -> None:
        """Stand where it is."""
        if not self._time.paused:
            self._time.pause(self.position(now), now)

    def resume(self, now: int) -> None:
        """Go on."""
        self._steps = 0
        self._time.resume(now)

    def step(self, count: int = 1) -> bool:
        """Say so many messages while it stands. Returns whether it does, and is not at its end."""
        if not self._time.paused or (self._ended and not self._again):
            return False
        self._steps += count
        return True

    def seek(self, at: int, now: int) -> int:
        """Go to another time, ns since the epoch. Returns where that is: it stays within what is played."""
        at = self._within(at)
        self._steps = 0
        self._begin_at(at, now)
        return at

    def hurry(self, now: int) -> int:
        """Go to the time of the next message. Returns where that is, ns since the epoch."""
        if self.next_time is not None:
            self._waits = False
            self._time.jump(self.next_time, now)
        return self.position(now)

    def change_rate(self, rate: float, now: int) -> None:
        """Be quicker or slower from now on.

        Raises:
            UsageError: the rate makes no sense.
        """
        self._time.change_rate(rate, self.position(now), now)

    def put_off(self, by: int) -> None:
        """Whoever plays has stood still for so long, ns: what is due comes later, and not all at once."""
        self._time.put_off(by)

    def _within(self, at: int) -> int:
        return min(max(at, self._tape.begin), self._tape.end)

    def _begin_at(self, at: int, now: int) -> None:
        self._time.jump(at, now)
        self._first = self._last = at
        self._coming = self._tape.run(at)
        self._item = None
        self._ended = self._said = False
        self._jumped = self._waits = True

    @property
    def _again(self) -> bool:
        """Whether it begins again at its end: what says nothing would do so for ever."""
        return self._loop and self._said

    def _say(self, item: Item[T], due: int) -> Say[T]:
        say = Say(item, due, self._jumped)
        self._jumped, self._item, self._last = False, None, max(item.time, self._first)
        return say
