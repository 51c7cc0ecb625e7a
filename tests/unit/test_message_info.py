"""How old messages are and whose, by pure arithmetic: all clocks are the test's."""

import math

from hypothesis import given
from hypothesis import strategies as st

from robo.node.message_info import LEASE, PLAIN, MessageInfo, SoleSource, SourceClock
from robo_messages import String
from robo_services.arrivals import DOUBT, Arrivals, Newest

S = 1_000_000_000
DAY = 86_400 * S


class Link:
    """A publisher with a clock of its own, and a receiver; times in s."""

    def __init__(self, offset: float = 0.0) -> None:
        self.clock = SourceClock()
        self.offset = offset

    def age(self, sent: float, arrived: float) -> float:
        wall = 10**9 * S
        return self.clock.age(wall + round((sent + self.offset) * S), round(arrived * S), wall + round(arrived * S))

    def settle(self, until: float = 1.0, transit: float = 0.001) -> None:
        for n in range(round(until * 10)):
            self.age(n / 10, n / 10 + transit)


def test_a_message_that_waited_is_as_old_as_it_waited() -> None:
    link = Link()
    link.settle()
    assert math.isclose(link.age(1.0, 3.5), 2.5, abs_tol=0.01)


def test_it_is_so_across_hosts_whose_clocks_differ() -> None:
    for offset in (-400 * 86_400.0, -3.0, 0.01, 5.0, 400 * 86_400.0):
        link = Link(offset)
        link.settle()
        assert math.isclose(link.age(1.0, 2.25), 1.25, abs_tol=0.01), offset


def test_after_a_long_silence_a_late_burst_is_as_old_as_it_is() -> None:
    """A commander that was quiet for an hour, and the first that it says then waits for 3.7 s."""
    for offset in (-7.0, 0.0, 7.0):
        link = Link(offset)
        link.settle()
        ages = [link.age(3600.0 + n / 10, 3603.7) for n in range(10)]
        assert min(ages) > 2.0, (offset, ages)
        fresh = [link.age(3604.0 + n / 10, 3604.001 + n / 10) for n in range(5)]
        assert fresh[-1] < 0.01, (offset, fresh)


def test_a_queue_that_is_drained_is_not_taken_for_a_fresh_stream() -> None:
    """The first that ever comes of another host: twenty messages of a pause, all at once."""
    link = Link(-7.0)
    ages = [link.age(n / 10, 2.0) for n in range(20)]
    assert min(ages) > 5.0


def test_a_stamp_from_the_future_is_of_no_known_clock() -> None:
    assert Link(5.0).age(0.0, 0.001) == math.inf


def test_on_one_machine_the_first_message_has_its_age() -> None:
    assert math.isclose(Link().age(0.0, 0.002), 0.002, abs_tol=1e-6)
    assert math.isclose(Link().age(0.0, 0.8), 0.8, abs_tol=1e-6)


def test_the_receivers_wall_clock_may_jump() -> None:
    link = Link()
    link.settle()
    wall = 10**9 * S
    assert link.clock.age(wall + round(1.0 * S), round(1.001 * S), wall + 30 * DAY) < 0.01
    assert link.clock.age(wall + round(1.1 * S), round(3.1 * S), wall - 30 * DAY) > 1.9


def test_the_publishers_wall_clock_may_jump_either_way() -> None:
    for jump in (-3600.0, -1.0, 1.0, 3600.0):
        link = Link()
        link.settle()
        link.offset = jump
        ages = [link.age(1.0 + n / 10, 1.001 + n / 10) for n in range(10)]
        assert ages[-1] < 0.01, (jump, ages)
        assert all(age < 0.02 or age >= min(1.0, abs(jump)) - 0.02 for age in ages)
        assert math.isclose(link.age(2.0, 3.0), 1.0, abs_tol=0.02)


