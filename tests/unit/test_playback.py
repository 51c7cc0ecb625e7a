"""Playing by a clock that the test sets: what is said, when, and in which order, whatever somebody does meanwhile."""

import math
from collections.abc import Iterator, Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo.errors import UsageError
from robo.recording.play.playback import Item, Over, Playback, Say, Wait
from robo.recording.play.timeline import Timeline

MS = 1_000_000
START = 1_700_000_000_000_000_000


class Tape:
    """Messages that are their own numbers; `latched` are the numbers of those that are said again."""

    def __init__(self, times: Sequence[int], latched: Sequence[int] = ()) -> None:
        self.times = [START + time for time in times]
        self.latched = set(latched)
        self.begin, self.end = min(self.times), max(self.times)

    def run(self, at: int) -> Iterator[Item[int]]:
        every = sorted(range(len(self.times)), key=self.times.__getitem__)
        last = [number for number in every if number in self.latched and self.times[number] < at][-1:]
        for number in last:
            yield Item(at, True, number)
        for number in every:
            if self.times[number] >= at:
                yield Item(self.times[number], False, number)


class Machine:
    """Plays with a clock that goes on as far as is waited for."""

    def __init__(self, tape: Tape, rate: float = 1.0, *, paused: bool = False, loop: bool = False) -> None:
        self.now = 5_000_000_000
        self.begun = self.now
        self.tape = tape
        self.playback = Playback(tape, self.now, rate=rate, paused=paused, loop=loop)
        self.said: list[tuple[int, int]] = []
        """What, and when: ns since it began."""
        self.jumps: list[int] = []
        """Before which of what was said."""

    def play(self, until: int | None = None) -> bool:
        """Go on, until nothing is left to be done by itself, or until a time. Returns whether it is over."""
        end = self.begun + until if until is not None else 2**80
        while True:
            done = self.playback.next(self.now)
            if isinstance(done, Over):
                return True
            if isinstance(done, Say):
                if done.jumped:
                    self.jumps.append(len(self.said))
                self.said.append((done.item.what, self.now - self.begun))
                continue
            assert isinstance(done, Wait)
            if done.until is None or done.until > end:
                self.now = self.now if done.until is None and until is None else max(self.now, min(end, 2**79))
                return False
            self.now = done.until

    @property
    def order(self) -> list[int]:
        return [what for what, _ in self.said]


def test_messages_are_said_when_they_came() -> None:
    machine = Machine(Tape([0, 10 * MS, 10 * MS, 35 * MS]))
    assert machine.play()
    assert machine.said == [(0, 0), (1, 10 * MS), (2, 10 * MS), (3, 35 * MS)]


@pytest.mark.parametrize(("rate", "whole"), [(2.0, 50 * MS), (0.5, 200 * MS), (0.0, 0)])
def test_a_rate_makes_it_quicker_or_slower(rate: float, whole: int) -> None:
    machine = Machine(Tape([0, 40 * MS, 100 * MS]), rate)
    assert machine.play()
    assert machine.said[-1] == (2, whole)


@pytest.mark.parametrize("rate", [-1.0, math.nan, math.inf, 1e7, 1e-7, 1e-320])
def test_a_rate_that_is_none_is_refused(rate: float) -> None:
    with pytest.raises(UsageError, match=r"use 1 for as recorded, .*; else 1e-06 to 1e\+06"):
        Timeline(START, 0, rate)
    machine = Machine(Tape([0, 10 * MS]))
    with pytest.raises(UsageError):
        machine.playback.change_rate(rate, machine.now)
    assert machine.play()


def test_it_stands_as_long_as_somebody_wants() -> None:
    machine = Machine(Tape([0, 10 * MS, 20 * MS]))
    assert not machine.play(until=5 * MS)
    machine.playback.pause(machine.now)
    assert not machine.play(until=1000 * MS)
    assert machine.playback.position(machine.now) == START + 5 * MS
    machine.playback.resume(machine.now)
    assert machine.play()
    assert machine.said == [(0, 0), (1, 1005 * MS), (2, 1015 * MS)]


