"""Goals: the state machine of ROS 2, transition by transition, and what a server keeps of its goals."""

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo.errors import ContractError
from robo.node import goals
from robo.node.actions import Policy
from robo.node.goals import MOST_KEPT, MOST_QUEUED, RESULT_TIMEOUT, Goal, Goals, Refused
from robo.wire.actions import action_types
from robo.wire.goals import (
    GoalEvent,
    GoalState,
    IllegalTransition,
    after,
    id_of,
    id_text,
    new_goal_id,
    state_of,
)
from robo_messages import Fibonacci, GoalInfo, GoalStatus, Message, Time, Twist, message
from robo_messages.action import UUID, CancelGoal

# As https://design.ros2.org/articles/actions.html draws it.
LEGAL = {
    "ACCEPTED": {"execute": "EXECUTING", "cancel_goal": "CANCELING"},
    "EXECUTING": {"cancel_goal": "CANCELING", "succeed": "SUCCEEDED", "abort": "ABORTED"},
    "CANCELING": {"succeed": "SUCCEEDED", "canceled": "CANCELED", "abort": "ABORTED"},
}


@pytest.mark.parametrize("event", GoalEvent)
@pytest.mark.parametrize("state", GoalState)
def test_every_event_in_every_state(state: GoalState, event: GoalEvent) -> None:
    expected = LEGAL.get(state.name, {}).get(event.value)
    if expected is None:
        with pytest.raises(IllegalTransition, match=state.name):
            after(state, event)
    else:
        assert after(state, event) == GoalState[expected]


def test_the_numbers_are_those_of_ros() -> None:
    for state in GoalState:
        assert getattr(GoalStatus, f"STATUS_{state.name}") == state
    assert [state_of(number) for number in (-1, 7, 6, 0)] == [0, 0, GoalState.ABORTED, 0]


def test_ids_are_random_uuids() -> None:
    ids = {new_goal_id() for _ in range(1000)}
    assert len(ids) == 1000
    for one in ids:
        text = id_text(one)
        assert (len(text), text[14], text[19] in "89ab", id_of(text), id_of(text.replace("-", ""))) == (
            36,
            "4",
            True,
            one,
            one,
        )
    assert [id_of(text) for text in ("", "12", "x" * 32, "0" * 31)] == [None] * 4


def test_an_action_has_three_types_of_one_name() -> None:
    types = action_types(Fibonacci.Goal, Fibonacci.Result, Fibonacci.Feedback)
    assert types.name == "example/Fibonacci"
    assert types is action_types(Fibonacci.Goal, Fibonacci.Result, Fibonacci.Feedback)
    with pytest.raises(ContractError, match="name them example/Fibonacci_Goal, example/Fibonacci_Result and"):
        action_types(Fibonacci.Goal, Fibonacci.Feedback, Fibonacci.Result)
    with pytest.raises(ContractError, match="geometry/Twist_Goal"):
        action_types(Twist, Twist, Twist)


def test_a_result_can_be_made_of_nothing() -> None:
    @message("test_goals/Strict_Goal")
    class Goal(Message):
        """Nothing."""

    @message("test_goals/Strict_Result")
    class Result(Message):
        number: int

    @message("test_goals/Strict_Feedback")
    class Feedback(Message):
        """Nothing."""

    with pytest.raises(ContractError, match=r"test_goals/Strict_Result: .*number.*give each field a default"):
        action_types(Goal, Result, Feedback)


class Kept:
    """Goals with a clock of the test's, and an id for each number."""

    def __init__(self, policy: Policy, *, cancelable: bool = True) -> None:
        self.time = 0.0
        self.goals = Goals(policy, cancelable=cancelable, now=lambda: self.time)

    def take(self, number: int) -> tuple[Goal, list[Goal]]:
        return self.goals.take(ident(number), Fibonacci.Goal(number), Time(number))

    def run(self) -> Goal:
        goal = self.goals.next()
        assert goal is not None
        return goal

    def cancel(self, number: int = 0, until: int = 0) -> tuple[int, list[int], list[Goal]]:
        goal_id = ident(number) if number else bytes(16)
        response, ended = self.goals.cancel(GoalInfo(UUID(goal_id), Time(until)))
        return response.return_code, [info.stamp.sec for info in response.goals_canceling], ended

    def states(self) -> dict[int, GoalState]:
        return {one.goal_info.stamp.sec: state_of(one.status) for one in self.goals.status().status_list}


