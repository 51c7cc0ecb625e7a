"""Lets the threads of nodes under test run one at a time, in an order that is the same each time.

The nodes run as they always do: a thread for each subscription, timer and service, and one for `main`. What is
the test's is where they wait. A thread that waits for a message, or for a time, is *parked*. What is published
is queued, and handed to a thread once all are parked. When nothing is queued any more, the time goes on to
what the next thread waits for, as far as the test allows. Then all is quiet, and the test goes on.
"""

from __future__ import annotations

import itertools
import sys
import threading
import time
import traceback
from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from robo.testing.blocked import Watch

_LOOK = 0.005
"""How often one looks whether a thread has ended or is blocked, s."""

_FRAMES_SHOWN = 4


class Hung(AssertionError):
    """A callback of a node under test does not come back."""


class Actor:
    """A thread of a node under test."""

    def __init__(self, thread: threading.Thread, serial: int, lock: threading.Lock, *, strict: bool) -> None:
        self.thread = thread
        self.serial = serial
        """Of two that wait for the same time the smaller goes first."""
        self.strict = strict
        """Whether all that it does between two waits are callbacks, which come to an end."""
        self.awake = threading.Condition(lock)
        self.until: int | None = None
        """What time it waits for, ns; None while it waits for none."""
        self.woken = threading.Event()
        """What else ends that wait."""
        self.call: Call | None = None
        """What it has asked last."""
        self.watch = Watch(thread)


class Call:
    """What a thread asks: one question to each server of a service."""

    def __init__(self, asker: Actor) -> None:
        self.asker = asker
        self.open = 0
        """Questions that are not answered yet."""
        self.waits = False
        """Whether the thread waits for an answer."""


class Inbox:
    """Where threads wait for items: those of a subscription for messages, those of a service for questions."""

    def __init__(self, stepper: Stepper) -> None:
        self.items: deque[Any] = deque()
        self.closed = False
        self.readers: list[Actor] = []
        """Who waits there."""
        self.begun = False
        """Whether anybody ever has: a thread that has just been started comes there yet."""
        self._stepper = stepper

    def take(self) -> Any:
        """Wait for the next item; None once it is closed."""
        return self._stepper.take(self)

    def close(self) -> None:
        """Let whoever waits there end."""
        self._stepper.close(self)


class Barrier:
    """Where a thread waits for its turn: parked, so that whoever has the turn may wait for the time."""

    def __init__(self, stepper: Stepper) -> None:
        self.open = True
        self.waits: Actor | None = None
        """Who waits there."""
        self._stepper = stepper

    def acquire(self) -> None:
        """Close it; wait there if it is closed."""
        self._stepper.enter(self)

    def release(self) -> None:
        """Let whoever waits there go on."""
        self._stepper.let_in(self)


class _Order:
    """Who runs, who waits, and who is next. All of it is for whoever has the lock."""

    def __init__(self) -> None:
        self.now = 0
        self._lock = threading.Lock()
        self._quiet = threading.Condition(self._lock)
        self._actors: dict[threading.Thread, Actor] = {}
        self._serials = itertools.count()
        self._running: set[Actor] = set()
        self._waiting: set[Actor] = set()
        """Those that wait for a time."""
        self._filled: set[Inbox] = set()  # those with something in them
        self._posted = 0
        """What the loop of async callbacks has been handed and has not begun with."""
        self._holds = 0
        """How many want nobody to start."""
        self._queue: deque[tuple[Inbox, Any]] = deque()
        self._target = 0
        """How far the time may go."""
        self.in_jumps = False
        """Whether whoever waits for a time finds that it is later: as late as the time may go, as by a `/clock`."""
        self._steps = 0

    def _actor(self, thread: threading.Thread, *, strict: bool) -> Actor:
        actor = self._actors.get(thread)
        if actor is None:
            actor = self._actors[thread] = Actor(thread, next(self._serials), self._lock, strict=strict)
        return actor

    def _run(self, actor: Actor) -> None:
        self._steps += 1
        self._running.add(actor)
        actor.watch.begin()

    def _wake(self, actor: Actor) -> None:
        actor.until = None
        self._waiting.discard(actor)
        self._run(actor)
        actor.awake.notify()

    def _park(self, actor: Actor) -> None:
        self._running.discard(actor)
        self._dispatch()

    def _hand_over(self, inbox: Inbox, item: object) -> None:
        if not inbox.closed:
            inbox.items.append(item)
            self._filled.add(inbox)
            if inbox.readers:
                inbox.readers[min(len(inbox.items), len(inbox.readers)) - 1].awake.notify()

    def _dispatch(self) -> None:
        """If nobody runs, let the next one."""
        while not (self._running or self._holds or self._is_handed_over()):
            if self._queue:
                self._hand_over(*self._queue.popleft())
                continue
            actor = self._next_due()
            if actor is None:
                self._quiet.notify_all()
                return
            self.now = max(self.now, self._target if self.in_jumps else actor.until or 0)
            self._wake(actor)

    def _is_handed_over(self) -> bool:
        """Whether somebody is about to take an item; what comes for a thread that waits elsewhere stays where it is."""
        return self._posted > 0 or any(inbox.readers or not inbox.begun for inbox in self._filled)

    def _next_due(self) -> Actor | None:
        due = [actor for actor in self._waiting if actor.until is not None and actor.until <= self._target]
        if len(due) < 2:
            return due[0] if due else None
        return min(due, key=lambda actor: (actor.until or 0, actor.serial))


