"""Actions whose handler is async: it tells feedback by a function, and is cancelled where it awaits."""

import asyncio
import threading
from collections.abc import AsyncGenerator, Callable
from typing import Any

import pytest
import zenoh

from robo import ActionError, GoalState, LifecycleNode, Node, action, service
from robo.errors import ContractError
from robo.testing import Clock, RunNode, StillWaiting
from robo_messages import Fibonacci, String, Trigger
from tests.actions import Caller, settle
from tests.support import PATIENCE, eventually

Tell = Callable[[Fibonacci.Feedback], None]
LONG = 1_000_000


class Counter(Node):
    """Counts as Fibonacci did, and lets others run in between."""

    def on_start(self) -> None:
        self.begun = threading.Event()
        self.inside = 0
        self.ends: list[str] = []

    @action("fibonacci")
    async def fibonacci(self, goal: Fibonacci.Goal, feedback: Tell) -> Fibonacci.Result:
        sequence = [0, 1]
        try:
            for _ in range(goal.order):
                self.inside += 1
                assert self.inside == 1, "two callbacks at once"
                sequence.append(sequence[-1] + sequence[-2])
                feedback(Fibonacci.Feedback(sequence))
                self.inside -= 1
                self.begun.set()
                await asyncio.sleep(0.01 if goal.order == LONG else 0)
        except asyncio.CancelledError:
            self.ends.append(f"at {len(sequence)}")
            del sequence[2:]
        return Fibonacci.Result(sequence)

    @service("look")
    def look(self, _request: Trigger.Request) -> Trigger.Response:
        assert self.inside == 0, "two callbacks at once"
        return Trigger.Response(success=True)


@pytest.fixture
def caller(other: zenoh.Session) -> Caller:
    return Caller(namespace="r1", session=other)


def test_a_goal_has_feedback_and_a_result(session: zenoh.Session, caller: Caller) -> None:
    told: list[list[int]] = []
    with Counter(namespace="r1", session=session), caller:
        result = caller.fibonacci(Fibonacci.Goal(4), lambda so_far: told.append(so_far.sequence), timeout=PATIENCE)
        eventually(lambda: len(told) == 4, "all feedback has come")
    assert result.sequence == [0, 1, 1, 2, 3, 5]
    assert told == [[0, 1, 1], [0, 1, 1, 2], [0, 1, 1, 2, 3], [0, 1, 1, 2, 3, 5]]


def test_it_is_cancelled_where_it_awaits_and_others_run_meanwhile(session: zenoh.Session, caller: Caller) -> None:
    look = None
    with Counter(namespace="r1", session=session) as counter, caller:
        look = caller.create_client(Trigger.Request, Trigger.Response, "look", timeout=PATIENCE)
        sent = caller.fibonacci.send_goal(Fibonacci.Goal(LONG))
        assert counter.begun.wait(PATIENCE)
        assert all(look(Trigger.Request()).success for _ in range(20))
        assert sent.cancel()
        with pytest.raises(ActionError, match="canceled") as error:
            sent.result(PATIENCE)
        assert (error.value.status, error.value.result) == (GoalState.CANCELED, Fibonacci.Result([0, 1]))
        assert len(counter.ends) == 1
        assert not sent.cancel()
        assert caller.fibonacci(Fibonacci.Goal(1), timeout=PATIENCE).sequence == [0, 1, 1]


def test_a_node_that_stops_cancels_it(session: zenoh.Session, caller: Caller) -> None:
    with caller:
        with Counter(namespace="r1", session=session) as counter:
            sent = caller.fibonacci.send_goal(Fibonacci.Goal(LONG))
            assert counter.begun.wait(PATIENCE)
            settle(caller)
        with pytest.raises(ActionError, match="its node is stopping") as error:
            sent.result(PATIENCE)
        assert error.value.status == GoalState.ABORTED
        assert len(counter.ends) == 1


def test_a_new_goal_preempts_the_old_one_which_lets_it_pass(session: zenoh.Session, caller: Caller) -> None:
    class Preempt(Node):
        @action("fibonacci", policy="preempt")
        async def fibonacci(self, goal: Fibonacci.Goal) -> Fibonacci.Result:
            await asyncio.sleep(goal.order)
            return Fibonacci.Result([goal.order])

    with Preempt(namespace="r1", session=session), caller:
        first = caller.fibonacci.send_goal(Fibonacci.Goal(LONG))
        assert caller.fibonacci(Fibonacci.Goal(0), timeout=PATIENCE).sequence == [0]
        with pytest.raises(ActionError, match="aborted: preempted by goal"):
            first.result(PATIENCE)


