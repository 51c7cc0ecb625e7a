"""One callback at a time, in order of arrival."""

import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic
from types import TracebackType
from typing import Protocol


class Barrier(Protocol):
    """Like a lock: who has acquired it and acquires it again waits until somebody releases it."""

    def acquire(self) -> object:
        """Close it, or wait there."""

    def release(self) -> None:
        """Let whoever waits there go on."""


class Turn:
    """Mutual exclusion that is served in order of arrival.

    `threading.Lock` lets a thread that releases and at once acquires again starve the others for
    seconds; here it hands over. Without contention it costs no more than the lock itself.
    """

    def __init__(
        self,
        on_death: Callable[[BaseException], None] | None = None,
        new_barrier: Callable[[], Barrier] = threading.Lock,
    ) -> None:
        """
        Args:
            on_death: is told what ended a thread that runs callbacks here; by default Python's own hook is.
            new_barrier: makes what a thread waits at.
        """
        lock = threading.Lock()
        waiting: deque[Barrier] = deque()
        try_lock, unlock = lock.acquire, lock.release

        def queue(barrier: Barrier) -> bool:
            waiting.append(barrier)
            if not try_lock(False):
                return False
            # The holder left before it could see the barrier. Nobody else can have taken the barrier
            # out: only a holder does, and then the lock stays locked.
            waiting.remove(barrier)
            return True

        def wait() -> None:
            barrier = new_barrier()
            barrier.acquire()
            if not queue(barrier):
                barrier.acquire()  # opened by the holder before us, who leaves the lock locked for us

        def release() -> None:
            while not waiting:
                unlock()
                # Whoever came between the look and the unlocking waits to be handed the turn.
                if not waiting or not try_lock(False):
                    return
            waiting.popleft().release()

        # Closures, and taking it in two steps: this runs for every message, and attribute look-ups
        # and a call more would double its time.
        self.try_acquire: Callable[[bool], bool] = try_lock
        """`try_acquire(False)` takes the turn if it is free, and says whether it did."""
        self.wait: Callable[[], None] = wait
        """Take the turn after all who have waited longer."""
        self.queue: Callable[[Barrier], bool] = queue
        """Take the turn if it is free, and say whether it was; else the barrier is released when the turn is there."""
        self.waiting = waiting
        """Those who wait, in order; empty is false."""
        self.busy = 0.0
        """How long callbacks have run, s; whoever holds the turn adds to it when giving it away."""
        self.longest = 0.0
        """The longest that a callback held it since somebody set this to 0, s; with KEEP_ALL 16 may count as one."""
        self.longest_of = ""
        """Which callback that was."""
        self.running = ""
        """The callback that runs, as whoever holds the turn says; empty while none does."""
        self.since = 0.0
        """When it began, or got the turn again after a wait, by `time.monotonic`."""
        self.on_death = on_death
        self.release: Callable[[], None] = release
        """Pass the turn on to whoever has waited longest, if anybody waits."""

    def guarded(self, work: Callable[[], None]) -> Callable[[], None]:
        """What a thread runs that runs callbacks: should it die, that is told to the node."""

        def run() -> None:
            try:
                work()
            except BaseException as error:
                if self.on_death is None:
                    raise
                self.on_death(error)

        return run

    def ended(self, begun: float) -> None:
        """Take note that the callback that runs has come to its end, or is about to wait.

        Args:
            begun: since when it counts as busy, by `time.monotonic`.
        """
        now = monotonic()
        if now - self.since > self.longest:
            self.longest, self.longest_of = now - self.since, self.running
        self.busy += now - begun
        self.running = ""

    def acquire(self) -> None:
        """Wait for the turn."""
        if not self.try_acquire(False):
            self.wait()

    def __enter__(self) -> None:
        self.acquire()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()


def name_of(callback: Callable[..., object]) -> str:
    """What to call a callback in messages: its function's name."""
    function: object = getattr(callback, "func", callback)  # of a functools.partial
    return getattr(function, "__name__", type(function).__name__)


class _Thread(threading.local):
    """What the running thread is, if it runs callbacks."""

    turn: Turn | None = None
    """The turn that it holds while user code runs in it."""
    spare: Callable[[], None] | None = None
    """Makes sure that another thread does this one's work while it waits."""


_thread = _Thread()


def enter(turn: Turn | None, spare: Callable[[], None] | None = None) -> None:
    """Say that from here on this thread runs callbacks of a node, holding its turn; None: that it does not."""
    _thread.turn, _thread.spare = turn, spare


@contextmanager
def taking(turn: Turn, name: str, spare: Callable[[], None] | None = None) -> Iterator[None]:
    """Run what stands below as a callback of the node whose turn this is; at once within one of its callbacks.

    Args:
        turn: the node's.
        name: of the callback, for whoever asks what runs.
        spare: makes sure that another thread does this one's work while it waits.
    """
    if _thread.turn is turn:
        yield
        return
    before = _thread.turn, _thread.spare
    with turn:
        enter(turn, spare)
        turn.running, turn.since = name, monotonic()
        begun = turn.since
        try:
            yield
        finally:
            turn.ended(begun)
            _thread.turn, _thread.spare = before


@contextmanager
def paused() -> Iterator[None]:
    """Let the node's other callbacks run while this one waits for an answer.

    Without it a callback that calls a service of its own node, or of one that calls back, would wait
    for itself. As with `await`, what the node holds may have changed when the wait is over.
    """
    turn = _thread.turn
    if turn is None:
        yield
        return
    if _thread.spare is not None:
        _thread.spare()
    running = turn.running
    turn.ended(monotonic())  # what it waits counts as busy with the rest of it
    turn.release()
    try:
        yield
    finally:
        turn.acquire()
        turn.running, turn.since = running, monotonic()
