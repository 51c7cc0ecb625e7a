"""Timers by a clock that somebody else moves."""

import threading

from robo.node.clock import Clock, SimClock
from robo.node.loops import TimerLoop
from robo.node.turn import Turn
from tests.support import eventually

MILLISECOND = 1_000_000


class Ticks:
    def __init__(self, clock: Clock, period: float) -> None:
        self.period = period
        self.times: list[float] = []
        self._came = threading.Condition()
        self.loop = TimerLoop("test", lambda: self.period, Turn(), self._tick, self._fail, clock)
        self._clock = clock
        self.loop.start()

    def _fail(self, error: BaseException) -> None:
        raise error

    def _tick(self) -> None:
        with self._came:
            self.times.append(round(self._clock.monotonic(), 3))
            self._came.notify_all()

    def comes(self, count: int, timeout: float) -> bool:
        with self._came:
            return self._came.wait_for(lambda: len(self.times) >= count, timeout)

    def wait_for(self, count: int) -> list[float]:
        assert self.comes(count, 10), self.times
        return self.times


def test_simulated_time_moves_only_when_it_is_told() -> None:
    clock = SimClock()
    assert clock.now().to_nanoseconds() == 0
    clock.advance(1_500 * MILLISECOND)
    assert clock.monotonic() == 1.5
    assert clock.now().to_nanoseconds() == 1_500 * MILLISECOND
    woken = threading.Event()
    assert not clock.wait(woken, 1.5, clock.jumps)
    woken.set()
    assert clock.wait(woken, 99.0, clock.jumps)


def test_a_step_back_before_the_wait_ends_it() -> None:
    clock = SimClock()
    clock.advance(100_000 * MILLISECOND)
    jumps = clock.jumps
    clock.advance(1_000 * MILLISECOND)
    assert clock.wait(threading.Event(), 100.1, jumps)


def test_a_step_back_while_a_timer_runs_is_seen() -> None:
    clock = SimClock()
    stepped, times, errors = threading.Event(), list[float](), list[BaseException]()

    def tick() -> None:
        times.append(round(clock.monotonic(), 3))
        if not stepped.is_set():
            clock.advance(1_000 * MILLISECOND)
            stepped.set()

    loop = TimerLoop("test", lambda: 0.1, Turn(), tick, errors.append, clock)
    clock.advance(100_000 * MILLISECOND)
    loop.start()
    clock.advance(100_200 * MILLISECOND)
    assert stepped.wait(10)

    def ticks_again() -> bool:
        clock.advance(clock.now().to_nanoseconds() + 10 * MILLISECOND)
        return len(times) > 1

    eventually(ticks_again, "it ticks again")
    assert not errors
    assert times[1] < 99
    assert loop.stop(5.0)


def test_timers_follow_simulated_time_and_its_steps_back() -> None:
    clock = SimClock()
    ticks = Ticks(clock, 0.1)
    for i in range(1, 6):
        clock.advance(i * 100 * MILLISECOND)
        ticks.wait_for(i)
    assert ticks.times == [0.1, 0.2, 0.3, 0.4, 0.5]
    for milliseconds in range(10, 450, 10):  # played again
        clock.advance(milliseconds * MILLISECOND)
        if ticks.comes(6, timeout=0.02):
            break
    assert ticks.times[5] < 0.5
    assert ticks.loop.missed == 0
    assert ticks.loop.stop(5.0)


def test_a_late_first_time_is_no_missed_tick() -> None:
    clock = SimClock()
    ticks = Ticks(clock, 0.1)
    clock.advance(1_700_000_000 * 1000 * MILLISECOND)
    ticks.wait_for(1)
    assert ticks.loop.missed == 0
    assert ticks.loop.stop(5.0)


def test_a_new_period_counts_from_the_last_tick() -> None:
    clock = SimClock()
    ticks = Ticks(clock, 1.0)
    clock.advance(1000 * MILLISECOND)
    ticks.wait_for(1)
    ticks.period = 0.2
    ticks.loop.reschedule()
    clock.advance(1200 * MILLISECOND)
    assert ticks.wait_for(2)[1] == 1.2
    ticks.period = 100.0
    ticks.loop.reschedule()
    assert ticks.loop.stop(5.0)


def test_the_wall_clock_wakes_when_asked() -> None:
    ticks = Ticks(Clock(), 1000.0)
    ticks.period = 0.001
    ticks.loop.reschedule()
    assert len(ticks.wait_for(3)) >= 3
    assert ticks.loop.stop(5.0)
