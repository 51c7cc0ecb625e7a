"""Summing up what nodes say of how well they do."""

import math
import string

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo_messages import DiagnosticStatus, KeyValue
from robo_services.diagnostics import (
    ERROR,
    MOST_STATUSES,
    OK,
    STALE,
    WARN,
    Ledger,
    Place,
    State,
    place_of,
    state_of,
    summed_up,
    together,
    told,
)


def status(name: str, level: int = OK, message: str = "") -> DiagnosticStatus:
    return DiagnosticStatus(level, name, message)


def report(node: str, **levels: int) -> list[DiagnosticStatus]:
    """All that a node says of itself."""
    return [status(f"{node}: {check}", level, f"{check} is {level}") for check, level in levels.items()]


@pytest.mark.parametrize(
    ("name", "place"),
    [
        ("/r1/base: battery", Place("/r1/base", "battery")),
        ("/r1/arm/driver: motor 1", Place("/r1/arm/driver", "motor 1")),
        ("lidar: /dev/ttyUSB0", Place("/r1/lidar", "dev ttyUSB0")),
        ("Battery", Place("/r1/Battery", "")),
        ("/r1/base", Place("/r1/base", "")),
        ("drive: left: current", Place("/r1/drive", "left: current")),
        ("", Place("/r1/unnamed", "")),
        ("//: x", Place("/unnamed", "x")),
        ("/r1//base/: x", Place("/r1/base", "x")),
    ],
)
def test_names_of_robos_nodes_and_of_others_have_a_place(name: str, place: Place) -> None:
    assert place_of(name, "r1") == place


@given(st.text(max_size=60), st.sampled_from(["", "r1", "r1/arm"]))
def test_every_name_has_a_place_whose_path_can_be_drawn(name: str, namespace: str) -> None:
    place = place_of(name, namespace)
    assert place.path.startswith("/")
    assert "//" not in place.path
    assert not place.path.endswith("/")
    assert "/" not in place.check


def test_sums_stand_above_what_they_sum_up() -> None:
    ledger = Ledger()
    ledger.take(report("/r1/base", topics=OK, callbacks=OK, battery=WARN), "r1", 10.0)
    ledger.take(report("/r1/arm/driver", topics=OK, callbacks=ERROR), "r1", 10.0)
    found = summed_up(ledger.present(10.5, 5.0))
    assert [(one.name, one.level, one.message) for one in found] == [
        ("/r1", ERROR, "arm: driver: callbacks: callbacks is 2"),
        ("/r1/arm", ERROR, "driver: callbacks: callbacks is 2"),
        ("/r1/arm/driver", ERROR, "callbacks: callbacks is 2"),
        ("/r1/arm/driver/callbacks", ERROR, "callbacks is 2"),
        ("/r1/arm/driver/topics", OK, "topics is 0"),
        ("/r1/base", WARN, "battery: battery is 1"),
        ("/r1/base/battery", WARN, "battery is 1"),
        ("/r1/base/callbacks", OK, "callbacks is 0"),
        ("/r1/base/topics", OK, "topics is 0"),
    ]
    assert found[5].values == [
        KeyValue("battery", "battery is 1"), KeyValue("callbacks", "callbacks is 0"), KeyValue("topics", "topics is 0"),
    ]  # fmt: skip


def test_what_is_silent_is_stale_and_its_robot_in_error_until_all_of_it_is() -> None:
    ledger = Ledger()
    ledger.take(report("/r1/base", topics=OK, callbacks=OK), "r1", 10.0)
    ledger.take(report("/r1/arm", topics=OK, callbacks=OK), "r1", 13.0)
    present = ledger.present(16.0, 5.0)
    assert {one.name: one.level for one in summed_up(present)} == {
        "/r1": ERROR, "/r1/arm": OK, "/r1/arm/callbacks": OK, "/r1/arm/topics": OK,
        "/r1/base": STALE, "/r1/base/callbacks": STALE, "/r1/base/topics": STALE,
    }  # fmt: skip
    state = state_of(present)
    assert state == State(ERROR, (("/r1/base", STALE),), 4, "/r1/base: has said nothing for 6 s")
    assert told(state) == "ERROR: /r1/base: has said nothing for 6 s"
    assert state_of(ledger.present(30.0, 5.0)).level == STALE
    ledger.forget(12.0)
    assert told(state_of(ledger.present(16.0, 5.0))) == "OK: all 2 checks"
    assert state_of({}) == State(STALE, (), 0, "nobody has said anything")
    assert told(state_of({})) == "STALE: nobody has said anything"