def test_one_message_after_the_other_while_it_stands() -> None:
    machine = Machine(Tape([0, 10 * MS, 20 * MS]), paused=True)
    assert not machine.play()
    assert machine.order == []
    assert machine.playback.step()
    assert not machine.play()
    assert machine.order == [0]
    assert machine.playback.step(2)
    assert not machine.play()
    assert machine.order == [0, 1, 2]
    assert machine.playback.position(machine.now) == START + 20 * MS
    assert not machine.playback.step(), "it is at its end, where somebody may jump back"
    machine.playback.seek(START + 10 * MS, machine.now)
    assert machine.playback.step()
    assert not machine.play()
    assert machine.order == [0, 1, 2, 1]
    machine.playback.resume(machine.now)
    assert machine.play()
    assert not machine.playback.step(), "it does not stand"


def test_after_a_jump_what_is_latched_comes_first_though_it_stands() -> None:
    machine = Machine(Tape([0, 10 * MS, 20 * MS, 30 * MS], latched=[1]), paused=True)
    assert machine.playback.seek(START + 25 * MS, machine.now) == START + 25 * MS
    assert not machine.play()
    assert machine.order == [1]
    machine.playback.seek(START + 5 * MS, machine.now)
    assert not machine.play()
    assert machine.order == [1], "it had said nothing at that time"
    machine.playback.resume(machine.now)
    assert machine.play()
    assert machine.order == [1, 1, 2, 3]
    assert machine.jumps == [0, 1]


@pytest.mark.parametrize(("to", "there"), [(-5, 0), (99 * MS, 20 * MS)])
def test_nobody_jumps_out_of_it(to: int, there: int) -> None:
    machine = Machine(Tape([0, 10 * MS, 20 * MS]))
    assert machine.playback.seek(START + to, machine.now) == START + there


def test_it_begins_again_at_its_end() -> None:
    machine = Machine(Tape([0, 10 * MS], latched=[0]), loop=True)
    assert not machine.play(until=35 * MS)
    assert machine.said == [(0, 0), (1, 10 * MS), (0, 10 * MS), (1, 20 * MS), (0, 20 * MS), (1, 30 * MS), (0, 30 * MS)]
    assert machine.jumps == [0, 2, 4, 6]


def test_steps_go_on_from_the_beginning_where_it_begins_again() -> None:
    machine = Machine(Tape([0, 10 * MS], latched=[0]), paused=True, loop=True)
    for count in range(1, 6):
        assert machine.playback.step()
        assert not machine.play()
        assert len(machine.said) == count
    assert machine.order == [0, 1, 0, 1, 0]


def test_nobody_waits_for_a_message_that_comes_after_days() -> None:
    machine = Machine(Tape([0, 10 * MS, 10**18, 10**18 + 5 * MS]))
    machine.play(until=20 * MS)
    assert machine.playback.next_time == START + 10**18
    assert machine.playback.hurry(machine.now) == START + 10**18
    assert machine.play()
    assert machine.said[2:] == [(2, 20 * MS), (3, 25 * MS)]
    assert machine.playback.hurry(machine.now) == machine.tape.end, "there is none after the last"


def test_while_it_stands_nothing_is_said_by_going_to_the_next_message() -> None:
    machine = Machine(Tape([0, 10 * MS]), paused=True)
    machine.playback.step()
    assert not machine.play()
    assert machine.playback.hurry(machine.now) == START + 10 * MS
    assert not machine.play()
    assert machine.order == [0]


def test_who_asks_while_the_next_message_is_looked_for_has_an_answer() -> None:
    machine = Machine(Tape([0, 10 * MS, 20 * MS]))
    machine.play(until=10 * MS)
    playback = machine.playback
    playback.seek(START + 15 * MS, machine.now)
    coming = playback.coming
    assert coming is not None
    later = machine.now + 60_000 * MS
    assert playback.position(later) == START + 15 * MS
    assert playback.next_time is None
    playback.pause(later)
    playback.resume(later)
    playback.seek(START, later)
    playback.take(coming, next(coming))
    assert playback.coming not in (None, coming), "what was looked for before is of no use"
    assert playback.position(later) == START
    machine.now = later
    assert machine.play()
    assert machine.order == [0, 1, 0, 1, 2]