def ident(number: int) -> bytes:
    return number.to_bytes(16, "big")


def test_a_goal_runs_and_succeeds() -> None:
    kept = Kept("refuse")
    goal, ended = kept.take(1)
    assert (goal.state, ended, kept.goals.taken) == (GoalState.ACCEPTED, [], 1)
    assert kept.run() is goal
    assert kept.states() == {1: GoalState.EXECUTING}
    assert kept.goals.finish(goal, Fibonacci.Result([1]))
    assert kept.states() == {1: GoalState.SUCCEEDED}
    assert not kept.goals.finish(goal, None, "again")
    assert goal.state == GoalState.SUCCEEDED
    assert kept.goals.next() is None


def test_refuse() -> None:
    kept = Kept("refuse")
    goal, _ = kept.take(1)
    with pytest.raises(Refused, match=f"goal {id_text(ident(1))} is under way"):
        kept.take(2)
    kept.run()
    with pytest.raises(Refused, match="under way"):
        kept.take(2)
    kept.goals.finish(goal, Fibonacci.Result())
    kept.take(2)
    with pytest.raises(Refused, match=r"there is a goal .* already"):
        kept.take(1)
    with pytest.raises(Refused, match="zeros"):
        kept.take(0)


def test_queue() -> None:
    kept = Kept("queue")
    for number in range(1, MOST_QUEUED + 1):
        kept.take(number)
    with pytest.raises(Refused, match="100 goals wait already"):
        kept.take(999)
    assert kept.run().info.stamp.sec == 1
    kept.take(999)
    assert kept.cancel(5) == (0, [5], [kept.goals.find(ident(5))])
    order = []
    while (goal := kept.goals.next()) is not None:
        order.append(goal.info.stamp.sec)
        kept.goals.finish(goal, Fibonacci.Result())
    assert order == [*range(2, 5), *range(6, MOST_QUEUED + 1), 999]


def test_preempt() -> None:
    kept = Kept("preempt")
    first, _ = kept.take(1)
    kept.run()
    second, ended = kept.take(2)
    assert (ended, first.state, first.is_to_be_told) == ([], GoalState.EXECUTING, True)
    third, ended = kept.take(3)
    assert ended == [second]
    assert (second.state, second.message) == (GoalState.ABORTED, f"preempted by goal {id_text(ident(3))}")
    kept.goals.told(first)
    kept.goals.finish(first, None)
    assert (first.state, first.message) == (GoalState.ABORTED, f"preempted by goal {id_text(ident(2))}")
    assert kept.run() is third


def test_a_goal_that_is_done_before_it_hears_of_it_has_succeeded() -> None:
    for policy in ("refuse", "preempt"):
        kept = Kept(policy)
        goal, _ = kept.take(1)
        kept.run()
        if policy == "preempt":
            kept.take(2)
        else:
            assert kept.cancel(1)[0] == CancelGoal.Response.ERROR_NONE
            assert goal.state == GoalState.CANCELING
        kept.goals.finish(goal, Fibonacci.Result())
        assert goal.state == GoalState.SUCCEEDED


def test_whoever_cancels_says_which_as_in_ros() -> None:
    response = CancelGoal.Response
    kept = Kept("queue")
    assert kept.cancel() == (response.ERROR_NONE, [], [])
    assert kept.cancel(1) == (response.ERROR_UNKNOWN_GOAL_ID, [], [])
    for number in range(1, 7):
        kept.take(number)
    done = kept.run()
    kept.goals.finish(done, Fibonacci.Result())
    assert kept.cancel(1) == (response.ERROR_GOAL_TERMINATED, [], [])
    running = kept.run()
    assert kept.cancel(until=3)[:2] == (response.ERROR_NONE, [2, 3])
    assert (running.state, running.told) == (GoalState.CANCELING, False)
    assert kept.cancel(6, until=4)[:2] == (response.ERROR_NONE, [2, 4, 6])
    assert kept.cancel()[:2] == (response.ERROR_NONE, [2, 5])
    kept.goals.told(running)
    kept.goals.finish(running, Fibonacci.Result([7]))
    assert (running.state, running.result) == (GoalState.CANCELED, Fibonacci.Result([7]))
    assert set(kept.states().values()) == {GoalState.SUCCEEDED, GoalState.CANCELED}
    assert kept.goals.next() is None


