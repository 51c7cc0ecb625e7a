"""The live ends of a node: begun, counted and ended as one, without a network."""

import random
import threading
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo.node.endpoints import Endpoints
from tests.support import PATIENCE


class Record:
    """What was done to all ends of a test, in order, and a time that stopping takes."""

    def __init__(self) -> None:
        self.done: list[str] = []
        self.time = 100.0

    def now(self) -> float:
        return self.time


class Loop:
    """A timer, a subscription or a service."""

    def __init__(self, record: Record, name: str, takes: float = 0.0) -> None:
        self.name = name
        self.granted: list[float] = []
        self._record = record
        self._takes = takes

    def start(self) -> None:
        self._record.done.append(f"start {self.name}")

    def stop(self, timeout: float) -> bool:
        self._record.done.append(f"stop {self.name}")
        self._record.time += min(self._takes, timeout)
        self.granted.append(round(timeout, 6))
        return self._takes <= timeout


class Talker:
    """A publisher, or a client."""

    def __init__(self, record: Record, name: str, error: Exception | None = None) -> None:
        self._record = record
        self._name = name
        self._error = error

    def undeclare(self) -> None:
        self._record.done.append(f"undeclare {self._name}")
        if self._error is not None:
            raise self._error

    def close(self) -> None:
        self._record.done.append(f"close {self._name}")

    def abandon(self) -> None:
        self._record.done.append(f"abandon {self._name}")


@pytest.fixture
def record() -> Record:
    return Record()


def end(what: Any) -> Any:
    """A stand-in for a live end, whose type needs a network."""
    return what


def test_callbacks_begin_together_and_publishers_need_no_beginning(record: Record) -> None:
    ends = Endpoints()
    ends.add_timer(end(Loop(record, "tick")))
    ends.add_subscription(end(Loop(record, "odom")))
    ends.add_service(end(Loop(record, "reset")))
    ends.add_publisher(end(Talker(record, "out")))
    assert record.done == [], "nothing runs before the node does"
    ends.begin()
    assert record.done == ["start odom", "start tick"]


def test_what_comes_while_the_node_runs_begins_at_once(record: Record) -> None:
    ends = Endpoints()
    ends.begin()
    ends.add_subscription(end(Loop(record, "odom")))
    ends.add_timer(end(Loop(record, "tick")))
    assert record.done == ["start odom", "start tick"]


def test_what_comes_when_the_node_has_stopped_does_not_begin(record: Record) -> None:
    ends = Endpoints()
    ends.begin()
    assert ends.stop(record.time, record.now)
    ends.add_timer(end(Loop(record, "late")))
    assert record.done == []


def test_an_end_that_comes_in_the_midst_of_the_beginning_begins_once(record: Record) -> None:
    ends = Endpoints()

    class Adding(Loop):
        def start(self) -> None:
            super().start()
            ends.add_timer(end(Loop(record, "added")))  # as a callback does that runs already

    ends.add_subscription(end(Adding(record, "odom")))
    ends.add_subscription(end(Loop(record, "scan")))
    ends.begin()
    assert record.done == ["start odom", "start added", "start scan"]


def test_threads_that_add_ends_while_others_begin_lose_none_and_start_none_twice(record: Record) -> None:
    ends = Endpoints()
    gate = threading.Barrier(5)

    def add(number: int) -> None:
        gate.wait(PATIENCE)
        for one in range(50):
            ends.add_timer(end(Loop(record, f"{number}.{one}")))

    threads = [threading.Thread(target=add, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    gate.wait(PATIENCE)
    ends.begin()
    for thread in threads:
        thread.join(PATIENCE)
    assert sorted(record.done) == sorted(f"start {number}.{one}" for number in range(4) for one in range(50))


def test_a_stop_has_one_deadline_and_tells_everybody(record: Record) -> None:
    ends = Endpoints()
    slow, quick, late = Loop(record, "slow", 0.7), Loop(record, "quick"), Loop(record, "late", 0.7)
    ends.add_timer(end(slow))
    ends.add_subscription(end(quick))
    ends.add_service(end(late))
    other = Loop(record, "parameters", 0.5)
    ends.add_other(other)
    ends.begin()
    record.done.clear()
    assert not ends.stop(record.time + 1.0, record.now)
    assert record.done == ["stop slow", "stop quick", "stop late", "stop parameters"]
    assert [loop.granted for loop in (slow, quick, late, other)] == [[1.0], [0.3], [0.3], [0.0]]


def test_calls_that_wait_for_a_server_fail_before_anybody_is_waited_for(record: Record) -> None:
    ends = Endpoints()
    ends.add_client(end(Talker(record, "double")))
    ends.add_service(end(Loop(record, "served")))
    assert ends.stop(record.time, record.now)
    assert record.done == ["abandon double", "stop served"]


@given(st.lists(st.floats(0.0, 2.0), max_size=6), st.floats(0.0, 3.0))
def test_no_mixture_of_callbacks_takes_longer_than_is_granted(takes: list[float], granted: float) -> None:
    record, ends, choose = Record(), Endpoints(), random.Random(0)
    for number, time in enumerate(takes):
        add: Any = choose.choice([ends.add_timer, ends.add_subscription, ends.add_service, ends.add_other])
        add(end(Loop(record, str(number), time)))
    begun = record.time
    all_returned = ends.stop(begun + granted, record.now)
    assert record.time - begun <= granted + 1e-6
    assert len(record.done) == len(takes)
    if sum(takes) < granted - 1e-6:
        assert all_returned
    if any(time > granted for time in takes):
        assert not all_returned


def test_each_is_taken_off_the_network_though_one_fails(record: Record) -> None:
    ends = Endpoints()
    for name in ("first", "second", "third"):
        error = OSError("the network is gone") if name == "second" else None
        ends.add_publisher(end(Talker(record, name, error)))
    ends.add_client(end(Talker(record, "client")))
    with pytest.raises(OSError, match="gone"):
        ends.withdraw()
    assert sorted(record.done) == ["close client", "undeclare first", "undeclare second", "undeclare third"]


def test_a_timer_that_is_dropped_is_stopped_once_and_not_waited_for(record: Record) -> None:
    ends = Endpoints()
    timer = Loop(record, "ready", takes=1.0)
    ends.add_timer(end(timer))
    ends.begin()
    ends.drop(end(timer))
    assert (timer.granted, ends.timers) == ([0.0], [])
    assert ends.stop(record.time, record.now)
    assert record.done == ["start ready", "stop ready"]
