"""What is said of joints, and how often."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo.tf import Transform3
from robo_messages import JointState
from robo_services.robot_state import MOST_STRANGERS, SET_BACK, Pace, RobotState, no_positions, positions_of
from robo_services.urdf_model import parse

MS = 1_000_000
INTERVAL = 50 * MS

ARM = parse("""<robot name="arm">
  <link name="base"/><link name="upper"/><link name="lower"/><link name="finger"/>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><axis xyz="0 0 1"/></joint>
  <joint name="grip" type="prismatic"><parent link="lower"/><child link="finger"/><axis xyz="1 0 0"/>
    <mimic joint="elbow" multiplier="2"/></joint>
</robot>""")


@given(st.lists(st.integers(0, 200 * MS), min_size=1, max_size=200))
def test_no_more_is_let_through_than_the_interval_allows(gaps: list[int]) -> None:
    pace, stamp, said = Pace(), 0, []
    for gap in gaps:
        stamp += gap
        if pace.lets_through(["a"], stamp, INTERVAL):
            said.append(stamp)
    for i, begin in enumerate(said):
        for j in range(i, len(said)):
            assert j - i + 1 <= (said[j] - begin) // INTERVAL + 2
    assert said[0] == gaps[0], "the first one is let through"


@given(st.lists(st.integers(-20 * MS, 20 * MS), min_size=10, max_size=100))
def test_what_comes_at_the_very_rate_is_let_through_though_it_jitters(jitter: list[int]) -> None:
    """But for a few at the beginning, where it is not known yet how early the next ones come."""
    pace = Pace()
    said = [pace.lets_through(["a"], i * INTERVAL + late, INTERVAL) for i, late in enumerate(jitter)]
    assert said.count(False) <= 1


def test_each_joint_has_its_own_pace_and_those_of_one_message_share_it() -> None:
    pace = Pace()
    assert pace.lets_through(["a", "b"], 0, INTERVAL)
    assert not pace.lets_through(["a"], 20 * MS, INTERVAL)
    assert pace.lets_through(["c"], 20 * MS, INTERVAL)
    assert pace.lets_through(["a", "c"], 55 * MS, INTERVAL), "a is due"
    assert not pace.lets_through(["c"], 80 * MS, INTERVAL)


def test_stamps_that_go_back_begin_anew_and_one_that_comes_late_does_not() -> None:
    pace = Pace()
    assert pace.lets_through(["a"], 100 * SET_BACK, INTERVAL)
    assert not pace.lets_through(["a"], 100 * SET_BACK - SET_BACK, INTERVAL)
    assert pace.lets_through(["a"], 7, INTERVAL)
    assert pace.lets_through(["a"], 7 + INTERVAL, INTERVAL)


def test_what_is_heard_is_placed_with_what_follows() -> None:
    state = RobotState(ARM)
    assert [joint.child for joint in state.missing] == ["upper", "lower", "finger"]
    placed = state.take({"elbow": 0.5, "wrist": 1.0, "shoulder": math.nan}, 0, INTERVAL)
    assert placed == {"elbow": Transform3.planar(0.0, 0.0, 0.5), "grip": Transform3(x=1.0)}
    assert [joint.name for joint in state.missing] == ["shoulder"]
    assert state.strangers == {"wrist"}
    assert state.take({"elbow": 0.6}, 10 * MS, INTERVAL) == {}
    assert [*state.take({"shoulder": 0.1, "elbow": 0.6}, 10 * MS, INTERVAL)] == ["shoulder", "elbow", "grip"]
    assert [*state.take({"elbow": 0.6}, 11 * MS)] == ["elbow", "grip"], "all of it"
    assert state.missing == []
    assert state.take({}, 0) == state.take({"wrist": 1.0}, 0) == {}


def test_not_more_strangers_are_remembered_than_somebody_reads() -> None:
    state = RobotState(ARM)
    state.take({f"x{i}": 0.0 for i in range(10 * MOST_STRANGERS)}, 0)
    assert len(state.strangers) == MOST_STRANGERS


def test_a_message_has_as_many_positions_as_names() -> None:
    assert positions_of(JointState(name=["a", "b", "a"], position=[1.0, math.inf, 3.0])) == {"a": 1.0, "b": math.inf}
    assert positions_of(JointState()) == {}
    for position in ([], [1.0], [1.0, 2.0, 3.0]):
        with pytest.raises(ValueError, match=rf"{len(position)} positions of 2 joints"):
            positions_of(JointState(name=["a", "b"], position=position))
    assert no_positions({"a": 1.0, "b": math.inf, "c": math.nan, "d": -1e300}) == ["b", "c", "d"]
