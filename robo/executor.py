"""Running a node's callbacks: one at a time, one thread hop from the network.

Each subscription has a thread that blocks in Zenoh's own channel and runs the callback right there,
under the node's `Turn`. Nothing that may block is ever handed to Zenoh's network threads, so a slow
callback holds up neither another node's subscription nor the network.

How a channel and `depth` go together (measured in `benchmarks/`): Zenoh delivers a batch of up to a
thousand small messages at once. A ring of ten slots would lose most of a batch although the callback
could keep up, so the ring has room for a batch, and `depth` is enforced here, whenever callbacks have
taken longer than `SLICE`: then all but the newest `depth` are dropped.
"""

import threading
from collections import deque
from collections.abc import Callable
from time import monotonic
from types import TracebackType
from typing import Generic, TypeVar

import msgspec
import zenoh

from robo.codec import Malformed, TopicDecoder
from robo.qos import KEEP_ALL
from robo_messages import Message

M = TypeVar("M", bound=Message)

SLICE = 0.001
"""How long callbacks of one source may follow each other, s, before others get their turn and
messages that have piled up are cut back to the newest `depth`."""

BATCH = 1024
"""Slots of a channel for small messages: what arrives in one network batch, rounded up."""


class Turn:
    """Mutual exclusion that is served in order of arrival.

    `threading.Lock` lets a thread that releases and at once acquires again starve the others for
    seconds; here it hands over.
    """

    def __init__(self) -> None:
        self._guard = threading.Lock()
        self._busy = False
        self._waiting: deque[threading.Lock] = deque()

    def __enter__(self) -> None:
        with self._guard:
            if not self._busy:
                self._busy = True
                return
            gate = threading.Lock()
            gate.acquire()
            self._waiting.append(gate)
        gate.acquire()  # released by the holder before us, who leaves _busy set for us

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._guard:
            if self._waiting:
                self._waiting.popleft().release()
            else:
                self._busy = False

    def give_way(self) -> None:
        """Let those who wait go first; the caller holds the turn before and after."""
        if self._waiting:
            self.__exit__(None, None, None)
            self.__enter__()


class SubscriptionLoop(Generic[M]):
    """Receives one topic and runs its callback."""

    def __init__(
        self,
        subscriber: "zenoh.Subscriber[zenoh.Handler[zenoh.Sample]]",
        decoder: TopicDecoder[M],
        depth: int,
        turn: Turn,
        callback: Callable[[M], None],
        on_malformed: Callable[[str], None],
    ) -> None:
        self._subscriber = subscriber
        # The handler apart from its subscriber: a recv() through the subscriber would block undeclare().
        self._handler = subscriber.handler
        self._decoder = decoder
        self._depth = depth
        self._turn = turn
        self._callback = callback
        self._on_malformed = on_malformed
        self.received = 0
        """Messages given to the callback."""
        self.malformed = 0
        """Payloads that were no message of the topic's type."""
        self.dropped = 0
        """Messages cut away because the callback fell behind by more than `depth`."""
        self._thread = threading.Thread(target=self._run, name=f"robo-{subscriber.key_expr}", daemon=True)

    def start(self) -> None:
        """Begin to call the callback."""
        self._thread.start()

    def stop(self, timeout: float) -> bool:
        """Take no more messages in, finish those that KEEP_ALL promised, and end.

        Returns:
            Whether the callback came back within `timeout` seconds.
        """
        self._subscriber.undeclare()
        if self._thread is threading.current_thread() or not self._thread.ident:
            return True
        self._thread.join(timeout)
        return not self._thread.is_alive()

    def _run(self) -> None:
        recv, try_recv = self._handler.recv, self._handler.try_recv
        turn, deliver, keep_all = self._turn, self._deliver, self._depth == KEEP_ALL
        backlog: deque[zenoh.Sample] = deque(maxlen=None if keep_all else self._depth)
        sample: zenoh.Sample | None
        while True:
            try:
                sample = recv()
            except zenoh.ZError:
                return  # undeclared, and nothing is left in the channel
            with turn:
                until = monotonic() + SLICE
                while sample is not None:
                    deliver(sample)
                    if monotonic() > until:
                        turn.give_way()
                        if not keep_all:
                            self._cut_back(backlog)
                        until = monotonic() + SLICE
                    try:
                        sample = backlog.popleft() if backlog else try_recv()
                    except zenoh.ZError:
                        return

    def _cut_back(self, backlog: deque[zenoh.Sample]) -> None:
        """Move what has piled up into the backlog, which keeps the newest `depth`."""
        try_recv = self._handler.try_recv
        before, taken = len(backlog), 0
        try:
            while (sample := try_recv()) is not None:
                backlog.append(sample)
                taken += 1
        except zenoh.ZError:
            pass  # undeclared meanwhile: what is in the backlog is all there is
        self.dropped += before + taken - len(backlog)

    def _deliver(self, sample: zenoh.Sample) -> None:
        payload = sample.payload.to_bytes()
        try:
            message = self._decoder.fast(payload)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            try:
                message = self._decoder.explain(payload, str(sample.encoding))
            except Malformed as reason:
                self.malformed += 1
                self._on_malformed(str(reason))
                return
        self.received += 1
        self._callback(message)


class TimerLoop:
    """Runs a callback at a steady rate: the schedule does not drift, missed ticks are skipped."""

    def __init__(self, name: str, period: Callable[[], float], turn: Turn, callback: Callable[[], None]) -> None:
        """`period` is asked before each tick, so that a changed parameter counts at once; s."""
        self._period = period
        self._turn = turn
        self._callback = callback
        self._stopped = threading.Event()
        self.missed = 0
        """Ticks that were skipped because callbacks took too long."""
        self._thread = threading.Thread(target=self._run, name=f"robo-timer-{name}", daemon=True)

    def start(self) -> None:
        """Begin; the first tick comes one period from now."""
        self._thread.start()

    def stop(self, timeout: float) -> bool:
        """End. Returns whether the callback came back within `timeout` seconds."""
        self._stopped.set()
        if self._thread is threading.current_thread() or not self._thread.ident:
            return True
        self._thread.join(timeout)
        return not self._thread.is_alive()

    def _run(self) -> None:
        due = monotonic()
        while True:
            period = self._period()
            due += period
            late = monotonic() - due
            if late > period:
                skipped = int(late / period)
                self.missed += skipped
                due += skipped * period
            if self._stopped.wait(max(0.0, due - monotonic())):
                return
            with self._turn:
                if not self._stopped.is_set():
                    self._callback()