@given(st.lists(st.integers(min_value=-(2**63), max_value=2**63 - 1), max_size=20))
def test_lying_stamps_make_nothing_worse_than_old_or_unknown(stamps: list[int]) -> None:
    clock = SourceClock()
    for n, stamp in enumerate(stamps):
        assert clock.age(stamp, 5 * DAY + n * S // 10, 10**9 * S) >= 0.0


@given(
    st.lists(st.tuples(st.floats(0.01, 0.2), st.floats(0.0, 2.0)), min_size=1, max_size=60),
    st.floats(-1e6, 1e6),
)
def test_no_message_looks_younger_than_it_is_by_more_than_the_quickest_took(
    sendings: list[tuple[float, float]], offset: float
) -> None:
    link = Link(offset)
    link.settle(1.0, transit=0.002)
    sent, arrived = 1.0, 1.0
    for pause, delay in sendings:
        sent += pause
        arrived = max(arrived, sent + 0.002 + delay)
        age = link.age(sent, arrived)
        assert age >= (arrived - sent) - 0.002 - 1e-3 * (arrived + 1.0) - 1e-6


def info(source: str, id_: str = "a:1") -> MessageInfo:
    return MessageInfo(0.0, source, id_)


class Told:
    def __init__(self) -> None:
        self.of: list[tuple[str, int]] = []

    def __call__(self, sender: str, count: int) -> None:
        self.of.append((sender, count))


def test_the_named_node_alone_counts() -> None:
    sole, told = SoleSource(), Told()
    assert sole.admits(info("/r1/monitor"), "/r1/monitor", 0.0, told)
    assert not sole.admits(info("/r1/other", "b:1"), "/r1/monitor", 0.01, told)
    assert not sole.admits(info("", ""), "/r1/monitor", 9.0, told)
    assert told.of == [("/r1/other", 1), ("a plain Zenoh client", 1)]
    assert [(r.sender, r.count) for r in sole.refused(9.0)] == [("/r1/other", 1), ("a plain Zenoh client", 1)]


def test_of_a_name_without_end_only_so_much_is_told() -> None:
    sole, told = SoleSource(), Told()
    assert not sole.admits(info("/" + "x" * 60_000, "b:1"), "/r1/monitor", 0.0, told)
    assert len(told.of[0][0]) < 300
    assert len(sole.refused(1.0)[0].sender) < 300


def test_without_a_name_the_first_node_counts_until_it_is_silent() -> None:
    sole, told = SoleSource(), Told()
    assert not sole.admits(info("", ""), "", 0.0, told), "a plain client is no node"
    assert sole.admits(info("/r1/first", "a:1"), "", 0.0, told)
    assert not sole.admits(info("/r1/second", "b:1"), "", 0.1, told)
    assert sole.admits(info("/r1/first", "a:1"), "", 0.2, told)
    assert ("/r1/second", 1) in told.of
    assert sole.admits(info("/r1/second", "b:1"), "", 0.2 + LEASE + 0.01, told)


def test_who_takes_over_from_a_dead_twin_is_not_told_of() -> None:
    sole, told = SoleSource(), Told()
    assert sole.admits(info("/r1/monitor", "a:1"), "/r1/monitor", 0.0, told)
    assert not sole.admits(info("/r1/monitor", "b:1"), "/r1/monitor", 0.3, told)
    assert sole.admits(info("/r1/monitor", "b:1"), "/r1/monitor", 0.6, told)
    assert told.of == []
    assert sole.refused(1.0) == []


def test_plain_clients_count_where_they_are_wanted() -> None:
    sole, told = SoleSource(), Told()
    assert sole.admits(info("", ""), PLAIN, 0.0, told)
    assert not sole.admits(info("/r1/monitor"), PLAIN, 0.1, told)


def test_a_message_without_a_stamp_counts_from_its_arrival_unless_somebody_was_held_up() -> None:
    plain = MessageInfo(math.inf)
    arrivals = Arrivals(unstamped=True)
    assert arrivals.sent(plain, 10.0, 10.0) == 10.0
    for n in range(5):
        arrivals.tick(10.0 + n / 50, 1 / 50)
    assert arrivals.sent(plain, 10.09, 10.09) == 10.09
    assert arrivals.sent(plain, 12.0, 12.0) == -math.inf, "before the timer has run again"
    arrivals.tick(12.0, 1 / 50)
    assert arrivals.sent(plain, 12.01, 12.01) == -math.inf, "and a moment after"
    assert arrivals.sent(plain, 12.01 + DOUBT, 12.01 + DOUBT) == -math.inf, "while no timer runs"
    for n in range(20):
        arrivals.tick(12.02 + n / 50, 1 / 50)
    assert arrivals.sent(plain, 12.41, 12.41) == 12.41
    assert Arrivals(unstamped=False).sent(plain, 1.0, 1.0) == -math.inf
    assert arrivals.sent(MessageInfo(math.inf, source_time=1), 12.41, 12.41) == -math.inf
    assert arrivals.sent(MessageInfo(0.25), 12.41, 12.41) == 12.16


def test_the_newest_message_is_the_one_that_was_sent_last() -> None:
    newest: Newest[String] = Newest()
    assert newest.age(5.0) == math.inf
    newest.take(String("a"), 10.0, 10.5)
    newest.take(String("late"), 9.0, 10.5)
    assert newest.message == String("a")
    assert newest.age(11.0) == 1.0
    assert newest.age(2.0) == math.inf, "simulated time has stepped back"
    newest.take(String("b"), 2.0, 2.0)
    assert (newest.message, newest.age(2.5)) == (String("b"), 0.5)
