"""A thousand goals, and ends that are killed: each goal ends once on both sides, and nothing is left."""

import json
import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Generator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgpack
import pytest
import zenoh

from robo import ActionClient, ActionError, GoalState, Node, action
from robo.node import goals
from robo.tools import actions, offers
from robo.wire.goals import id_text
from robo.wire.network import Network
from robo.wire.session import close_session, open_session
from robo_messages import Fibonacci
from tests.support import PATIENCE, eventually, plain_environment

CLIENTS, GOALS, MOST = 8, 1_000, 240.0


class Server(Node):
    """Takes some steps for each goal."""

    @action("fibonacci", policy="queue", rate=2_000.0)
    def fibonacci(self, goal: Fibonacci.Goal) -> Generator[Fibonacci.Feedback, None, Fibonacci.Result]:
        for step in range(goal.order):
            if step == 3 and goal.order == 5:
                raise ValueError("five are too many")
            yield Fibonacci.Feedback([step])
        return Fibonacci.Result([goal.order])


class Client(Node):
    fibonacci = ActionClient(Fibonacci.Goal, Fibonacci.Result, Fibonacci.Feedback, "fibonacci", timeout=MOST)


class Ledger:
    """What the network is told of each goal, in order, as a plain client hears it."""

    def __init__(self, session: zenoh.Session) -> None:
        self.states: dict[str, list[int]] = {}
        self._subscriber = session.declare_subscriber("r1/fibonacci/_action/status", self._take)

    def _take(self, sample: zenoh.Sample) -> None:
        for one in msgpack.unpackb(sample.payload.to_bytes())["status_list"]:
            told = self.states.setdefault(id_text(one["goal_info"]["goal_id"]["uuid"]), [])
            if told[-1:] != [one["status"]]:
                told.append(one["status"])

    def ended(self) -> dict[str, list[int]]:
        """The terminal states of each goal."""
        return {name: [state for state in told if state >= GoalState.SUCCEEDED] for name, told in self.states.items()}

    def close(self) -> None:
        self._subscriber.undeclare()


def send(client: Client, seed: int, count: int) -> list[tuple[str, GoalState]]:
    """Send goals one after the other, cancel some of them, and tell how each has ended."""
    chance = random.Random(seed)
    told = []
    for _ in range(count):
        goal = client.fibonacci.send_goal(Fibonacci.Goal(chance.randint(0, 5)))
        if chance.random() < 0.4:
            time.sleep(chance.random() * 0.005)
            goal.cancel()
        with suppress(ActionError):
            goal.result(MOST)
        status = goal.status
        assert status is not None
        told.append((goal.goal_id, status))
    return told


def threads_of(part: str) -> list[str]:
    return [thread.name for thread in threading.enumerate() if part in thread.name]


