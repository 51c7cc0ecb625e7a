"""Who needs whom in a run, and what follows from the states of its processes."""

from collections.abc import Coroutine, Mapping
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo.launch.plan import RestartPlan, Until
from robo.supervisor import consequences, needs
from tests.processes import FakeProcess, FakeStopping, process_plan


def process(name: str, wants: Mapping[str, Until] | None = None, **changes: Any) -> FakeProcess:
    needed = {f"/r1/{n}": until for n, until in (wants or {}).items()}
    return FakeProcess(process_plan(f"/r1/{name}", needed, **changes))


def run_of(*processes: FakeProcess) -> dict[str, FakeProcess]:
    return {one.plan.full_name: one for one in processes}


# -- what is waited for --------------------------------------------------------------------------


def test_what_a_process_waits_for_is_told_in_words() -> None:
    found = run_of(process("base").wait(), process("map").fail(), process("log"))
    plan = process_plan(
        "/r1/x",
        {"/r1/base": "ready", "/r1/map": "completed", "/r1/log": "started", "/r2/cam": "ready", "/r1/arm": "ready"},
    )
    assert needs.unmet(plan, found, {"/r2/cam"}, "r1") == [
        "base ready",
        "map completed, which is failed",
        "arm ready, on another host",
    ]


def test_a_robot_goes_on_while_anything_runs_or_will_run() -> None:
    assert needs.can_go_on(run_of(process("a"), process("b").fail()))
    assert needs.can_go_on(run_of(process("a").fail().come_to("restarting", next_start=5.0)))
    assert needs.can_go_on(run_of(process("a").complete().come_to("stopped", wanted=False))), "start may undo a stop"
    assert not needs.can_go_on(run_of(process("a").complete(), process("b").fail()))
    assert not needs.can_go_on({})


def test_what_waits_goes_on_only_if_what_it_waits_for_can() -> None:
    waits = process("b", {"a": "ready"}).wait()
    assert needs.can_go_on(run_of(process("a").wait(), waits))
    assert not needs.can_go_on(run_of(process("a").fail(), waits))
    assert not needs.can_go_on(run_of(process("a").complete(), waits)), "it was ready, and is so no more"
    last = process("c", {"b": "started"}).wait()
    assert not needs.can_go_on(run_of(process("a").fail(), waits, last)), "nor does what waits for one that waits"
    assert needs.can_go_on(run_of(process("a", {"elsewhere": "ready"}).wait())), "another host may bring it"


def test_dependents_are_those_that_need_it_and_those_that_need_these() -> None:
    found = run_of(process("a"), process("b", {"a": "ready"}), process("c", {"b": "started"}), process("d"))
    assert needs.dependents(found, "/r1/a") == {"/r1/b", "/r1/c"}
    assert needs.dependents(found, "/r1/c") == set()


@given(st.lists(st.sets(st.integers(0, 7)), min_size=8, max_size=8))
def test_no_graph_of_needs_keeps_anybody_from_an_answer(wanted: list[set[int]]) -> None:
    graph = [{str(n): "ready" for n in sorted(one)} for one in wanted]
    found = run_of(*(process(str(n), wants).wait() for n, wants in enumerate(graph)))  # type: ignore[arg-type]
    assert needs.can_go_on(found), "all may be started some day"
    for name in found:
        behind = needs.dependents(found, name)
        assert name not in behind
        assert all(found[other].plan.needs.keys() & (behind | {name}) for other in behind)


def test_those_that_wait_in_vain_are_found_once_it_is_in_vain() -> None:
    ended = process("a").fail()
    waits, ran, runs = (process(name, {"a": "ready"}) for name in "bcd")
    found = run_of(ended, waits.wait(), ran.fail(), runs)
    assert needs.in_vain(found, ended) == [(waits, "ready")]
    done = process("a").complete()
    assert needs.in_vain(run_of(done, process("b", {"a": "completed"}).wait()), done) == []


# -- what follows --------------------------------------------------------------------------------


class Tasks:
    """Does nothing; it says what it was to do."""

    def __init__(self) -> None:
        self.count = 0

    def do(self, work: Coroutine[Any, Any, object]) -> object:
        self.count += 1
        with pytest.raises(StopIteration):  # nothing of it waits
            work.send(None)
        return None


def drawn(changed: FakeProcess, *others: FakeProcess) -> list[int | None]:
    stopping = FakeStopping()
    consequences.draw(changed, run_of(changed, *others), Tasks(), stopping)
    return stopping.codes


def test_a_run_ends_with_what_is_required() -> None:
    assert drawn(process("a", required=True).fail()) == [1]
    assert drawn(process("a", required=True).complete()) == [0]
    assert drawn(process("a", required=True)) == []
    assert drawn(process("a", required=True).come_to("restarting", running=False, failed=True)) == []
    assert drawn(process("a").fail()) == []


def test_those_that_need_it_start_again_with_it_where_it_says_so() -> None:
    policy = RestartPlan(policy="on-failure", propagate=True)
    falls = process("a", restart=policy).come_to("restarting", "killed", running=False)
    needs_it, behind = process("b", {"a": "ready"}), process("c", {"b": "ready"})
    waits, stopped, other = process("d", {"a": "ready"}).wait(), process("e", {"a": "ready"}), process("f")
    stopped.wanted = False
    drawn(falls, needs_it, behind, waits, stopped, other)
    assert needs_it.asked == behind.asked == ["restart: starting again with a, which it needs"]
    assert waits.asked == stopped.asked == other.asked == falls.asked == []
    alone = process("a").come_to("restarting", running=False)
    drawn(alone, needs_it)
    assert len(needs_it.asked) == 1