class Stepper(_Order):
    """Runs one thread at a time. All times are ns since the test began."""

    def __init__(self, patience: float) -> None:
        super().__init__()
        self.patience = patience
        """How long a callback may take, s of the wall clock."""

    # -- for the test ------------------------------------------------------------------------------------------------

    def settle(self, until: int = 0) -> None:
        """Let everything happen that is to happen until a time, and wait for its end.

        Raises:
            Hung: a callback does not come back.
        """
        with self._lock:
            self._target = max(until, self.now)
            self._dispatch()
            self._wait_until_quiet()
            self.now = self._target

    @contextmanager
    def held(self) -> Iterator[None]:
        """Queue what is published below, and start nobody with it."""
        with self._lock:
            self._holds += 1
        try:
            yield
        finally:
            with self._lock:
                self._holds -= 1

    def sleepers(self) -> list[tuple[str, float]]:
        """The threads that wait for a time, and for how long they still do, s."""
        with self._lock:
            return [(actor.thread.name, ((actor.until or 0) - self.now) * 1e-9) for actor in self._waiting]

    def _wait_until_quiet(self) -> None:
        steps, since = -1, 0.0
        self._bury()
        while not self._is_quiet():
            self._quiet.wait(_LOOK)
            self._bury()
            self._let_go()
            if self._steps != steps:
                steps, since = self._steps, time.monotonic()
            elif time.monotonic() - since > self.patience:
                raise Hung(_who_hangs(self._running, self.patience))

    def _is_quiet(self) -> bool:
        return not (self._running or self._queue or self._is_handed_over()) and self._next_due() is None

    def _bury(self) -> None:
        """Wait no longer for threads that have ended."""
        for actor in list(self._running):
            if actor.thread.ident is not None and not actor.thread.is_alive():
                self._running.discard(actor)
                del self._actors[actor.thread]
        self._dispatch()

    def _let_go(self) -> None:
        """Wait no longer for threads that run no callbacks and wait for something else: a port, a queue."""
        for actor in list(self._running):
            if not actor.strict and actor.watch.is_blocked():
                self._running.discard(actor)
        self._dispatch()

    # -- for the threads of nodes ------------------------------------------------------------------------------------

    def expect(self, thread: threading.Thread, *, strict: bool) -> None:
        """Take note of a thread that is about to start: until it waits for something, it runs."""
        with self._lock:
            self._run(self._actor(thread, strict=strict))

    def post(self, inbox: Inbox, item: object) -> None:
        """Queue a message, in the thread that publishes it."""
        with self._lock:
            self._queue.append((inbox, item))
            self._dispatch()

    def call(self) -> Call | None:
        """What the thread that calls this is about to ask; None for a thread that is no node's."""
        with self._lock:
            me = self._actors.get(threading.current_thread())
            if me is None:
                return None
            me.call = Call(me)
            return me.call

    def post_question(self, inbox: Inbox, item: object) -> None:
        """Hand a question over at once, with its call, in the thread that asks: it waits for the answer."""
        with self._lock:
            asker = self._actors.get(threading.current_thread())
            call = None if asker is None else asker.call
            if call is not None:
                call.open += 1
            self._hand_over(inbox, (item, call))

    def answered(self, call: Call | None) -> None:
        """A question is answered: who waits for that goes on before anything else happens."""
        with self._lock:
            if call is not None:
                call.open -= 1
                if call.waits:
                    self._run(call.asker)

    @contextmanager
    def asking(self, call: Call | None) -> Iterator[None]:
        """Let others run while this thread waits for an answer."""
        with self._lock:
            if call is not None and call.open:
                call.waits = True
                self._park(call.asker)
        try:
            yield
        finally:
            with self._lock:
                if call is not None:
                    call.waits = False
                    self._run(call.asker)

    def take(self, inbox: Inbox) -> Any:
        """Park until there is an item. Returns None once the inbox is closed."""
        with self._lock:
            me = self._actor(threading.current_thread(), strict=True)
            inbox.readers.append(me)
            inbox.begun = True
            self._park(me)
            while not inbox.items and not inbox.closed:
                me.awake.wait()
            inbox.readers.remove(me)
            if not inbox.items:
                return None
            self._run(me)
            item = inbox.items.popleft()
            if not inbox.items:
                self._filled.discard(inbox)
            return item

    def hand_to_loop(self) -> None:
        """Something is about to be handed to the loop of async callbacks, in the thread that does so."""
        with self._lock:
            self._posted += 1

    def begin_in_loop(self) -> None:
        """The loop begins with something that it has been handed."""
        with self._lock:
            self._posted -= 1
            self._run(self._actor(threading.current_thread(), strict=True))

    @contextmanager
    def parked(self) -> Iterator[None]:
        """Let others run while this thread waits for something that comes from outside, or that it is handed."""
        with self._lock:
            me = self._actor(threading.current_thread(), strict=True)
            self._park(me)
        try:
            yield
        finally:
            with self._lock:
                self._run(me)

    def enter(self, barrier: Barrier) -> None:
        """Park until a barrier is open, and close it."""
        with self._lock:
            if not barrier.open:
                barrier.waits = me = self._actor(threading.current_thread(), strict=True)
                self._park(me)
                me.awake.wait_for(lambda: barrier.open)
                barrier.waits = None
            barrier.open = False

    def let_in(self, barrier: Barrier) -> None:
        """Open a barrier, in the thread that gives its turn away; who waits there is the next to run."""
        with self._lock:
            barrier.open = True
            if barrier.waits is not None:
                self._run(barrier.waits)
                barrier.waits.awake.notify()

    def close(self, inbox: Inbox) -> None:
        """Take nothing more in, and let whoever waits there end."""
        with self._lock:
            inbox.closed = True
            inbox.items.clear()
            self._filled.discard(inbox)
            for reader in inbox.readers:
                reader.awake.notify()

    def sleep(self, until: int, woken: threading.Event) -> bool:
        """Park until a time. Returns whether `woken` was set and `look` called."""
        with self._lock:
            me = self._actor(threading.current_thread(), strict=False)
            if not woken.is_set():
                me.until, me.woken = until, woken
                self._waiting.add(me)
                self._park(me)
                while me.until is not None:
                    me.awake.wait()
            return woken.is_set()

    def look(self) -> None:
        """Let those that wait for a time look at what may wake them."""
        with self._lock:
            for actor in [one for one in self._waiting if one.woken.is_set()]:
                self._wake(actor)


def _who_hangs(running: Iterable[Actor], patience: float) -> str:
    frames = sys._current_frames()
    told = []
    for actor in sorted(running, key=lambda one: one.serial):
        frame = frames.get(actor.thread.ident or 0)
        stack = [] if frame is None else traceback.format_stack(frame)[-_FRAMES_SHOWN:]
        head = f"the thread {actor.thread.name} has not come back for {patience:g} s; it stands at"
        told.append("\n".join([head, *(line.rstrip() for line in stack)]))
    return "\n".join(told) or f"what was published was not taken within {patience:g} s"
