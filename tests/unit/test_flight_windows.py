"""What makes a flight recorder write: reasons, windows, names, and times of arrival."""

import time

from hypothesis import given
from hypothesis import strategies as st

from robo.recording.flight.clock import SteadyClock
from robo.recording.flight.windows import MOST_REASONS, Kind, Reason, Windows, arrivals, file_name, names_of, to_go

SECOND = 1_000_000_000
NOON = 1_700_000_000 * SECOND


def reason(at: float, kind: Kind = "died", node: str = "/r1/base", text: str = "was killed by SIGKILL") -> Reason:
    return Reason(NOON + round(at * SECOND), kind, node, text)


def windows() -> Windows:
    return Windows(before=30.0, after=2.0, again=60.0)


def test_a_window_has_the_time_before_and_after() -> None:
    found = windows()
    window = found.add(reason(0.0))
    assert window is not None
    assert (window.begin - NOON, window.due - NOON) == (-30 * SECOND, 2 * SECOND)
    assert found.take(NOON + 2 * SECOND - 1) is None
    assert found.take(NOON + 2 * SECOND) is window
    assert found.open is None
    assert found.take(NOON + 9 * SECOND) is None


def test_what_follows_puts_the_end_off_by_a_second_and_is_named_too() -> None:
    found = windows()
    first = found.add(reason(0.0))
    assert first is not None
    assert found.add(reason(0.5, node="/r1/laser")) is first
    assert first.due == NOON + round(2.5 * SECOND)
    for number in range(10):
        found.add(reason(0.5 + number / 10, "degraded"))
    found.add(reason(1.9, "emergency stop", ""))
    assert first.due == NOON + 3 * SECOND, "the file of what came first is there within 5 s"
    assert first.nodes == ["/r1/base", "/r1/laser"]
    assert first.text == "/r1/base was killed by SIGKILL, and 12 more"


def test_the_same_again_opens_no_other_window_for_a_while() -> None:
    found = windows()
    assert found.add(reason(0.0)) is not None
    found.take(NOON + 5 * SECOND)
    assert found.add(reason(10.0)) is None
    assert found.add(reason(10.0, "degraded")) is not None
    found.take(NOON + 15 * SECOND)
    assert found.add(reason(10.0, node="/r1/laser")) is not None
    found.take(NOON + 15 * SECOND)
    for at in (20.0, 30.0):
        assert found.add(reason(at, "asked", "", "once more")) is not None, "whoever asks gets a file"
        found.take(NOON + round((at + 5) * SECOND))
    assert found.add(reason(71.0)) is not None


def test_what_crashes_again_and_again_makes_one_file() -> None:
    found = windows()
    made = 0
    for second in range(0, 3600, 5):
        made += found.add(reason(second)) is not None and found.take(NOON + (second + 4) * SECOND) is not None
    assert made == 1
    assert found.add(reason(3595.0 + 60.0)) is not None


def test_what_was_in_the_window_of_another_or_in_a_file_before_counts_too() -> None:
    found = windows()
    found.add(reason(0.0, node="/r1/laser"))
    assert found.add(reason(1.0)) is not None
    found.take(NOON + 3 * SECOND)
    found.note(reason(2.0, "degraded"))
    assert found.add(reason(50.0)) is None
    assert found.add(reason(50.0, "degraded")) is None


def test_while_a_file_is_written_the_next_window_waits_and_takes_in_what_happens() -> None:
    found = windows()
    window = found.add(reason(0.0))
    assert window is not None
    for at in (0.0, 2.0, 5.0, 10.0):
        found.wait(NOON + round(at * SECOND))
    assert found.add(reason(10.0, node="/r1/laser")) is window
    assert window.due == NOON + 12 * SECOND
    assert found.take(NOON + 12 * SECOND) is window


def test_reasons_without_end_take_no_memory() -> None:
    found = windows()
    window = found.add(reason(0.0))
    assert window is not None
    for number in range(10 * MOST_REASONS):
        found.add(reason(0.001 * number))
    assert (len(window.reasons), window.left_out) == (MOST_REASONS, 9 * MOST_REASONS + 1)


