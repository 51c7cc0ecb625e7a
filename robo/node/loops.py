"""Running a node's callbacks: one at a time, one thread hop from the network.

Each subscription has a thread that blocks in Zenoh's own channel and runs the callback right there,
under the node's `Turn`. Nothing that may block is ever handed to Zenoh's network threads, so a slow
callback holds up neither another node's subscription nor the network.

How a channel and `depth` go together (measured in `benchmarks/`): Zenoh delivers a batch of up to a
thousand small messages at once. A ring of ten slots would lose most of a batch although the callback
could keep up, so the ring has room for several (see `topics.slots`), and `depth` is enforced here:
where what has piled up would take a callback longer than `STALE`, it goes on with the newest `depth`.
"""

import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from time import monotonic
from types import CoroutineType
from typing import Generic, TypeVar

import zenoh

from robo.errors import ContractError
from robo.node.clock import Clock
from robo.node.message_info import MessageInfo
from robo.node.turn import Turn, enter, name_of
from robo.text.unreadable import UNREADABLE
from robo.wire.codec import Decoder, Malformed
from robo.wire.qos import KEEP_ALL
from robo_messages import Message

M = TypeVar("M", bound=Message)

STALE = 0.02
"""How long a message may wait behind others that nobody asked to keep, s."""


SHORTEST_PERIOD = 1e-6
LONGEST_PERIOD = 1e9
"""The periods of timers, s. Shorter ones would be nothing but work, longer ones than 30 years overflow waits."""


def checked_period(period: float) -> float:
    """A timer's period, s, if it can be waited for.

    Raises:
        ContractError: it is not within SHORTEST_PERIOD and LONGEST_PERIOD, or no number.
    """
    if isinstance(period, (int, float)) and SHORTEST_PERIOD <= period <= LONGEST_PERIOD:
        return period
    raise ContractError(f"a timer's period of {period!r} s: use {SHORTEST_PERIOD:g} to {LONGEST_PERIOD:g} s")


def period_of(rate: float) -> float:
    """The period of a timer, s, from its rate, Hz.

    Raises:
        ContractError: it is not within the same limits, or no number.
    """
    if isinstance(rate, (int, float)) and 1 / LONGEST_PERIOD <= rate <= 1 / SHORTEST_PERIOD:
        return 1.0 / rate
    raise ContractError(f"a timer's rate of {rate!r} Hz: use {1 / LONGEST_PERIOD:g} to {1 / SHORTEST_PERIOD:g} Hz")


def check_outcome(outcome: object) -> None:
    """Refuse what a callback that is not async has returned where that is a coroutine: nobody would await it.

    Raises:
        ContractError: it is one.
    """
    if isinstance(outcome, CoroutineType):
        outcome.close()
        raise ContractError("the callback returned a coroutine, which nobody awaits; make it an `async def` that does")


