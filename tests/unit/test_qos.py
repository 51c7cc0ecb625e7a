"""The named facts of a topic's ends: what is said, what holds, what fits, and how tokens spell it."""

import math
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo import KEEP_ALL, ContractError, Node, Publisher, QoS, subscribe
from robo.node.contract import contract_of
from robo.wire.qos import PRIORITIES, Quality, from_word, misfit, said
from robo_messages import String, Twist

seconds = st.none() | st.sampled_from([1e-5, 0.02, 0.5, 30.0, 1e8])
qualities = st.builds(
    QoS,
    depth=st.integers(0, 10**8),
    latched=st.booleans(),
    priority=st.sampled_from(PRIORITIES),
    deadline=seconds,
    lifespan=seconds,
)


class Commander(Node):
    """Drives."""

    commands = Publisher(Twist, "cmd_vel", qos=QoS.COMMAND, depth=3)
    state = Publisher(String, "state", latched=True)
    notes = Publisher(String, "notes", deadline=0.5)

    @subscribe("map", qos=QoS.LATCHED, lifespan=60.0)
    def on_map(self, text: String) -> None:
        pass

    @subscribe("cmd_vel_raw", qos=QoS.COMMAND)
    def on_raw(self, command: Twist) -> None:
        pass


def test_a_contract_has_what_is_said_beside_a_profile_and_what_concerns_its_end() -> None:
    contract = contract_of(Commander)
    assert {p.topic: p.qos for p in contract.publishers} == {
        "cmd_vel": QoS(depth=3, priority="interactive_high"),
        "state": QoS.LATCHED,
        "notes": QoS(deadline=0.5),
    }
    assert {s.topic: s.qos for s in contract.subscriptions} == {
        "map": QoS(depth=1, latched=True, lifespan=60.0),
        "cmd_vel_raw": QoS(depth=1),
    }


def test_without_a_profile_latched_is_the_last_message_and_a_depth_the_last_few() -> None:
    assert said(latched=True) == QoS.LATCHED
    assert said(latched=True, depth=5).depth == 5
    assert said(QoS.DEFAULT, latched=True) == QoS(latched=True)
    assert said(QoS.LATCHED, latched=False).latched is False
    assert said() == QoS.DEFAULT == QoS()


@pytest.mark.parametrize(
    ("facts", "why"),
    [
        ({"depth": -1}, "depth -1: use a positive number, or KEEP_ALL"),
        ({"priority": "urgent"}, "priority 'urgent' is not known; use real_time, "),
        ({"deadline": 0.0}, "deadline 0.0: use a number of seconds above 0"),
        ({"lifespan": math.nan}, "lifespan nan: use a number of seconds"),
        ({"lifespan": math.inf}, "lifespan inf: use a number of seconds"),
    ],
)
def test_what_makes_no_sense_is_told(facts: dict[str, Any], why: str) -> None:
    with pytest.raises(ContractError, match=why):
        QoS(**facts)


def test_a_latched_publisher_says_how_many_it_keeps() -> None:
    with pytest.raises(ContractError, match="say how many"):
        Publisher(String, "map", latched=True, depth=KEEP_ALL)
    assert QoS(latched=True, depth=KEEP_ALL).of_subscription().depth == KEEP_ALL


def test_what_is_kept_or_said_once_is_not_dropped() -> None:
    assert [QoS(depth=KEEP_ALL).reliable, QoS.LATCHED.reliable, QoS.DEFAULT.reliable] == [True, True, False]


@given(qualities)
def test_a_token_says_again_what_was_put_into_it(qos: QoS) -> None:
    assert from_word(qos.word) == qos


@pytest.mark.parametrize(
    "word", ["", "x", "01", "-1", "³", "1,", "1,latched,latched", "1,fast", "1,data", "1,lifespan=0", "1,deadline=nan"]
)
def test_what_nobody_would_write_is_no_quality(word: str) -> None:
    assert from_word(word) is None


def test_in_words() -> None:
    assert str(QoS.DEFAULT) == "depth 10"
    assert str(QoS(depth=KEEP_ALL)) == "keeps all"
    assert (
        str(msgspec.structs.replace(QoS.LATCHED, deadline=0.5, lifespan=2.0))
        == "depth 1, latched, data_high, deadline 0.5 s, lifespan 2 s"
    )


def test_ends_that_do_not_fit() -> None:
    def found(offered: QoS, wanted: QoS) -> str:
        return misfit("r1/map", ("/r1/mapper", offered), ("/r1/planner", wanted))

    assert "/r1/mapper does not latch r1/map, and /r1/planner wants" in found(QoS.DEFAULT, QoS.LATCHED)
    assert not found(QoS.LATCHED, QoS.DEFAULT)
    assert not found(QoS.LATCHED, QoS.LATCHED)
    slow = "/r1/mapper promises a message on r1/map every 1 s, and /r1/planner needs one every 0.1 s"
    assert found(QoS(deadline=1.0), QoS(deadline=0.1)) == slow
    assert not found(QoS(deadline=0.1), QoS(deadline=0.1))
    assert not found(QoS(), QoS(deadline=0.1))


def test_what_a_launch_says_comes_over_what_an_end_says_itself() -> None:
    assert Quality(profile="command").over(QoS(depth=7, deadline=1.0)) == QoS.COMMAND
    assert Quality(latched=True).over(QoS(depth=7)) == QoS(depth=7, latched=True)
    assert Quality(profile="latched", depth=3).over(QoS()).depth == 3
    assert Quality(deadline=0.0, lifespan=2.0).over(QoS(deadline=1.0)) == QoS(lifespan=2.0)
    assert Quality().over(QoS.BULK) == QoS.BULK
    assert Quality(latched=False, depth=0).over(QoS.LATCHED) == QoS(depth=0, priority="data_high")