def test_the_end_takes_an_open_window_at_once() -> None:
    found = windows()
    window = found.add(reason(0.0))
    assert found.take(NOON + SECOND, at_once=True) is window
    assert window is not None
    assert window.due == NOON + SECOND


def test_a_clock_that_is_set_changes_nothing_and_it_is_known_by_how_much() -> None:
    wall, steady = NOON, 5
    clock = SteadyClock(lambda: wall, lambda: steady)
    steady += SECOND
    wall += SECOND + 3
    assert (clock.now(), clock.behind()) == (NOON + SECOND, 0), "two clocks are not read at once"
    wall -= 3600 * SECOND
    assert (clock.now(), clock.behind()) == (NOON + SECOND, 3 - 3600 * SECOND)
    window = windows().add(reason(1.0))
    assert window is not None
    later = window.later(7 * SECOND)
    assert (later.begin - window.begin, later.due - window.due) == (7 * SECOND, 7 * SECOND)
    assert later.reasons == [reason(8.0)]


def test_a_file_says_robot_time_and_reason() -> None:
    at = time.strftime("%Y-%m-%d_%H-%M-%S", time.localtime(NOON / SECOND))
    for given_reason, word in [
        (reason(0.0, node="/r1/safety_monitor"), "safety_monitor_died"),
        (reason(0.0, "degraded"), "base_degraded"),
        (reason(0.0, "emergency stop", ""), "emergency_stop"),
        (reason(0.0, "asked", "", "It turned left; ../../why?"), "It_turned_left_why"),
        (reason(0.0, "asked", "", ""), "asked"),
        (reason(0.0, "asked", "", "???"), "asked"),
    ]:
        window = windows().add(given_reason)
        assert window is not None
        name = file_name("fleet/r1", window)
        assert name == f"fleet_r1_{at}_{word}"
        assert names_of("fleet/r1").fullmatch(f"{name}_2.mcap")
        assert not names_of("r1").fullmatch(f"{name}.mcap")


@given(st.text(max_size=300), st.text(max_size=300))
def test_a_files_name_is_one_whatever_is_said(robot: str, text: str) -> None:
    window = windows().add(reason(0.0, "asked", "", text))
    assert window is not None
    name = file_name(robot, window)
    assert name.isascii()
    assert name.replace("_", "").replace("-", "").isalnum()
    assert len(name) <= 80


@given(st.lists(st.integers(0, 100)), st.integers(1, 10), st.integers(1, 300))
def test_what_stays_is_no_more_than_may_be(sizes: list[int], most: int, most_size: int) -> None:
    gone = to_go([(0, size) for size in sizes], most, most_size)
    left = sizes[gone:]
    assert len(left) <= 1 or (len(left) <= most and sum(left) <= most_size)
    if gone:  # one more would be too many
        more = sizes[gone - 1 :]
        assert len(more) > most or sum(more) > most_size


TIMES = st.none() | st.integers(NOON - 3 * SECOND, NOON + 3 * SECOND)


@given(st.lists(TIMES, max_size=50), st.integers(0, SECOND))
def test_messages_came_between_two_looks(published: list[int | None], span: int) -> None:
    found = arrivals(published, NOON, NOON + span)
    assert all(NOON <= at <= NOON + span for at in found)


@given(st.lists(st.integers(NOON - SECOND, NOON + SECOND), max_size=50), st.integers(0, SECOND))
def test_what_was_published_in_order_came_in_order(published: list[int], span: int) -> None:
    assert arrivals(sorted(published), NOON, NOON + span) == sorted(arrivals(published, NOON, NOON + span))


def test_where_clocks_agree_the_time_of_publishing_is_that_of_arrival() -> None:
    assert arrivals([NOON + 5, NOON - 7, NOON + 200], NOON, NOON + 100) == [NOON + 5, NOON, NOON + 100]


def test_where_they_do_not_messages_are_spread_over_the_time_between() -> None:
    assert arrivals([1, None, 99 * NOON, 4], NOON, NOON + 100) == [NOON + 25, NOON + 50, NOON + 75, NOON + 100]