class SubscriptionLoop(Generic[M]):
    """Receives one topic and runs its callback."""

    def __init__(
        self,
        subscriber: "zenoh.Subscriber[zenoh.Handler[zenoh.Sample]]",
        decoder: Decoder[M],
        depth: int,
        turn: Turn,
        callback: Callable[..., object],
        on_error: Callable[[BaseException], None],
        on_malformed: Callable[[str, zenoh.Sample], None],
        examine: Callable[[zenoh.Sample], MessageInfo | None] | None = None,
        *,
        may_be_shared: bool = False,
    ) -> None:
        """`examine` makes the callback's second argument of a sample, or None of one that does not count.

        `may_be_shared` says that messages may come through shared memory.
        """
        self._subscriber = subscriber
        # The handler apart from its subscriber: a recv() through the subscriber would block undeclare().
        self._handler = subscriber.handler
        self._decoder = decoder
        self._depth = depth
        self._turn = turn
        self._callback = callback
        self._on_error = on_error
        self._on_malformed = on_malformed
        self._examine = examine
        self._is_torn: Callable[[zenoh.ZBytes], bool] | None = None
        if may_be_shared:
            from robo.wire.shared_buffers import is_torn  # nodes carry it only if they need it

            self._is_torn = is_torn
        self._about: tuple[MessageInfo, ...] = ()
        self._name = name_of(callback)
        self._backlog: deque[zenoh.Sample] = deque()
        self.received = 0
        """Messages given to the callback."""
        self.malformed = 0
        """Payloads that were no message of the topic's type."""
        self.dropped = 0
        """Messages cut away because the callback fell behind by more than `depth`."""
        self._thread = threading.Thread(target=turn.guarded(self._run), name=f"robo-{subscriber.key_expr}", daemon=True)

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
        enter(self._turn)
        with suppress(zenoh.ZError):  # undeclared, and nothing is left in the channel
            self._receive()

    def _receive(self) -> None:
        # Every message takes this path, so what it needs is in local variables.
        recv, try_recv = self._handler.recv, self._handler.try_recv
        decode, callback = self._decoder.fast, self._callback
        examined = self._examined if self._examine is not None or self._is_torn is not None else None
        turn, backlog, keep_all = self._turn, self._backlog, self._depth == KEEP_ALL
        take_turn, wait_turn, pass_turn, others = turn.try_acquire, turn.wait, turn.release, turn.waiting
        name = self._name
        holding = False
        try:
            while True:
                sample = recv()
                if not take_turn(False):
                    wait_turn()
                holding = True
                turn.running = name
                since = begun = turn.since = monotonic()
                handled = 0
                while True:
                    handled += 1
                    try:
                        if examined is None:
                            if (outcome := callback(decode(sample.payload.to_bytes()))) is not None:
                                check_outcome(outcome)
                            self.received += 1
                        else:
                            self.received += examined(sample)
                    except BaseException as error:  # whatever it is, it must not end this thread
                        self._handle(error, sample)
                    if others:
                        turn.ended(begun)
                        pass_turn()
                        wait_turn()
                        turn.running = name
                        begun = turn.since = monotonic()
                    more = backlog.popleft() if backlog else try_recv()
                    if more is None:
                        break
                    sample = more
                    if keep_all:
                        if not handled & 15:  # of quick ones nobody needs to know more exactly
                            turn.since = monotonic()
                        continue
                    turn.since = now = monotonic()
                    if (passed := now - since) > STALE:
                        backlog.appendleft(sample)
                        self._cut_back(passed / handled)
                        sample = backlog.popleft()
                        since, handled = since + passed, 0
                turn.ended(begun)
                pass_turn()
                holding = False
        finally:
            if holding:
                turn.running = ""
                pass_turn()

    def _examined(self, sample: zenoh.Sample) -> bool:
        """Give the callback a message and what is known of it. Returns whether the message counts."""
        if self._examine is not None:
            info = self._examine(sample)
            if info is None:
                return False
            self._about = (info,)
        payload = sample.payload.to_bytes()
        if self._is_torn is not None and self._is_torn(sample.payload):
            self.dropped += 1  # this process was stopped for so long that its memory went to others
            return False
        check_outcome(self._callback(self._decoder.fast(payload), *self._about))
        return True

    def _cut_back(self, per_message: float) -> None:
        """Keep the newest `depth` of what has piled up if the last of it would wait for more than STALE."""
        try_recv, backlog = self._handler.try_recv, self._backlog
        with suppress(zenoh.ZError):  # undeclared meanwhile: what is in the backlog is all there is
            while (sample := try_recv()) is not None:
                backlog.append(sample)
        if len(backlog) * per_message > STALE:
            while len(backlog) > self._depth:
                backlog.popleft()
                self.dropped += 1

    def _handle(self, error: BaseException, sample: zenoh.Sample) -> None:
        """Tell a payload that is not MessagePack of this type from a callback that raised."""
        # A msgspec error may also come out of the callback: only this frame's decoding is meant.
        payload = sample.payload.to_bytes()
        try:
            self._decoder.fast(payload)
        except UNREADABLE:
            self._second_try(payload, sample)
        else:
            self.received += 1
            self._on_error(error)

    def _second_try(self, payload: bytes, sample: zenoh.Sample) -> None:
        try:
            message = self._decoder.decode_other(payload, str(sample.encoding))
        except Malformed as reason:
            self.malformed += 1
            self._on_malformed(str(reason), sample)
            return
        self.received += 1
        try:
            check_outcome(self._callback(message, *self._about))
        except BaseException as error:
            self._on_error(error)


class TimerLoop:
    """Runs a callback at a steady rate: the schedule does not drift, missed ticks are skipped."""

    def __init__(
        self,
        name: str,
        period: Callable[[], float],
        turn: Turn,
        callback: Callable[[], object],
        on_error: Callable[[BaseException], None],
        clock: Clock | None = None,
    ) -> None:
        """`period` is asked before each tick, so that a changed parameter counts at once; s, by `clock`."""
        self.name = name
        """Its callback's."""
        self._clock = clock or Clock()
        self.period: Callable[[], float] = lambda: checked_period(period())
        """What is asked before each tick; raises ContractError for what cannot be waited for."""
        self._turn = turn
        self._callback = callback
        self._on_error = on_error
        self._stopped = False
        self._woken = threading.Event()
        self.missed = 0
        """Ticks that were skipped because callbacks took too long."""
        self._thread = threading.Thread(target=turn.guarded(self._run), name=f"robo-timer-{name}", daemon=True)

    def start(self) -> None:
        """Begin; the first tick comes one period from now."""
        self._clock.expect(self._thread)
        self._thread.start()

    def reschedule(self) -> None:
        """Ask for the period again: the next tick comes one new period after the last one."""
        self._woken.set()
        self._clock.wake()

    def stop(self, timeout: float) -> bool:
        """End. Returns whether the callback came back within `timeout` seconds."""
        self._stopped = True
        self.reschedule()
        if self._thread is threading.current_thread() or not self._thread.ident:
            return True
        self._thread.join(timeout)
        return not self._thread.is_alive()

    def _run(self) -> None:
        turn = self._turn
        enter(turn)
        clock, now = self._clock, self._clock.monotonic
        jumps = clock.jumps
        due = now()
        while True:
            last, period = due, self.period()
            due += period
            late = now() - due
            if late > period and jumps == clock.jumps:
                skipped = int(late / period)
                self.missed += skipped
                due += skipped * period
            while clock.wait(self._woken, due, jumps):
                if self._stopped:
                    return
                self._woken.clear()
                jumps = clock.jumps
                last = min(last, now())  # simulated time may step back
                due = max(last + self.period(), now())
            with turn:
                if self._stopped:
                    return
                turn.running, turn.since = self.name, monotonic()
                begun = turn.since
                try:
                    check_outcome(self._callback())
                except BaseException as error:
                    self._on_error(error)
                turn.ended(begun)