def test_what_goes_wrong_aborts_the_goal_and_the_node_goes_on(session: zenoh.Session, caller: Caller) -> None:
    class Wrong(Node):
        @action("fibonacci")
        async def fibonacci(self, goal: Fibonacci.Goal, feedback: Tell) -> Fibonacci.Result:
            if goal.order == 1:
                feedback(String())  # type: ignore[arg-type]
            if goal.order == 2:
                raise ValueError("it is stuck")
            if goal.order == 3:
                raise asyncio.CancelledError
            return None  # type: ignore[return-value]

    with Wrong(namespace="r1", session=session), caller:
        for order, why in (
            (1, "aborted: TypeError: the handler tells String, not Feedback"),
            (2, "aborted: ValueError: it is stuck"),
            (3, "aborted: its handler has given it up"),
            (0, "aborted: TypeError: the handler returned NoneType, not Result"),
        ):
            with pytest.raises(ActionError, match=why):
                caller.fibonacci(Fibonacci.Goal(order), timeout=PATIENCE)


class Dock(Node):
    """Under the clock of a test."""

    @action("dock")
    async def dock(self, goal: Fibonacci.Goal, feedback: Tell) -> Fibonacci.Result:
        for step in range(goal.order):
            feedback(Fibonacci.Feedback([step]))
            await asyncio.sleep(0.5)
        return Fibonacci.Result([goal.order])


def test_the_clock_of_a_test_lets_it_go_on(run_node: RunNode, clock: Clock) -> None:
    goal = run_node(Dock).send_goal("dock", Fibonacci.Goal(3))
    assert (goal.status, [f.sequence for f in goal.feedback]) == (GoalState.EXECUTING, [[0]])
    with pytest.raises(StillWaiting, match="has not ended; let time pass"):
        goal.result()
    clock.advance(0.6)
    assert [f.sequence for f in goal.feedback] == [[0], [1]]
    clock.advance(1.0)
    assert (goal.status, goal.result()) == (GoalState.SUCCEEDED, Fibonacci.Result([3]))


def test_a_test_cancels_it(run_node: RunNode, clock: Clock) -> None:
    node = run_node(Dock)
    goal = node.send_goal("dock", Fibonacci.Goal(3))
    clock.advance(0.25)
    assert goal.cancel()
    assert goal.status == GoalState.CANCELED
    assert node.send_goal("dock", Fibonacci.Goal(0)).result() == Fibonacci.Result([0])


def test_a_managed_node_that_leaves_active_cancels_it(run_node: RunNode, clock: Clock) -> None:
    class Managed(LifecycleNode):
        @action("dock")
        async def dock(self, goal: Fibonacci.Goal) -> Fibonacci.Result:
            await asyncio.sleep(goal.order)
            return Fibonacci.Result()

    node = run_node(Managed)
    goal = node.send_goal("dock", Fibonacci.Goal(100))
    clock.advance(0.6)
    assert node.change_state("deactivate")
    with pytest.raises(ActionError, match="aborted: its node is deactivating"):
        goal.result()
    assert node.change_state("activate")
    assert node.send_goal("dock", Fibonacci.Goal(0)).result() == Fibonacci.Result()


# Handlers that are never called: only their signatures are looked at.


async def _yields(self: Any, goal: Fibonacci.Goal) -> AsyncGenerator[Fibonacci.Feedback]:
    del self, goal
    yield Fibonacci.Feedback()


async def _other_feedback(self: Any, goal: Fibonacci.Goal, feedback: Callable[[String], None]) -> Fibonacci.Result:
    raise NotImplementedError


async def _no_type(self: Any, goal: Fibonacci.Goal, feedback) -> Fibonacci.Result:  # type: ignore[no-untyped-def]
    raise NotImplementedError


def _plain(self: Any, goal: Fibonacci.Goal, feedback: Tell) -> Fibonacci.Result:
    raise NotImplementedError


@pytest.mark.parametrize(
    ("method", "text"),
    [
        (_yields, "is async and yields; let it take a function beside the goal"),
        (_other_feedback, r"feedback: Callable\[\[Fibonacci.Feedback\], None\]"),
        (_no_type, "action's method takes self and the goal"),
        (_plain, "an async one may take, to tell how far it is"),
    ],
)
def test_a_class_says_clearly_what_it_executes(method: Callable[..., Any], text: str) -> None:
    with pytest.raises(ContractError, match=text):
        type("Wrong", (Node,), {"run": action("fibonacci")(method)})()