def test_what_is_of_no_known_age_is_stale() -> None:
    ledger = Ledger()
    ledger.take(report("lidar", link=OK), "r1", -math.inf)
    assert state_of(ledger.present(0.0, 5.0)).message == "/r1/lidar: has said nothing of a known age"


def test_a_whole_report_of_a_node_takes_the_place_of_the_one_before() -> None:
    ledger = Ledger()
    ledger.take(report("/r1/cam", topics=OK, callbacks=OK, exposure=WARN), "r1", 1.0)
    ledger.take(report("/r1/base", topics=OK, callbacks=OK), "r1", 1.0)
    ledger.take(report("/r1/cam", topics=OK, callbacks=OK), "r1", 2.0)
    assert sorted(place.path for place in ledger.present(2.0, 5.0)) == [
        "/r1/base/callbacks", "/r1/base/topics", "/r1/cam/callbacks", "/r1/cam/topics",
    ]  # fmt: skip
    ledger.take(report("lidar", link=OK), "r1", 2.0)
    ledger.take(report("lidar", motor=OK), "r1", 2.5)
    assert len(ledger.present(2.5, 5.0)) == 6, "others may send one status at a time"


def test_an_older_report_that_comes_late_changes_nothing() -> None:
    ledger = Ledger()
    ledger.take([status("lidar: link", OK)], "r1", 2.0)
    ledger.take([status("lidar: link", ERROR)], "r1", 1.0)
    assert state_of(ledger.present(2.0, 5.0)).level == OK


def test_a_stranger_cannot_fill_the_memory() -> None:
    ledger = Ledger()
    ledger.take([status(f"x{i}: y") for i in range(MOST_STATUSES)], "r1", 0.0)
    ledger.take([status(f"z{i}: y") for i in range(70)], "r1", 0.0)
    assert len(ledger.present(0.0, 5.0)) == MOST_STATUSES
    assert ledger.left_out == 70
    found = summed_up(ledger.present(0.0, 5.0))
    assert len(found[0].values) == 100


@pytest.mark.parametrize(
    ("levels", "level"),
    [([], STALE), ([OK, OK], OK), ([OK, WARN], WARN), ([ERROR, STALE], ERROR), ([OK, STALE], ERROR), ([STALE], STALE)],
)
def test_levels_together_are_ros_s(levels: list[int], level: int) -> None:
    assert together(levels) == level


words = st.text(string.ascii_lowercase, min_size=1, max_size=2)
names = st.builds(lambda parts, check: f"/{'/'.join(parts)}: {check}", st.lists(words, min_size=1, max_size=3), words)


@given(st.dictionaries(names, st.sampled_from([OK, WARN, ERROR, STALE]), max_size=30))
def test_no_trouble_is_lost_on_its_way_up(levels: dict[str, int]) -> None:
    ledger = Ledger()
    ledger.take([status(name, level, "so") for name, level in levels.items()], "", 0.0)
    present = ledger.present(0.0, 5.0)
    found = {one.name: one for one in summed_up(present)}
    assert list(found) == sorted(found)
    for place, one in present.items():
        path = place.path
        while path := path.rpartition("/")[0]:
            above = found[path].level
            assert above >= WARN or one.level == OK
            assert above >= ERROR or one.level < ERROR
    state = state_of(present)
    assert (state.level == OK) == (all(one.level == OK for one in present.values()) and bool(present))
    assert bool(state.bad) == any(one.level != OK for one in present.values())