@pytest.mark.timeout(300)
def test_a_thousand_goals_of_eight_clients_with_random_cancels(
    session: zenoh.Session, endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(goals, "SHOWN", 50)  # whoever falls behind hears of each end several times
    monkeypatch.setattr(goals, "RESULT_TIMEOUT", 2 * MOST)
    ledger = Ledger(session)
    sessions = [open_session(Network(mode="peer", connect=(endpoint,))) for _ in range(2)]
    clients = [Client(name=f"client_{n}", namespace="r1", session=sessions[n % 2]) for n in range(CLIENTS)]
    with Server(namespace="r1", session=session) as server, ThreadPoolExecutor(CLIENTS) as pool:
        for client in clients:
            client.start()
        work = [pool.submit(send, client, seed, GOALS // CLIENTS) for seed, client in enumerate(clients)]
        by_client = dict(one for sent in work for one in sent.result(MOST))
        assert len(by_client) == GOALS
        own: dict[str, Any] = {id_text(one.id): one for one in server._ends.actions[0]._goals._goals.values()}
        assert {name: one.state for name, one in own.items()} == by_client
        assert not any(one.waiting for one in own.values())
        assert server._ends.actions[0]._goals._waiters == 0
        assert all(not client._ends.action_clients[0]._under_way for client in clients)
        eventually(lambda: len(ledger.ended()) == GOALS and all(ledger.ended().values()), "all ends are told")
        assert ledger.ended() == {name: [status] for name, status in by_client.items()}
        assert set(Counter(by_client.values())) == {GoalState.SUCCEEDED, GoalState.CANCELED, GoalState.ABORTED}
        for client in clients:
            client.close()
    ledger.close()
    for one in sessions:
        close_session(one)
    assert threads_of("fibonacci") == []


SERVER = """
import sys
from tests.integration.test_actions_many import Client, Fibonacci, Server
from robo.wire.network import Network
from robo.wire.session import open_session

session = open_session(Network(mode="peer", connect=(sys.argv[1],)))
"""
SERVES = "node = Server(namespace='r1', session=session)\nnode.start()\nprint('ready', flush=True)\nnode.wait()\n"
SENDS = """
node = Client(namespace='r1', session=session)
node.start()
goals = [node.fibonacci.send_goal(Fibonacci.Goal(10_000 if n == 0 else 1)) for n in range(5)]
print(*[goal.goal_id for goal in goals], flush=True)
node.wait()
"""


def program(text: str, endpoint: str) -> "subprocess.Popen[str]":
    command = [sys.executable, "-c", SERVER + text, endpoint]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=plain_environment())


def first_line(process: "subprocess.Popen[str]") -> str:
    assert process.stdout is not None
    return process.stdout.readline()


@pytest.mark.timeout(200)
def test_a_server_that_is_killed_in_the_middle(session: zenoh.Session, endpoint: str) -> None:
    process = program(SERVES, endpoint)
    try:
        assert first_line(process) == "ready\n"
        with Client(namespace="r1", session=session) as client:
            assert client.fibonacci(Fibonacci.Goal(1), timeout=PATIENCE).sequence == [1]
            sent = [client.fibonacci.send_goal(Fibonacci.Goal(100_000)) for _ in range(5)]
            os.kill(process.pid, signal.SIGKILL)
            for goal in sent:
                with pytest.raises(ActionError, match="its server has gone, and what became of the goal is not known"):
                    goal.result(PATIENCE)
                assert goal.status == GoalState.UNKNOWN
            assert not client._ends.action_clients[0]._under_way
            with Server(namespace="r1", session=session):
                assert client.fibonacci(Fibonacci.Goal(2), timeout=PATIENCE).sequence == [2]
    finally:
        process.kill()
        process.communicate()


@pytest.mark.timeout(200)
def test_a_client_that_is_killed_in_the_middle(
    session: zenoh.Session, endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(goals, "SHOWN", 100)
    ledger = Ledger(session)
    with Server(namespace="r1", session=session) as server, Client(namespace="r1", session=session) as client:
        process = program(SENDS, endpoint)
        try:
            ids = first_line(process).split()
            assert len(ids) == 5
            os.kill(process.pid, signal.SIGKILL)
        finally:
            process.kill()
            process.communicate()
        own = server._ends.actions[0]._goals
        mine = client.fibonacci.send_goal(Fibonacci.Goal(1))
        running = next(one for one in own._goals.values() if one.state == GoalState.EXECUTING)
        own.cancel(running.info)
        server._ends.actions[0]._wake()
        assert mine.result(PATIENCE).sequence == [1]
        eventually(lambda: all(ledger.ended().get(name) for name in ids), "the goals of the dead client end")
        assert [ledger.ended()[name] for name in ids] == [[GoalState.CANCELED], *[[GoalState.SUCCEEDED]] * 4]
        assert own._waiters == 0
    ledger.close()
    assert threads_of("fibonacci") == []


def test_a_plain_client_counts_as_the_page_says(session: zenoh.Session, endpoint: str) -> None:
    example = Path(__file__).parents[2] / "examples" / "fibonacci_client.py"

    class Counting(Node):
        @action("fibonacci", rate=4.0)
        def fibonacci(self, goal: Fibonacci.Goal) -> Generator[Fibonacci.Feedback, None, Fibonacci.Result]:
            sequence = [0, 1]
            for _ in range(goal.order):
                sequence.append(sequence[-1] + sequence[-2])
                yield Fibonacci.Feedback(sequence)
            return Fibonacci.Result(sequence)

    def run(*words: str) -> "subprocess.CompletedProcess[str]":
        command = [sys.executable, str(example), *words, endpoint]
        return subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)

    with Counting(namespace="r1", session=session):
        told = run("r1", "4")
        assert told.stdout.splitlines()[-1] == "succeeded [0, 1, 1, 2, 3, 5]", told.stderr
        assert "so far [0, 1, 1, 2]" in told.stdout
    gone = run("r2", "4")
    assert (gone.returncode, gone.stderr) == (1, "send_goal: nobody answers on r2/fibonacci/_action\n")


def test_all_that_is_told_on_the_way_comes_before_the_result_however_late_it_is_taken(
    session: zenoh.Session, endpoint: str
) -> None:
    ended, told = threading.Event(), list[object]()

    def take(feedback: object) -> None:
        assert ended.wait(PATIENCE)
        time.sleep(0.05)  # who reads what is printed is slow
        told.append(feedback)

    with Server(namespace="r1", session=session):
        tool = open_session(Network(mode="client", connect=(endpoint,)))
        try:
            sending = actions.Sending(tool, offers.find_action(tool, "r1/fibonacci", PATIENCE), PATIENCE)
            end = sending.follow(take)
            sending.send({"order": 4})
            outcome = sending.wait(PATIENCE)
            ended.set()
            end()
            assert (outcome.status, told) == ("SUCCEEDED", [{"sequence": [step]} for step in range(4)])
        finally:
            close_session(tool)


def test_the_tools_send_follow_and_cancel_goals(session: zenoh.Session, endpoint: str) -> None:
    def robo(*words: str) -> "subprocess.CompletedProcess[str]":
        command = [sys.executable, "-m", "robo", "action", *words, "--connect", endpoint]
        environment = plain_environment()
        return subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, env=environment, check=False)

    with Server(namespace="r1", session=session):
        listed = robo("list", "--json").stdout
        assert json.loads(listed) == {
            "key": "r1/fibonacci",
            "type": "example/Fibonacci",
            "servers": ["/r1/server"],
            "clients": [],
        }
        assert "goal        example/Fibonacci_Goal {order" in robo("info", "r1/fibonacci").stdout
        assert robo("type", "r1/fibonacci").stdout == "example/Fibonacci\n"
        sent = robo("send-goal", "r1/fibonacci", "{order: 2}", "--feedback", "--json")
        told = [json.loads(line) for line in sent.stdout.splitlines()]
        assert sent.returncode == 0, sent.stderr
        assert told[:2] == [{"feedback": {"sequence": [0]}}, {"feedback": {"sequence": [1]}}]
        assert (told[-1]["status"], told[-1]["result"]) == ("SUCCEEDED", {"sequence": [2]})
        too_long = robo("send-goal", "r1/fibonacci", "{order: 1000000}", "--timeout", "0.1")
        assert (too_long.returncode, too_long.stderr.splitlines()[-1]) == (1, "canceled")
        begun = robo("send-goal", "r1/fibonacci", "{order: 1000000}", "--no-wait").stdout.strip()
        assert robo("cancel", "r1/fibonacci").stdout == f"canceling {begun}\n"
        late = robo("cancel", "r1/fibonacci", begun)
        assert (late.returncode, "has ended already" in late.stderr or "canceling" in late.stdout) != (0, False)
        wrong = robo("send-goal", "r1/fibonacci", "{ordr: 1}")
        assert (wrong.returncode, "has no field 'ordr'; did you mean order?" in wrong.stderr) != (0, True)
        assert "did you mean r1/fibonacci?" in robo("info", "r1/fibonaci").stderr
