"""One after another is started again: how far each has come, and whose turn it is; time is handed in."""

import pytest

from robo.tools.rollout import Account, Gate, Rollout, Stage, Terms

TERMS = Terms(batch=1, settle=5.0, timeout=30.0)


def stage_of(gate: Gate) -> Stage:
    """How far it has come just now."""
    return gate.stage


def gate_at(stage: Stage, begun: float = 0.0) -> Gate:
    """A gate that has come so far."""
    gate = Gate(TERMS)
    if stage == "untouched":
        return gate
    gate.begin(begun)
    if stage == "restarting":
        return gate
    gate.carried_out(begun)
    if stage == "failed":
        gate.lost("/r1/base has failed")
    elif stage != "waiting":
        gate.healthy(begun)
        if stage == "done":
            gate.healthy(begun + TERMS.settle)
    assert stage_of(gate) == stage
    return gate


def test_one_that_stays_healthy_is_done() -> None:
    gate = Gate(TERMS)
    gate.begin(100.0)
    gate.carried_out(101.0)
    gate.ill("/r1/base is starting", 102.0)
    assert (stage_of(gate), gate.reason) == ("waiting", "/r1/base is starting")
    gate.healthy(103.0)
    assert (stage_of(gate), gate.reason) == ("settling", "")
    gate.healthy(107.9)
    assert stage_of(gate) == "settling"
    gate.elapsed(108.0)
    assert stage_of(gate) == "done"


def test_one_that_falls_ill_while_it_settles_has_to_stay_healthy_anew() -> None:
    gate = gate_at("settling", begun=10.0)
    gate.ill("/r1/base: battery: charge it", 14.0)
    gate.healthy(15.0)
    gate.elapsed(19.9)
    assert stage_of(gate) == "settling"
    gate.elapsed(20.0)
    assert stage_of(gate) == "done"


def test_one_that_does_not_become_healthy_in_time_has_failed_and_says_what_it_lacks() -> None:
    gate = gate_at("waiting")
    gate.ill("/r1/base: battery: charge it", 29.9)
    assert stage_of(gate) == "waiting"
    gate.elapsed(30.0)
    assert stage_of(gate) == "failed"
    assert gate.reason == "it did not become healthy within 30 s: /r1/base: battery: charge it"


def test_what_is_healthy_when_time_is_up_may_settle_and_no_more() -> None:
    gate = gate_at("waiting")
    gate.healthy(29.0)
    gate.elapsed(33.0)
    assert stage_of(gate) == "settling"
    gate.ill("/r1/base is restarting", 33.5)
    assert stage_of(gate) == "failed"


def test_one_that_is_not_started_again_has_failed() -> None:
    refused = gate_at("restarting")
    refused.refused("not done within 60 s")
    assert (refused.stage, refused.reason) == ("failed", "not done within 60 s")
    late = gate_at("restarting")
    late.elapsed(30.0)
    assert (late.stage, late.reason) == ("failed", "it was not started again within 30 s")


def test_no_settling_is_one_look() -> None:
    gate = Gate(Terms(settle=0.0))
    gate.begin(0.0)
    gate.carried_out(0.1)
    gate.healthy(0.2)
    assert stage_of(gate) == "done"


@pytest.mark.parametrize("stage", ["untouched", "restarting", "done", "failed"])
def test_looks_mean_nothing_where_nothing_is_awaited(stage: Stage) -> None:
    for event in ("healthy", "ill", "lost"):
        gate = gate_at(stage)
        before = gate.reason
        words: tuple[object, ...] = {"healthy": (1.0,), "ill": ("x", 1.0), "lost": ("x",)}[event]
        getattr(gate, event)(*words)
        assert (stage_of(gate), gate.reason) == (stage, before), event


@pytest.mark.parametrize("stage", ["untouched", "waiting", "settling", "done", "failed"])
def test_answers_mean_nothing_where_none_is_awaited(stage: Stage) -> None:
    gate = gate_at(stage)
    gate.refused("no")
    gate.carried_out(1.0)
    assert stage_of(gate) == stage


@pytest.mark.parametrize("stage", ["restarting", "waiting", "settling", "done", "failed"])
def test_nobody_is_begun_twice(stage: Stage) -> None:
    gate = gate_at(stage)
    gate.begin(1000.0)
    assert stage_of(gate) == stage


# -- whose turn it is ------------------------------------------------------------------------------


def finish(rollout: Rollout, name: str, now: float) -> None:
    gate = rollout.gates[name]
    gate.carried_out(now)
    gate.healthy(now)
    gate.healthy(now + TERMS.settle)
    assert stage_of(gate) == "done"


def test_the_next_ones_turn_comes_when_the_one_before_is_done() -> None:
    rollout = Rollout(["r1", "r2", "r3"], TERMS)
    assert rollout.due(0.0) == ["r1"]
    assert rollout.due(1.0) == []
    finish(rollout, "r1", 2.0)
    assert rollout.due(8.0) == ["r2"]
    assert rollout.looked_after == []
    rollout.gates["r2"].carried_out(9.0)
    assert rollout.looked_after == ["r2"]


def test_a_batch_begins_together_and_the_next_when_all_of_it_is_done() -> None:
    rollout = Rollout(["r1", "r2", "r3", "r4", "r5"], TERMS._replace(batch=2))
    assert rollout.due(0.0) == ["r1", "r2"]
    finish(rollout, "r2", 1.0)
    assert rollout.due(7.0) == []
    finish(rollout, "r1", 7.0)
    assert rollout.due(13.0) == ["r3", "r4"]
    finish(rollout, "r3", 13.0)
    finish(rollout, "r4", 13.0)
    assert rollout.due(20.0) == ["r5"]
    finish(rollout, "r5", 20.0)
    assert rollout.over
    assert rollout.account() == Account("done", ["r1", "r2", "r3", "r4", "r5"], {}, [], [])


def test_it_stops_at_the_first_that_fails_and_leaves_the_rest() -> None:
    rollout = Rollout(["r1", "r2", "r3", "r4"], TERMS._replace(batch=2))
    rollout.due(0.0)
    for name in ("r1", "r2"):
        rollout.gates[name].carried_out(1.0)
    rollout.gates["r1"].lost("/r1/base has failed")
    assert rollout.over
    assert rollout.due(2.0) == []
    assert rollout.account() == Account("stopped", [], {"r1": "/r1/base has failed"}, ["r2"], ["r3", "r4"])


def test_time_fails_whoever_is_too_late() -> None:
    rollout = Rollout(["r1", "r2"], TERMS)
    rollout.due(0.0)
    rollout.elapsed(29.0)
    assert not rollout.over
    rollout.elapsed(30.0)
    assert rollout.account().failed == {"r1": "it was not started again within 30 s"}


def test_an_interrupted_one_says_what_is_under_way() -> None:
    rollout = Rollout(["r1", "r2"], TERMS)
    assert rollout.account() == Account("interrupted", [], {}, [], ["r1", "r2"])
    rollout.due(0.0)
    assert rollout.account() == Account("interrupted", [], {}, ["r1"], ["r2"])


def test_nobody_is_no_work() -> None:
    assert Rollout([], TERMS).over
