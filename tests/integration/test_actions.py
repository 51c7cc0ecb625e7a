"""Actions: goals with feedback and a result, between nodes, and what becomes of them when something goes wrong."""

import threading
from collections.abc import Callable, Generator, Iterator
from typing import Annotated, Any

import msgpack
import pytest
import zenoh
from msgspec import Meta

import robo
from robo import (
    ActionClient,
    ActionError,
    ActionTimeout,
    GoalCanceled,
    GoalState,
    LifecycleNode,
    Node,
    Publisher,
    action,
    service,
    subscribe,
    timer,
)
from robo.errors import ContractError
from robo.node import goals
from robo.testing import Clock, RunNode, StillWaiting
from robo.wire import long_query
from robo.wire.discovery import wait_for_nodes
from robo.wire.goals import id_text, new_goal_id
from robo.wire.network import Network
from robo.wire.session import close_session, open_session
from robo_messages import Fibonacci, LaserScan, SetBool, String, Trigger
from tests.actions import Caller, settle
from tests.support import PATIENCE, eventually

Steps = Generator[Fibonacci.Feedback | None, None, Fibonacci.Result]
FAST = 1e6
"""A rate at which a handler goes on at once, Hz."""


class Inbox:
    """The messages of a key, as a plain client reads them."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self.messages: list[Any] = []
        self.encodings: set[str] = set()
        self._subscriber = session.declare_subscriber(key, self._take)

    def _take(self, sample: zenoh.Sample) -> None:
        self.encodings.add(str(sample.encoding))
        self.messages.append(msgpack.unpackb(sample.payload.to_bytes()))

    def wait_for(self, last: object) -> None:
        eventually(lambda: self.messages[-1:] == [last], f"{last} is the last message")

    def close(self) -> None:
        self._subscriber.undeclare()


class Counter(Node):
    """Counts as Fibonacci did."""

    class Parameters(robo.Parameters):
        rate: Annotated[float, Meta(gt=0)] = FAST

    parameters: Parameters
    log_of_ends = Publisher(String, "ends")

    def on_start(self) -> None:
        self.inside = 0
        self.ends: list[str] = []
        self.begun = threading.Event()

    def check(self, goal: Fibonacci.Goal) -> None:
        if goal.order < 0:
            raise ValueError("nobody counts backwards")

    @action("fibonacci", rate="rate", accept=check)
    def fibonacci(self, goal: Fibonacci.Goal) -> Steps:
        sequence = [0, 1]
        self.begun.set()
        try:
            for _ in range(goal.order):
                self.inside += 1
                assert self.inside == 1, "two callbacks at once"
                if len(sequence) == 15:
                    raise ValueError("15 brings bad luck")
                sequence.append(sequence[-1] + sequence[-2])
                self.inside -= 1
                yield Fibonacci.Feedback(sequence)
        except GoalCanceled as why:
            self.ends.append(str(why))
            return Fibonacci.Result(sequence)
        finally:
            self.log_of_ends.publish(String(str(len(sequence))))
        return Fibonacci.Result(sequence)

    @service("double")
    def double(self, request: SetBool.Request) -> SetBool.Response:
        assert self.inside == 0, "two callbacks at once"
        return SetBool.Response(success=not request.data)


LONG = 1_000_000
"""An order that no test waits for."""


@pytest.fixture
def caller(other: zenoh.Session) -> Iterator[Caller]:
    with Caller(namespace="r1", session=other) as made:
        yield made


def slow(session: zenoh.Session, rate: float = 20.0) -> Counter:
    """A counter that stays below what brings bad luck for half a second."""
    return Counter(namespace="r1", session=session, parameters={"rate": rate})


def test_a_goal_has_feedback_and_a_result(session: zenoh.Session, caller: Caller) -> None:
    told: list[list[int]] = []
    with slow(session, 100.0) as counter:
        result = caller.fibonacci(Fibonacci.Goal(5), lambda feedback: told.append(feedback.sequence), PATIENCE)
        assert result == Fibonacci.Result([0, 1, 1, 2, 3, 5, 8])
        eventually(lambda: len(told) == 5, "all feedback")
        assert told[0] == [0, 1, 1]
        assert caller.fibonacci(Fibonacci.Goal(0)).sequence == [0, 1]
        assert counter.status.callback_errors == caller.status.callback_errors == 0


def test_a_goal_is_canceled_and_says_how_far_it_came(session: zenoh.Session, caller: Caller) -> None:
    with slow(session) as counter:
        goal = caller.fibonacci.send_goal(Fibonacci.Goal(10))
        assert (goal.status, goal.done()) == (None, False)
        with pytest.raises(ActionTimeout, match=f"goal {goal.goal_id}: no result within 0.01 s"):
            goal.result(0.01)
        assert counter.begun.wait(PATIENCE)
        assert goal.cancel()
        with pytest.raises(ActionError, match=f"^action r1/fibonacci: goal {goal.goal_id}: canceled$") as error:
            goal.result(PATIENCE)
        assert error.value.status == goal.status == GoalState.CANCELED
        assert error.value.result.sequence[:2] == [0, 1]
        assert counter.ends == [""]
        assert not goal.cancel()
        assert goal.status == GoalState.CANCELED


def test_a_handler_that_raises_aborts_its_goal(session: zenoh.Session, caller: Caller) -> None:
    with Counter(namespace="r1", session=session) as counter:
        for _ in range(2):
            with pytest.raises(ActionError, match="aborted: ValueError: 15 brings bad luck") as error:
                caller.fibonacci(Fibonacci.Goal(20))
            assert error.value.status == GoalState.ABORTED
            counter.inside = 0
        assert counter.status.callback_errors == 2
        assert caller.fibonacci(Fibonacci.Goal(1)).sequence == [0, 1, 1]


def test_what_a_node_does_not_take_is_refused(session: zenoh.Session, caller: Caller) -> None:
    with slow(session) as counter:
        with pytest.raises(ActionError, match="action r1/fibonacci refuses the goal: nobody counts backwards"):
            caller.fibonacci(Fibonacci.Goal(-1))
        with pytest.raises(TypeError, match="takes example/Fibonacci_Goal, not Request"):
            caller.fibonacci(Trigger.Request())  # type: ignore[arg-type]
        goal = caller.fibonacci.send_goal(Fibonacci.Goal(10))
        with pytest.raises(ActionError, match=f"goal {goal.goal_id} is under way, and this action takes one at a time"):
            caller.fibonacci.send_goal(Fibonacci.Goal(10))
        assert goal.cancel()
        assert counter.status.callback_errors == 0


def test_nobody_executes_it_or_too_slowly(session: zenoh.Session, other: zenoh.Session) -> None:
    with Node(name="me", namespace="r1", session=other) as me:
        types = Caller(session=other).contract.action_clients[0].types
        fibonacci = me._make("test").action_client(types, "fibonacci", 0.2)
        with pytest.raises(ActionTimeout, match=r"action r1/fibonacci: there is no server \(waited 0.2 s\)"):
            fibonacci(Fibonacci.Goal(1))
        assert not fibonacci.wait_for_server(0.01)
        with slow(session) as counter:
            assert fibonacci.wait_for_server(PATIENCE)
            with counter._turns.own, pytest.raises(ActionTimeout, match=r"its server did not answer within 0.2 s"):
                fibonacci(Fibonacci.Goal(1))
            eventually(lambda: last_status(counter) == GoalState.CANCELED, "a goal that nobody waits for is canceled")


def last_status(node: Node) -> int:
    """How far the goal that came last has come."""
    told = node._ends.actions[0]._goals.status().status_list
    return told[-1].status if told else GoalState.UNKNOWN


def test_a_call_that_takes_too_long_cancels_its_goal(session: zenoh.Session, caller: Caller) -> None:
    with slow(session) as counter:
        with pytest.raises(ActionTimeout, match=r"no result within 0.05 s"):
            caller.fibonacci(Fibonacci.Goal(12), timeout=0.05)
        eventually(lambda: last_status(counter) == GoalState.CANCELED, "the goal is canceled")


class Queue(Node):
    """Takes one after the other."""

    @action("fibonacci", policy="queue", rate=FAST)
    def fibonacci(self, goal: Fibonacci.Goal) -> Steps:
        yield Fibonacci.Feedback([goal.order])
        return Fibonacci.Result([goal.order])


class Preempt(Node):
    """Takes the newest."""

    @action("fibonacci", policy="preempt", rate=50.0)
    def fibonacci(self, goal: Fibonacci.Goal) -> Steps:
        for _ in range(goal.order):
            yield None
        return Fibonacci.Result([goal.order])


def test_queued_goals_run_in_order(session: zenoh.Session, caller: Caller) -> None:
    order: list[int] = []
    with Queue(namespace="r1", session=session) as server:
        with server._turns.own:
            sent = [caller.fibonacci.send_goal(Fibonacci.Goal(n), lambda f: order.extend(f.sequence)) for n in range(9)]
            assert sent[4].cancel()
        for n, goal in enumerate(sent):
            if n == 4:
                with pytest.raises(ActionError, match="canceled"):
                    goal.result(PATIENCE)
            else:
                assert goal.result(PATIENCE).sequence == [n]
        eventually(lambda: len(order) == 8, "all feedback")
        assert order == [0, 1, 2, 3, 5, 6, 7, 8]


def test_a_new_goal_preempts_the_old_one(session: zenoh.Session, caller: Caller) -> None:
    with Preempt(namespace="r1", session=session):
        old = caller.fibonacci.send_goal(Fibonacci.Goal(LONG))
        new = caller.fibonacci.send_goal(Fibonacci.Goal(1))
        assert new.result(PATIENCE).sequence == [1]
        with pytest.raises(ActionError, match=f"aborted: preempted by goal {new.goal_id}"):
            old.result(PATIENCE)


def test_a_method_that_yields_nothing_is_an_action_too(session: zenoh.Session, caller: Caller) -> None:
    class Quick(Node):
        entered, free = threading.Event(), threading.Event()

        @action("fibonacci")
        def fibonacci(self, goal: Fibonacci.Goal) -> Fibonacci.Result:
            self.entered.set()
            assert self.free.wait(PATIENCE)
            return Fibonacci.Result([goal.order])

    with Quick(namespace="r1", session=session) as node:
        goal = caller.fibonacci.send_goal(Fibonacci.Goal(3))
        assert node.entered.wait(PATIENCE)
        with pytest.raises(ActionError, match="its server does not cancel it"):
            goal.cancel()
        node.free.set()
        assert goal.result(PATIENCE).sequence == [3]


def test_a_node_that_stops_aborts_its_goals(session: zenoh.Session, caller: Caller) -> None:
    ends = Inbox(caller.session, "r1/ends")
    with slow(session) as counter:
        goal = caller.fibonacci.send_goal(Fibonacci.Goal(LONG))
        assert counter.begun.wait(PATIENCE)
        assert not goal.done()
        settle(caller)
    with pytest.raises(ActionError, match="aborted: its node is stopping") as error:
        goal.result(PATIENCE)
    assert error.value.status == GoalState.ABORTED
    assert counter.ends == ["its node is stopping"]
    eventually(lambda: len(ends.messages) == 1, "its handler could put things in order")
    ends.close()


def test_a_handler_that_hangs_is_given_up(session: zenoh.Session, caller: Caller) -> None:
    entered, free = threading.Event(), threading.Event()

    class Hanging(Node):
        @action("fibonacci")
        def fibonacci(self, goal: Fibonacci.Goal) -> Steps:
            entered.set()
            free.wait(PATIENCE)
            yield Fibonacci.Feedback()
            return Fibonacci.Result([goal.order])

    node = Hanging(namespace="r1", session=session)
    node.start()
    goal = caller.fibonacci.send_goal(Fibonacci.Goal(1))
    assert entered.wait(PATIENCE)
    settle(caller)
    node.close(timeout=0.1)
    with pytest.raises(ActionError, match="aborted: its node has stopped without waiting for it"):
        goal.result(PATIENCE)
    free.set()
    eventually(lambda: not any(t.name == "robo-r1/fibonacci" for t in threading.enumerate()), "its thread ends")


def test_a_server_that_goes_away_is_told(caller: Caller, endpoint: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(long_query, "GRACE", 0.3)
    leaving = open_session(Network(mode="client", connect=(endpoint,)))
    server = slow(leaving)
    server.start()
    goal = caller.fibonacci.send_goal(Fibonacci.Goal(LONG))
    close_session(leaving)
    with pytest.raises(ActionError, match="its server has gone, and what became of the goal is not known") as error:
        goal.result(PATIENCE)
    assert error.value.status == goal.status == GoalState.UNKNOWN
    server.close()


def test_a_server_that_has_started_again_does_not_know_the_goal(
    session: zenoh.Session, caller: Caller, endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(long_query, "GRACE", PATIENCE)
    leaving = open_session(Network(mode="client", connect=(endpoint,)))
    server = slow(leaving)
    server.start()
    goal = caller.fibonacci.send_goal(Fibonacci.Goal(LONG))
    close_session(leaving)
    with slow(session), pytest.raises(ActionError, match="its server has started again and does not know it"):
        goal.result(PATIENCE)
    server.close()


def test_a_client_that_stops_cancels_what_it_waits_for(session: zenoh.Session, other: zenoh.Session) -> None:
    class Commander(Caller):
        told = ""

        @timer(rate=100.0)
        def command(self) -> None:
            try:
                self.fibonacci(Fibonacci.Goal(LONG))
            except ActionError as error:
                self.told = str(error)
                self.shutdown()

    with slow(session, 5.0) as counter:
        with Commander(namespace="r1", session=other) as commander:
            eventually(lambda: counter.begun.is_set() or commander.told != "", "the goal is under way")
            assert not commander.told
        eventually(lambda: counter.ends == [""], "the goal is canceled")


def test_a_main_that_waits_for_a_result_ends_with_its_node_at_once(
    session: zenoh.Session, other: zenoh.Session
) -> None:
    class Commander(Caller):
        def main(self) -> None:
            self.fibonacci(Fibonacci.Goal(LONG))

    with slow(session, 5.0) as counter:
        with Commander(namespace="r1", session=other) as commander:
            assert counter.begun.wait(PATIENCE)
        assert (commander.exit_code, commander.status.callback_errors) == (0, 0)
        eventually(lambda: counter.ends == [""], "the goal is canceled")


def test_an_action_may_stand_in_any_callback(session: zenoh.Session, other: zenoh.Session) -> None:
    """Also in that of the node that executes it, and in the handler of another action."""

    class Both(Counter):
        again = ActionClient(Fibonacci.Goal, Fibonacci.Result, Fibonacci.Feedback, "fibonacci")

        @action("~/twice", rate=FAST)
        def twice(self, goal: Fibonacci.Goal) -> Steps:
            first = self.again(goal)
            yield Fibonacci.Feedback(first.sequence)
            return self.again(goal)

    types = Both(session=session).contract.action_clients[0].types
    with Both(namespace="r1", session=session), Node(name="me", namespace="r1", session=other) as me:
        twice = me._make("test").action_client(types, "both/twice", PATIENCE)
        assert twice(Fibonacci.Goal(3), timeout=PATIENCE).sequence == [0, 1, 1, 2, 3]


def test_other_callbacks_run_between_two_steps(session: zenoh.Session, other: zenoh.Session) -> None:
    with slow(session, 10.0), Caller(namespace="r1", session=other) as caller:
        double = caller.create_client(SetBool.Request, SetBool.Response, "double", PATIENCE)
        goal = caller.fibonacci.send_goal(Fibonacci.Goal(12))
        for _ in range(20):
            assert double(SetBool.Request()).success
        assert not goal.done(), "the calls have not waited for the goal"
        assert goal.cancel()


def plain(session: zenoh.Session, part: str, request: object, key: str = "r1/fibonacci/_action/") -> Any:
    """What a plain client gets: the answer, or the kind of the error."""
    payload = request if isinstance(request, bytes) else msgpack.packb(request)
    (reply,) = session.get(key + part, payload=payload, timeout=PATIENCE)
    if reply.ok is not None:
        assert str(reply.ok.key_expr) == key + part
        return msgpack.unpackb(reply.ok.payload.to_bytes())
    return msgpack.unpackb(reply.err.payload.to_bytes())["error"] if reply.err is not None else None


def test_any_client_sends_goals(session: zenoh.Session, other: zenoh.Session) -> None:
    feedback, status = Inbox(other, "r1/fibonacci/_action/feedback"), Inbox(other, "r1/fibonacci/_action/status")
    with Counter(namespace="r1", session=session):
        assert not wait_for_nodes(other, ["/r1/counter"], PATIENCE)
        goal_id = {"uuid": new_goal_id()}
        answer = plain(other, "send_goal", {"goal_id": goal_id, "goal": {"order": 3}})
        assert (answer["accepted"], answer["message"]) == (True, "")
        result = plain(other, "get_result", {"goal_id": goal_id})
        assert result == {"status": 4, "result": {"sequence": [0, 1, 1, 2, 3]}, "message": ""}
        feedback.wait_for({"goal_id": goal_id, "feedback": {"sequence": [0, 1, 1, 2, 3]}})
        assert len(feedback.messages) == 3
        assert feedback.encodings == {"application/msgpack;example/Fibonacci_FeedbackMessage"}
        ended = {"goal_info": {"goal_id": goal_id, "stamp": answer["stamp"]}, "status": 4}
        status.wait_for({"status_list": [ended]})
        assert status.encodings == {"application/msgpack;action/GoalStatusArray"}

        again = plain(other, "send_goal", {"goal_id": goal_id, "goal": {"order": 3}})
        assert (again["accepted"], "each has an id of its own" in again["message"]) == (False, True)
        as_json = b'{"goal_id": {"uuid": "AAAAAAAAAAAAAAAAAAAAAQ=="}, "goal": {"order": 1}}'
        assert plain(other, "send_goal", as_json)["accepted"]
        assert plain(other, "get_result", {"goal_id": {"uuid": bytes(15) + b"\1"}})["result"] == {"sequence": [0, 1, 1]}
        assert plain(other, "get_result", {"goal_id": {"uuid": b"x" * 16}})["status"] == 0
        assert plain(other, "cancel_goal", {"goal_info": {"goal_id": goal_id}}) == {
            "return_code": 3,
            "goals_canceling": [],
        }
        for part in ("send_goal", "get_result", "cancel_goal"):
            for wrong in (b"\xff", {"goal_id": "x"}, {"goal_id": {"uuid": b"short"}}, {"goal_info": 1}):
                assert plain(other, part, wrong) == "Malformed"
    feedback.close()
    status.close()


def test_a_query_with_wildcards_begins_and_cancels_nothing(session: zenoh.Session, other: zenoh.Session) -> None:
    with slow(session) as counter:
        assert not wait_for_nodes(other, ["/r1/counter"], PATIENCE)
        request = {"goal_id": {"uuid": new_goal_id()}, "goal": {"order": 100}}
        for wide in ("**", "r1/**", "r1/fibonacci/**", "r1/*/_action/send_goal", "r1/fibonacci/_action/*"):
            replies = list(other.get(wide, payload=msgpack.packb(request), timeout=PATIENCE))
            kinds = [msgpack.unpackb(r.err.payload.to_bytes())["error"] for r in replies if r.err is not None]
            assert "TooWide" in kinds, wide
        assert counter._ends.actions[0].taken == 0
        assert plain(other, "send_goal", request)["accepted"]
        for wide in ("**", "r1/fibonacci/_action/*"):
            list(other.get(wide, payload=b"\x80", timeout=PATIENCE))
        assert counter.ends == []


def test_a_result_may_be_asked_for_late_and_not_for_ever(
    session: zenoh.Session, other: zenoh.Session, caller: Caller, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(goals, "MOST_KEPT", 2)
    with Counter(namespace="r1", session=session):
        sent = []
        for _ in range(5):
            sent.append(caller.fibonacci.send_goal(Fibonacci.Goal(0)))
            assert sent[-1].result(PATIENCE).sequence == [0, 1]
        assert plain(other, "get_result", {"goal_id": {"uuid": sent[-1].id}})["status"] == 4
        assert plain(other, "get_result", {"goal_id": {"uuid": sent[0].id}})["status"] == 0


def test_what_a_handler_yields_is_of_its_type(session: zenoh.Session, caller: Caller) -> None:
    class Wrong(Node):
        @action("fibonacci")
        def fibonacci(self, goal: Fibonacci.Goal) -> Steps:
            if goal.order:
                yield String()  # type: ignore[misc]
            return LaserScan()  # type: ignore[return-value]

    with Wrong(namespace="r1", session=session):
        with pytest.raises(ActionError, match="aborted: TypeError: the handler yielded String, not Feedback"):
            caller.fibonacci(Fibonacci.Goal(1))
        with pytest.raises(ActionError, match="aborted: TypeError: the handler returned LaserScan, not Result"):
            caller.fibonacci(Fibonacci.Goal(0))


# Handlers that are never called: only their signatures are looked at.


def _no_types(self: Any, goal: Any) -> Steps:
    raise NotImplementedError


def _no_goal(self: Any, goal: String) -> Steps:
    raise NotImplementedError


def _no_result(self: Any, goal: Fibonacci.Goal) -> Fibonacci.Feedback:
    raise NotImplementedError


def _other_feedback(self: Any, goal: Fibonacci.Goal) -> Generator[String, None, Fibonacci.Result]:
    raise NotImplementedError


def _fine(self: Any, goal: Fibonacci.Goal) -> Steps:
    raise NotImplementedError


@pytest.mark.parametrize(
    ("method", "options", "text"),
    [
        (_no_types, {}, "Any is no message type"),
        (_no_goal, {}, "std/String is no goal of an action; the name of such a type ends with _Goal"),
        (_no_result, {}, r"annotate what it returns: Generator\[Fibonacci.Feedback, None, Fibonacci.Result\], or"),
        (_other_feedback, {}, r"annotate what it returns"),
        (_fine, {"rate": "speed"}, r"@action\(rate='speed'\) names no parameter of this node"),
        (_fine, {"accept": _no_goal}, r"accept=_no_goal is no method of Wrong"),
    ],
)
def test_a_class_says_clearly_what_it_executes(method: Callable[..., Any], options: dict[str, Any], text: str) -> None:
    with pytest.raises(ContractError, match=text):
        type("Wrong", (Node,), {"run": action("fibonacci", **options)(method)})()


def test_policies_and_rates_are_known() -> None:
    with pytest.raises(ContractError, match="action 'a': the policy 'all': use one of refuse, queue, preempt"):
        action("a", policy="all")  # type: ignore[arg-type]
    with pytest.raises(ContractError, match="rate of 0"):
        action("a", rate=0)


class Dock(Node):
    """Under the clock of a test."""

    def on_start(self) -> None:
        self.heard = 0

    @action("fibonacci", rate=2.0)
    def dock(self, goal: Fibonacci.Goal) -> Steps:
        for step in range(goal.order):
            if step == 5:
                raise ValueError("it is stuck")
            yield Fibonacci.Feedback([step, self.heard])
        return Fibonacci.Result([self.heard])

    @subscribe("words")
    def listen(self, _word: String) -> None:
        self.heard += 1


def test_the_clock_of_a_test_steps_a_handler(run_node: RunNode, clock: Clock) -> None:
    node = run_node(Dock)
    goal = node.send_goal("fibonacci", Fibonacci.Goal(3))
    assert (goal.status, [f.sequence for f in goal.feedback]) == (GoalState.EXECUTING, [[0, 0]])
    with pytest.raises(StillWaiting, match=r"has not ended; let time pass.*robo-fibonacci for 0\.5 s"):
        goal.result()
    clock.advance(0.49)
    assert len(goal.feedback) == 1
    node.send("words", String())
    clock.advance(0.01)
    assert [f.sequence for f in goal.feedback] == [[0, 0], [1, 1]]
    clock.advance(1.0)
    assert (goal.status, goal.result()) == (GoalState.SUCCEEDED, Fibonacci.Result([1]))
    assert not goal.cancel()


def test_a_test_cancels_and_is_refused(run_node: RunNode, clock: Clock) -> None:
    node = run_node(Dock)
    goal = node.send_goal("fibonacci", Fibonacci.Goal(3))
    with pytest.raises(ActionError, match="takes one at a time"):
        node.send_goal("fibonacci", Fibonacci.Goal(3))
    clock.advance(0.25)
    assert goal.cancel()
    assert goal.status == GoalState.CANCELED
    with pytest.raises(ActionError, match="canceled") as error:
        goal.result()
    assert error.value.result == Fibonacci.Result()
    stuck = node.send_goal("fibonacci", Fibonacci.Goal(9))
    with pytest.raises(ValueError, match="it is stuck"):
        clock.advance(10.0)
    assert stuck.status == GoalState.ABORTED
    with pytest.raises(ActionError, match="aborted: ValueError: it is stuck"):
        stuck.result()
    with pytest.raises(AssertionError, match="has no action dok"):
        node.send_goal("dok", Fibonacci.Goal())


class Commander(Node):
    """Sends a goal when it is told to."""

    fibonacci = ActionClient(Fibonacci.Goal, Fibonacci.Result, Fibonacci.Feedback, "fibonacci")
    said = Publisher(String, "said")

    @subscribe("orders")
    def on_order(self, order: String) -> None:
        try:
            result = self.fibonacci(Fibonacci.Goal(int(order.data)), self.on_feedback, timeout=3.0)
            self.said.publish(String(f"{result.sequence} at {self.clock.monotonic():g}"))
        except ActionError as error:
            self.said.publish(String(str(error).rpartition(": ")[2]))

    def on_feedback(self, feedback: Fibonacci.Feedback) -> None:
        self.said.publish(String(f"{feedback.sequence}"))


def test_two_nodes_under_one_clock(run_node: RunNode, clock: Clock) -> None:
    server, node = run_node(Dock), run_node(Commander)
    node.send("orders", String("2"))
    clock.advance(2.0)
    assert [one.data for one in node.published("said")] == ["[0, 0]", "[1, 0]", "[0] at 1"]
    node.clear()
    node.send("orders", String("4"))
    clock.advance(0.1)
    server.close()
    clock.advance(3.0)
    assert [one.data for one in node.published("said")] == ["[0, 0]", "its node is stopping"]


def test_a_goal_takes_too_long_by_the_clock_of_the_test(run_node: RunNode, clock: Clock) -> None:
    class Sleepy(Node):
        @action("fibonacci", rate=0.1)
        def fibonacci(self, goal: Fibonacci.Goal) -> Steps:
            yield None
            return Fibonacci.Result([goal.order])

    run_node(Sleepy)
    node = run_node(Commander)
    node.send("orders", String("2"))
    clock.advance(2.9)
    assert node.published("said") == []
    clock.advance(0.2)
    assert [one.data for one in node.published("said")] == ["no result within 3 s"]


def test_a_managed_node_takes_goals_while_it_is_active(run_node: RunNode, clock: Clock) -> None:
    class Managed(LifecycleNode):
        @action("fibonacci", rate=2.0)
        def fibonacci(self, goal: Fibonacci.Goal) -> Steps:
            for step in range(goal.order):
                yield Fibonacci.Feedback([step])
            return Fibonacci.Result()

    node = run_node(Managed)
    goal = node.send_goal("fibonacci", Fibonacci.Goal(3))
    clock.advance(0.6)
    assert node.change_state("deactivate")
    with pytest.raises(ActionError, match="aborted: its node is deactivating"):
        goal.result()
    assert [told.sequence for told in goal.feedback] == [[0], [1]]
    with pytest.raises(ActionError, match="refuses the goal: its node is inactive"):
        node.send_goal("fibonacci", Fibonacci.Goal(3))
    assert node.change_state("activate")
    again = node.send_goal("fibonacci", Fibonacci.Goal(0))
    assert again.result() == Fibonacci.Result()


def test_ids_are_written_as_uuids() -> None:
    assert id_text(bytes(range(16))) == "00010203-0405-0607-0809-0a0b0c0d0e0f"
