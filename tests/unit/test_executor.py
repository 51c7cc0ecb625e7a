import itertools
import math
import threading
import time
from functools import partial

import pytest

from robo.errors import ContractError
from robo.node.clock import Clock
from robo.node.loops import TimerLoop, checked_period, period_of
from robo.node.topics import slots
from robo.node.turn import Turn
from robo.wire.qos import KEEP_ALL
from robo_messages import Image, LaserScan, Odometry, PointCloud2, Twist
from tests.support import eventually


def test_a_turn_excludes() -> None:
    turn, inside, most = Turn(), 0, 0

    def work() -> None:
        nonlocal inside, most
        for _ in range(2000):
            with turn:
                inside += 1
                most = max(most, inside)
                inside -= 1

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert most == 1
    with turn:  # it is free again
        assert not turn.waiting


def _has_waiting(turn: Turn, count: int) -> bool:
    return len(turn.waiting) == count


def test_a_turn_is_served_in_order() -> None:
    turn, order = Turn(), []

    def work(number: int) -> None:
        with turn:
            order.append(number)

    turn.acquire()
    threads = []
    for number in range(5):
        threads.append(threading.Thread(target=work, args=(number,)))
        threads[-1].start()
        eventually(partial(_has_waiting, turn, number + 1), "the thread waits")
    turn.release()
    for thread in threads:
        thread.join(40)
    assert order == [0, 1, 2, 3, 4]


def test_who_takes_the_turn_again_at_once_starves_nobody() -> None:
    turn, stop, got_it = Turn(), threading.Event(), threading.Event()

    def greedy() -> None:
        while not stop.is_set():
            with turn:
                time.sleep(0.002)  # the callback of a flooded topic

    def modest() -> None:
        with turn:
            got_it.set()

    first, second = threading.Thread(target=greedy), threading.Thread(target=modest)
    first.start()
    second.start()
    assert got_it.wait(40)
    stop.set()
    first.join(40)
    second.join(40)


def test_a_timer_keeps_its_rate_and_survives_what_its_callback_raises() -> None:
    ticks: list[float] = []
    errors: list[BaseException] = []
    enough = threading.Event()

    def tick() -> None:
        ticks.append(time.monotonic())
        if len(ticks) == 20:
            enough.set()
        raise ValueError("oops")

    loop = TimerLoop("t", lambda: 0.005, Turn(), tick, errors.append)
    begin = time.monotonic()
    loop.start()
    assert enough.wait(40)
    assert loop.stop(5)
    assert len(errors) == len(ticks) >= 20
    # Ticks that were missed are skipped, never made up for: 20 ticks cannot take less than 20 periods.
    assert ticks[19] - begin >= 20 * 0.005


def test_a_timer_follows_a_changed_period() -> None:
    period, ticked = 0.001, threading.Semaphore(0)
    loop = TimerLoop("t", lambda: period, Turn(), ticked.release, lambda _: None)
    loop.start()
    assert ticked.acquire(timeout=40)
    period = 60.0
    loop.stop(5)


def test_channels_have_room_that_fits_the_type() -> None:
    assert slots(Twist, 1) == slots(Odometry, 10) == 4096
    assert slots(Twist, 10_000) == 10_000
    assert slots(LaserScan, 1) == 256
    assert slots(Image, 3) == slots(PointCloud2, 3) == 3
    assert slots(Image, KEEP_ALL) == 16


@pytest.mark.parametrize("period", [0, -1.0, math.nan, math.inf, 1e300, 1e-300, "1"])
def test_periods_that_cannot_be_waited_for_are_refused(period: float) -> None:
    with pytest.raises(ContractError, match="use 1e-06 to 1e\\+09 s"):
        checked_period(period)
    with pytest.raises(ContractError, match="use 1e-09 to 1e\\+06 Hz"):
        period_of(period)


def test_a_thread_that_dies_is_told_and_leaves_the_turn_to_others() -> None:
    died: list[BaseException] = []
    told = threading.Event()

    def on_death(error: BaseException) -> None:
        died.append(error)
        told.set()

    def on_error(error: BaseException) -> None:
        raise error

    def fail() -> None:
        raise ZeroDivisionError

    turn = Turn(on_death)
    loop = TimerLoop("t", lambda: 0.001, turn, fail, on_error)
    loop.start()
    assert told.wait(40)
    assert isinstance(died[0], ZeroDivisionError)
    assert turn.try_acquire(False)


def test_no_wait_is_too_long_for_a_clock() -> None:
    woken = threading.Event()
    woken.set()
    assert Clock().wait(woken, math.inf, 0)


def test_a_publishers_counter_can_be_read_without_counting() -> None:
    # TopicPublisher.published reads the next number out of what Python writes of a counter.
    numbers = itertools.count(1)
    assert [next(numbers) for _ in range(3)] == [1, 2, 3]
    assert repr(numbers) == "count(4)"
