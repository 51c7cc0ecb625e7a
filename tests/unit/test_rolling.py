"""Who is meant by a rolling restart, and what looks at one show."""

import msgspec
import pytest

from robo.errors import NodeNotFound, UsageError
from robo.tools.rolling import Look, Unit, choose
from robo.wire.reports import ProcessStatus
from tests.reports import process


def of_run(run: str, node: str, group: str = "", **more: object) -> ProcessStatus:
    return msgspec.structs.replace(process(run, node, group), run=f"id-{run}", **more)


FLEET = [
    of_run("r10", "/r10/base"),
    of_run("r2", "/r2/base", "drive", health="ok"),
    of_run("r2", "/r2/tracker"),
    of_run("site", "/a1/base"),
    of_run("site", "/a2/base"),
]


def names(*words: str, robot: str = "") -> list[str]:
    return [unit.name for unit in choose(FLEET, words, robot).units]


def test_all_robots_are_meant_where_nobody_is_named() -> None:
    assert names() == ["a1", "a2", "r2", "r10"]


def test_within_a_robot_its_nodes_are() -> None:
    assert names(robot="r2") == ["/r2/base", "/r2/tracker"]
    assert names("base", robot="r2") == ["/r2/base"]
    assert names("t*", robot="r2") == ["/r2/tracker"]


@pytest.mark.parametrize(
    ("word", "found"),
    [
        ("r2", ["r2"]),
        ("r*", ["r2", "r10"]),
        ("r*/base", ["/r10/base", "/r2/base"]),
        ("**/base", ["/r10/base", "/r2/base", "/a1/base", "/a2/base"]),
        ("tracker", ["/r2/tracker"]),
        ("base", ["/r10/base", "/r2/base", "/a1/base", "/a2/base"]),
        ("drive", ["/r2/base"]),
        ("/r2/base", ["/r2/base"]),
    ],
)
def test_words_mean_robots_or_else_nodes(word: str, found: list[str]) -> None:
    assert names(word) == found


def test_each_is_meant_once_in_the_order_of_the_words() -> None:
    assert names("r10", "r*", "a2") == ["r10", "r2", "a2"]


def test_a_robot_is_all_of_its_nodes_by_their_runs() -> None:
    (unit,) = choose(FLEET, ["r2"]).units
    assert unit == Unit("r2", {"r2": ["/r2/base", "/r2/tracker"]}, frozenset({"/r2/base"}))
    (part,) = choose(FLEET, ["a1"]).units
    assert part.nodes == {"site": ["/a1/base"]}


def test_what_nobody_wants_to_run_and_what_nobody_can_start_is_left_alone() -> None:
    there = [
        of_run("r1", "/r1/base", state="stopped"),
        of_run("r1", "/r1/tracker"),
        of_run("r3", "/r3/once", state="completed"),
        process("r4", "/r4/alone"),
    ]
    choice = choose(there, [])
    assert [unit.nodes for unit in choice.units] == [{"r1": ["/r1/tracker"]}]
    assert choice.left_alone == {
        "/r1/base": "it is stopped",
        "/r3/once": "it is completed",
        "/r4/alone": "no supervisor runs it",
    }


def test_a_word_that_means_nobody_is_told_with_what_it_may_mean() -> None:
    with pytest.raises(NodeNotFound, match="no robot and no node is r7x; there is a1, a2, r10, r2, "):
        choose(FLEET, ["r7x"])
    with pytest.raises(NodeNotFound, match=r"did you mean r2/tracker\?"):
        choose(FLEET, ["r2/trackr"])
    with pytest.raises(UsageError, match=r"robot 'r\*\*' makes no sense"):
        choose(FLEET, ["r**"])


# -- looks -----------------------------------------------------------------------------------------

UNIT = Unit("r2", {"r2": ["/r2/base", "/r2/tracker"]}, frozenset({"/r2/base"}))
BASE, TRACKER = FLEET[1], FLEET[2]


def look(*found: ProcessStatus, at: Look | None = None) -> tuple[str, bool]:
    return (at or Look(UNIT)).trouble({one.node: one for one in found})


def test_ready_nodes_with_fine_checks_are_healthy() -> None:
    assert look(BASE, TRACKER) == ("", False)


def test_a_node_that_told_how_it_is_has_to_tell_again() -> None:
    quiet = msgspec.structs.replace(BASE, health=None)
    assert look(quiet, TRACKER) == ("/r2/base has not told yet how well it is", False)
    assert not UNIT.is_well(quiet), "why it has failed is asked of this node, too"
    assert UNIT.is_well(BASE)
    assert UNIT.is_well(TRACKER), "it never tells"


@pytest.mark.parametrize("health", ["warn", "error", "stale"])
def test_a_check_that_is_not_ok_is_trouble(health: str) -> None:
    ill = msgspec.structs.replace(BASE, health=health, trouble="battery: charge it")
    assert look(ill, TRACKER) == ("/r2/base: battery: charge it", False)


def test_a_node_that_is_not_ready_is_trouble_and_one_that_has_failed_stays_so() -> None:
    starting = msgspec.structs.replace(BASE, state="starting")
    failed = msgspec.structs.replace(TRACKER, state="failed", reason="exit code 1")
    assert look(starting, TRACKER) == ("/r2/base is starting", False)
    assert look(starting, failed) == ("/r2/tracker is failed: exit code 1", True)


def test_one_that_was_started_again_meanwhile_is_trouble_once() -> None:
    at = Look(UNIT)
    again = msgspec.structs.replace(BASE, pid=2, restarts=1)
    assert look(BASE, TRACKER, at=at) == ("", False)
    assert look(again, TRACKER, at=at) == ("/r2/base has ended, and was started again", False)
    assert look(again, TRACKER, at=at) == ("", False)


def test_a_supervisor_that_does_not_answer_is_trouble() -> None:
    assert look(TRACKER) == ("the supervisor of /r2/base does not answer", False)