def test_a_handler_that_cannot_be_interrupted_is_not_canceled() -> None:
    kept = Kept("queue", cancelable=False)
    running, _ = kept.take(1)
    kept.take(2)
    kept.run()
    assert kept.cancel(1) == (CancelGoal.Response.ERROR_REJECTED, [], [])
    assert kept.cancel()[:2] == (CancelGoal.Response.ERROR_NONE, [2])
    assert running.state == GoalState.EXECUTING


def test_those_that_wait_are_told_once() -> None:
    kept = Kept("refuse")
    goal, _ = kept.take(1)
    told: list[Goal] = []
    assert kept.goals.wait_for(goal, told.append)
    kept.run()
    assert kept.goals.wait_for(goal, told.append)
    kept.goals.finish(goal, Fibonacci.Result())
    assert not kept.goals.wait_for(goal, told.append)
    for one, tell in kept.goals.take_waiting([goal]):
        tell(one)
    assert told == [goal, goal]
    assert kept.goals.take_waiting([goal]) == []


def test_so_many_may_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(goals, "MOST_WAITING", 2)
    kept = Kept("queue")
    goal, _ = kept.take(1)
    for _ in range(2):
        assert kept.goals.wait_for(goal, lambda _: None)
    with pytest.raises(Refused, match="2 clients wait"):
        kept.goals.wait_for(goal, lambda _: None)
    kept.cancel(1)
    kept.goals.take_waiting([goal])
    assert kept.goals.wait_for(kept.take(2)[0], lambda _: None)


def test_results_are_kept_for_a_time() -> None:
    kept = Kept("refuse")
    goal, _ = kept.take(1)
    kept.goals.finish(kept.run(), Fibonacci.Result())
    kept.time = RESULT_TIMEOUT
    assert kept.goals.find(ident(1)) is goal
    kept.time += 0.1
    assert kept.goals.find(ident(1)) is None
    for number in range(2, MOST_KEPT + 10):
        kept.take(number)
        kept.goals.finish(kept.run(), Fibonacci.Result())
    assert kept.goals.find(ident(2)) is None
    assert kept.goals.find(ident(MOST_KEPT)) is not None
    assert len(kept.states()) == goals.SHOWN


def test_a_server_that_closes_leaves_no_goal() -> None:
    kept = Kept("queue")
    running, _ = kept.take(1)
    waiting, _ = kept.take(2)
    kept.run()
    assert kept.goals.close("over") == [waiting]
    assert (waiting.state, waiting.message) == (GoalState.ABORTED, "over")
    assert running.is_to_be_told
    with pytest.raises(Refused, match="over"):
        kept.take(3)
    assert kept.goals.give_up("it hangs") is running
    assert (running.state, running.message) == (GoalState.ABORTED, "it hangs")
    assert kept.goals.give_up("again") is None
    assert not kept.goals.finish(running, Fibonacci.Result())


@given(st.sampled_from(["refuse", "queue", "preempt"]), st.integers(0, 2**32), st.booleans())
def test_whatever_happens_each_goal_ends_once(policy: Policy, seed: int, cancelable: bool) -> None:
    chance = random.Random(seed)
    kept = Kept(policy, cancelable=cancelable)
    taken: list[Goal] = []
    ended: list[Goal] = []
    running: Goal | None = None
    number = 0

    def note(some: list[Goal]) -> None:
        assert all(goal.state.is_terminal for goal in some)
        ended.extend(some)

    for _ in range(60):
        match chance.randrange(6):
            case 0 | 1:
                number += 1
                try:
                    goal, more = kept.take(number)
                except Refused:
                    continue
                taken.append(goal)
                note(more)
            case 2:
                note(kept.cancel(chance.choice([0, chance.randint(1, number + 1)]), chance.choice([0, number]))[2])
            case 3 if running is None:
                running = kept.goals.next()
            case 4 if running is not None and running.is_to_be_told:
                kept.goals.told(running)
            case 5 if running is not None:
                failure = chance.choice([None, None, "failed"])
                assert kept.goals.finish(running, Fibonacci.Result(), failure)
                note([running])
                running = None
    note(kept.goals.close("over"))
    last = kept.goals.give_up("over")
    assert last is running
    note([last] if last is not None else [])
    assert sorted(ended, key=id) == sorted(taken, key=id)
