"""Who drives, and when the robot is told to stand."""

import math

import pytest

from robo.dashboard.lease import LEASE, SILENCE, ZEROS, Beats, Lease


def zeros(lease: Lease, begin: float, end: float) -> int:
    """How often the robot is told to stand, asked twenty times a second."""
    steps = round((end - begin) * 20)
    return sum(lease.is_to_stand(begin + step / 20) for step in range(steps))


def test_one_drives_until_it_gives_the_lease_back() -> None:
    lease = Lease()
    assert lease.take("a", 0.0)
    assert not lease.take("b", 0.5)
    assert not lease.command("b", 0.5)
    lease.give("b")
    assert lease.driver == "a", "who does not have it cannot give it"
    lease.give("a")
    assert lease.take("b", 0.6)


def test_who_says_nothing_loses_it() -> None:
    lease = Lease()
    assert lease.command("a", 0.0)
    assert not lease.take("b", LEASE - 0.01)
    assert lease.take("b", LEASE + 0.01)


def test_the_robot_is_told_to_stand_several_times_when_commands_cease() -> None:
    lease = Lease()
    assert lease.command("a", 0.0)
    assert zeros(lease, 0.0, SILENCE) == 0
    assert zeros(lease, SILENCE + 0.01, 5.0) == ZEROS
    assert lease.command("a", 5.0)
    lease.give("a")
    assert zeros(lease, 5.0, 10.0) == ZEROS


def test_zeros_come_one_after_another_however_often_it_is_asked() -> None:
    lease = Lease()
    assert lease.command("a", 0.0)
    lease.give("a")
    assert sum(lease.is_to_stand(step / 1000) for step in range(20)) == 1
    assert not lease.is_idle
    assert zeros(lease, 0.05, 1.0) == ZEROS - 1
    assert lease.is_idle


def test_it_ends_unasked_and_by_silence() -> None:
    lease = Lease()
    assert lease.command("a", 0.0)
    assert not lease.expire(LEASE - 0.01)
    assert lease.end() == "a"
    assert lease.end() is None
    assert lease.command("b", 1.0)
    assert lease.expire(1.0 + LEASE)
    assert lease.driver is None


def test_a_robot_that_nobody_has_moved_is_told_nothing() -> None:
    lease = Lease()
    assert lease.take("a", 0.0)
    lease.give("a")
    assert zeros(lease, 0.0, 5.0) == 0


def test_a_command_ends_the_zeros_of_the_one_before() -> None:
    lease = Lease()
    assert lease.command("a", 0.0)
    lease.give("a")
    assert lease.is_to_stand(0.05)
    assert lease.command("b", 0.1)
    assert zeros(lease, 0.1, 0.1 + SILENCE) == 0


def test_another_driver_begins_with_a_robot_that_stands() -> None:
    lease = Lease()
    assert lease.command("a", 0.0)
    assert lease.take("b", LEASE + 1.0)
    assert zeros(lease, LEASE + 1.0, LEASE + 1.9) == ZEROS


def test_the_age_of_a_word_counts_from_the_beat_that_was_heard_before_it() -> None:
    beats = Beats()
    first, second = beats.next(10.0), beats.next(10.1)
    assert beats.age(second, 0.05, 10.2) == pytest.approx(0.05)
    assert beats.age(first, 0.05, 10.2) == pytest.approx(0.15)
    assert beats.age(second, 0.0, 15.1) == pytest.approx(5.0), "held up for five seconds on its way"


@pytest.mark.parametrize("since", [math.nan, -1.0, -math.inf, 5.0])
def test_what_makes_no_sense_is_as_old_as_can_be(since: float) -> None:
    beats = Beats()
    assert beats.age(beats.next(0.0), since, 0.1) == math.inf


def test_a_beat_that_was_never_sent_or_long_ago_says_nothing() -> None:
    beats = Beats(most=10)
    first = beats.next(0.0)
    for step in range(1, 12):
        beats.next(step / 10)
    assert beats.age(first, 0.0, 1.2) == math.inf
    assert beats.age(99, 0.0, 1.2) == math.inf
