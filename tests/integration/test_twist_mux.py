"""The multiplexer as a node: whose commands it passes on, and when it leaves the base standing."""

import math
from typing import Any

import pytest

from robo import ContractError, ParameterError
from robo.testing import Clock, NodeUnderTest, RunNode
from robo_messages import Bool, DiagnosticStatus, Twist, Vector3
from robo_services.twist_mux import TwistMux

TOPICS = {
    "topics.nav": {"topic": "cmd_vel_nav", "priority": 10},
    "topics.joy": {"topic": "cmd_vel_joy", "priority": 100, "timeout": 0.3},
}


def twist(x: float) -> Twist:
    return Twist(Vector3(x))


def start(run_node: RunNode, **locks: dict[str, Any]) -> NodeUnderTest[TwistMux]:
    parameters = {f"{outer}.{name}": value for outer, said in TOPICS.items() for name, value in said.items()}
    parameters |= {f"locks.{lock}.{name}": value for lock, said in locks.items() for name, value in said.items()}
    return run_node(TwistMux, parameters=parameters)


def passed(mux: NodeUnderTest[TwistMux]) -> list[float]:
    """The speeds that it has told the base since it was last asked."""
    speeds = [sent.linear.x for sent in mux.published(TwistMux.command)]
    mux.clear()
    return speeds


def state(mux: NodeUnderTest[TwistMux]) -> dict[str, str]:
    said = mux.published(TwistMux.state)[-1]
    return {pair.key: pair.value for pair in said.values} | {"text": said.message, "level": str(said.level)}


def test_the_higher_one_drives_and_when_it_ends_the_base_is_told_once_to_stand(run_node: RunNode, clock: Clock) -> None:
    mux = start(run_node)
    clock.advance(1.0)
    assert passed(mux) == []
    for _ in range(5):
        mux.send("cmd_vel_nav", twist(0.1))
        mux.send("cmd_vel_joy", twist(0.9))
        clock.advance(0.1)
    assert passed(mux) == [0.1, *5 * [0.9]], "nav drove until joy was first heard, which needs no stop in between"
    clock.advance(0.5)
    assert passed(mux) == [0.0], "joy has ended: once, and nothing more"
    mux.send("cmd_vel_nav", twist(0.2))
    assert passed(mux) == [0.2]
    clock.advance(5.0)
    assert passed(mux) == [0.0]


def test_an_input_for_one_sender_takes_one_at_a_time(run_node: RunNode, clock: Clock) -> None:
    mux = run_node(
        TwistMux,
        parameters={
            "topics.page.topic": "cmd_vel_page",
            "topics.page.priority": 80,
            "topics.page.timeout": 0.3,
            "topics.page.sole": True,
        },
    )
    for _ in range(10):
        mux.send("cmd_vel_page", twist(0.5), source="/r1/dashboard_desk")
        mux.send("cmd_vel_page", twist(-0.5), source="/r1/dashboard_laptop")
        mux.send("cmd_vel_page", twist(-0.9), source=None)
        clock.advance(0.05)
    assert passed(mux) == 10 * [0.5]
    clock.advance(0.6)
    assert passed(mux) == [0.0]
    mux.send("cmd_vel_page", twist(-0.5), source="/r1/dashboard_laptop")
    assert passed(mux) == [-0.5]


def test_who_takes_over_from_a_higher_one_does_so_from_standstill(run_node: RunNode, clock: Clock) -> None:
    mux = start(run_node)
    for _ in range(10):
        mux.send("cmd_vel_joy", twist(0.9))
        mux.send("cmd_vel_nav", twist(0.1))
        clock.advance(0.1)
    passed(mux)
    for _ in range(6):
        mux.send("cmd_vel_nav", twist(0.1))
        clock.advance(0.1)
    first, *others = passed(mux)
    assert first == 0.0
    assert others == len(others) * [0.1]
    assert len(others) >= 3


def test_a_lock_that_closes_stops_it_at_once_and_one_that_falls_silent_by_its_timeout(
    run_node: RunNode, clock: Clock
) -> None:
    mux = start(run_node, alive={"topic": "alive", "priority": 255, "timeout": 0.2})
    mux.send("cmd_vel_nav", twist(0.5))
    assert passed(mux) == [], "the lock has not been heard"
    mux.send("alive", Bool(False))
    mux.send("cmd_vel_nav", twist(0.5))
    assert passed(mux) == [0.5]
    mux.send("alive", Bool(True))
    assert passed(mux) == [0.0]
    mux.send("cmd_vel_nav", twist(0.5))
    assert passed(mux) == []
    mux.send("alive", Bool(False))
    mux.send("cmd_vel_nav", twist(0.5))
    assert passed(mux) == [0.5]
    clock.advance(0.25)
    assert passed(mux) == [0.0], "the lock fell silent before nav did"