def test_what_has_no_message_begins_again_never() -> None:
    tape = Tape([0, 10 * MS])
    machine = Machine(tape, loop=True)
    tape.times = []
    assert machine.play()


def test_whoever_stood_still_goes_on_where_it_was() -> None:
    machine = Machine(Tape([0, 10 * MS, 20 * MS]))
    machine.play(until=5 * MS)
    machine.now += 60_000 * MS
    machine.playback.put_off(60_000 * MS)
    machine.play()
    assert machine.said[1:] == [(1, 60_010 * MS), (2, 60_020 * MS)]


def test_whoever_is_late_says_all_of_it() -> None:
    machine = Machine(Tape([0, 10 * MS, 20 * MS, 30 * MS]))
    machine.play(until=5 * MS)
    machine.now += 20 * MS
    assert machine.playback.position(machine.now) == START + 10 * MS, "what has not been said is still to come"
    machine.playback.pause(machine.now)
    machine.playback.resume(machine.now)
    machine.play()
    assert machine.order == [0, 1, 2, 3]
    assert machine.said[1][1] == 25 * MS


def test_nothing_adds_up_to_a_drift() -> None:
    times = [number * 3_333_333 for number in range(10_000)]
    machine = Machine(Tape(times), 0.7)
    machine.play()
    assert max(abs(at - time / 0.7) for (_, at), time in zip(machine.said, times, strict=True)) <= 2


actions = st.lists(
    st.tuples(
        st.sampled_from(["pause", "resume", "rate", "wait", "late", "put_off", "step"]),
        st.integers(0, 300 * MS),
        st.sampled_from([0.0, 0.1, 0.5, 1.0, 3.0, 1000.0]),
    ),
    max_size=12,
)
times = st.lists(st.integers(0, 1000 * MS), min_size=1, max_size=30)


@given(times, actions)
def test_whatever_is_done_all_is_said_once_in_order_and_never_too_soon(
    times: list[int], actions: list[tuple[str, int, float]]
) -> None:
    tape = Tape(times)
    machine = Machine(tape)
    playback = machine.playback
    last = playback.position(machine.now)
    for what, by, rate in actions:
        if what == "pause":
            playback.pause(machine.now)
        elif what == "resume":
            playback.resume(machine.now)
        elif what == "rate":
            playback.change_rate(rate, machine.now)
        elif what == "put_off":
            machine.now += by
            playback.put_off(by)
        elif what == "late":
            machine.now += by
        elif what == "step":
            playback.step()
        before = len(machine.said)
        over = machine.play(until=machine.now - machine.begun + by)
        at = playback.position(machine.now)
        assert at >= last, "time does not go back by itself"
        last = at
        if playback.paused:
            assert len(machine.said) - before <= 1, "while it stands a step alone says anything"
        if over:
            break
    playback.change_rate(1.0, machine.now)
    playback.resume(machine.now)
    assert machine.play()
    assert machine.order == sorted(range(len(times)), key=times.__getitem__)


@given(
    times, st.lists(st.tuples(st.integers(-100 * MS, 1100 * MS), st.integers(0, 500 * MS)), max_size=6), st.booleans()
)
def test_after_a_jump_all_from_there_on_is_said(times: list[int], jumps: list[tuple[int, int]], paused: bool) -> None:
    tape = Tape(times, latched=range(0, len(times), 3))
    machine = Machine(tape, paused=paused)
    at = tape.begin
    for to, wait in jumps:
        machine.play(until=machine.now - machine.begun + wait)
        at = machine.playback.seek(START + to, machine.now)
        machine.said.clear()
    machine.playback.resume(machine.now)
    assert machine.play()
    assert machine.order == [item.what for item in tape.run(at)]