def test_a_lock_of_middle_priority_leaves_the_higher_ones_free(run_node: RunNode) -> None:
    mux = start(run_node, pause={"topic": "pause", "priority": 50, "timeout": 0.0})
    mux.send("cmd_vel_nav", twist(0.5))
    mux.send("pause", Bool(True))
    mux.send("cmd_vel_nav", twist(0.5))
    mux.send("cmd_vel_joy", twist(0.2))
    assert passed(mux) == [0.5, 0.0, 0.2]


def test_it_says_who_drives_why_and_since_when(run_node: RunNode, clock: Clock) -> None:
    mux = start(run_node, pause={"topic": "pause", "priority": 50, "timeout": 0.0})
    clock.advance(0.1)
    assert state(mux)["text"] == "nobody commands"
    assert state(mux)["driver"] == ""
    clock.advance(0.9)
    mux.send("cmd_vel_nav", twist(0.5))
    begun = state(mux)
    assert (begun["driver"], begun["reason"], begun["text"]) == ("nav", "commands", "nav drives, priority 10")
    clock.advance(0.2)
    mux.send("cmd_vel_nav", twist(0.5))
    mux.send("pause", Bool(True))
    locked = state(mux)
    assert (locked["driver"], locked["lock"], locked["reason"]) == ("", "pause", "locked")
    assert locked["text"] == "lock pause is closed: nav must not drive"
    assert locked["level"] == str(DiagnosticStatus.WARN)
    assert float(locked["since"]) == pytest.approx(float(begun["since"]) + 0.2, abs=0.01)
    mux.clear()
    clock.advance(3.0)
    assert 3 <= len(mux.published(TwistMux.state)) <= 5, "once a second, and as nav fell silent"


def test_commands_keep_their_age_and_old_ones_and_nonsense_do_not_count(run_node: RunNode, clock: Clock) -> None:
    mux = start(run_node)
    mux.send("cmd_vel_nav", twist(0.5), age=0.6)
    mux.send("cmd_vel_nav", twist(math.nan))
    mux.send("cmd_vel_nav", Twist(Vector3(0.1, math.inf)))
    assert passed(mux) == []
    mux.send("cmd_vel_nav", twist(0.5), age=0.4)
    assert passed(mux) == [0.5]
    clock.advance(0.13)
    assert passed(mux) == [0.0], "it was 0.4 s old when it came"
    mux.send("cmd_vel_nav", twist(0.5))
    mux.send("cmd_vel_nav", twist(0.7), age=0.3)
    assert passed(mux) == [0.5], "what was said before the last word does not count"


def test_priorities_may_change_while_it_runs(run_node: RunNode) -> None:
    mux = start(run_node)
    mux.node.set_parameters(**{"topics.nav.priority": 200})
    mux.send("cmd_vel_nav", twist(0.1))
    mux.send("cmd_vel_joy", twist(0.9))
    assert passed(mux) == [0.1]


def test_mistakes_are_refused(run_node: RunNode) -> None:
    with pytest.raises(ParameterError, match=r"topics\.joy has no topic and no priority"):
        run_node(TwistMux, parameters={"topics.joy.timeout": 1.0})
    with pytest.raises(ParameterError, match="expected a topic's name"):
        run_node(TwistMux, parameters={"topics.joy.topic": "a b", "topics.joy.priority": 1})
    with pytest.raises(ParameterError, match="expected int <= 255"):
        run_node(TwistMux, parameters={"topics.joy.topic": "a", "topics.joy.priority": 256})
    both = {"topics.a.topic": "same", "topics.a.priority": 1, "topics.b.topic": "same", "topics.b.priority": 2}
    with pytest.raises(ContractError, match=r"topics\.b\.topic is .*same, and so is topics\.a\.topic"):
        run_node(TwistMux, parameters=both)
    with pytest.raises(ContractError, match="the output of the mux"):
        run_node(TwistMux, parameters={"topics.a.topic": "cmd_vel_out", "topics.a.priority": 1})


def test_it_leaves_a_standing_robot(run_node: RunNode) -> None:
    mux = start(run_node)
    mux.send("cmd_vel_nav", twist(0.5))
    passed(mux)
    mux.close()
    assert passed(mux) == [0.0]
