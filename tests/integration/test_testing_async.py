"""Nodes under test with async callbacks: what comes of them is exactly what the test makes happen."""

import asyncio
import threading
import time

import pytest

from robo import Client, MessageInfo, Node, Publisher, ServiceError, service, subscribe, timer
from robo.errors import ContractError
from robo.testing import Clock, Hung, RunNode
from robo_messages import SetBool, String, Trigger


class Arm(Node):
    """Moves for a second, and tells of it."""

    told = Publisher(String, "told")

    def say(self, text: str) -> None:
        self.told.publish(String(f"{text} at {self.clock.monotonic():.2f}"))

    @subscribe("move")
    async def on_move(self, move: String, info: MessageInfo) -> None:
        self.say(f"{move.data} of {info.source}")
        await asyncio.sleep(1.0)
        self.say(f"{move.data} done")

    @subscribe("fail")
    async def on_fail(self, _fail: String) -> None:
        await asyncio.sleep(0.5)
        raise ValueError("too heavy")

    @timer(rate=2.0)
    async def look(self) -> None:
        await asyncio.sleep(0.1)
        self.say("looked")

    @service("grip")
    async def grip(self, request: SetBool.Request) -> SetBool.Response:
        await asyncio.sleep(0.3)
        if not request.data:
            raise ValueError("nothing to grip")
        return SetBool.Response(message=f"gripped at {self.clock.monotonic():.2f}")

    @service("height")
    def height(self, _request: Trigger.Request) -> Trigger.Response:
        return Trigger.Response(message="2 m")


def texts(messages: list[String]) -> list[str]:
    return [message.data for message in messages]


@pytest.mark.parametrize("run", range(5))
def test_async_callbacks_sleep_by_the_clock_of_the_test(run_node: RunNode, clock: Clock, run: int) -> None:
    del run
    arm = run_node(Arm)
    arm.send("move", String("up"))
    arm.send("move", String("down"))
    assert arm.call("height", Trigger.Request()).message == "2 m", "while a callback waits, others run"
    clock.advance(2.0)
    assert texts(arm.published(Arm.told)) == [
        "up of /test at 0.00",
        "looked at 0.60",
        "up done at 1.00",
        "down of /test at 1.00",
        "looked at 1.10",
        "looked at 1.60",
        "down done at 2.00",
    ]


def test_async_services_answer_and_raise_as_others(run_node: RunNode, clock: Clock) -> None:
    arm = run_node(Arm)
    first, second = (arm.begin_call("grip", SetBool.Request(data=True)) for _ in range(2))
    clock.advance(0.29)
    assert not first.done()
    clock.advance(0.01)
    assert (first.result().message, second.result().message) == ("gripped at 0.30", "gripped at 0.30")
    bad = arm.begin_call("grip", SetBool.Request(data=False))
    with pytest.raises(ValueError, match="nothing to grip"):
        clock.advance(0.3)
    with pytest.raises(ServiceError, match="service grip: ValueError: nothing to grip"):
        bad.result()


def test_what_an_async_callback_raises_reaches_the_test(run_node: RunNode, clock: Clock) -> None:
    arm = run_node(Arm)
    arm.send("fail", String())
    with pytest.raises(ValueError, match="too heavy"):
        clock.advance(0.5)
    assert arm.node.status.callback_errors == 1


class Crane(Node):
    """Has an arm grip."""

    grip = Client(SetBool.Request, SetBool.Response, "grip")
    own = Client(Trigger.Request, Trigger.Response, "weight")
    missing = Client(Trigger.Request, Trigger.Response, "missing", timeout=2.0)
    told = Publisher(String, "told_by_crane")
    inside = most = 0

    @service("weight")
    async def weight(self, _request: Trigger.Request) -> Trigger.Response:
        await asyncio.sleep(0.1)
        return Trigger.Response(message="3 kg")

    @subscribe("lift")
    async def on_lift(self, _lift: String) -> None:
        weight, grip = await asyncio.gather(
            self.own.call_async(Trigger.Request()), self.grip.call_async(SetBool.Request(data=True))
        )
        self.told.publish(String(f"{weight.message}, {grip.message}"))

    @subscribe("wish")
    async def on_wish(self, _wish: String) -> None:
        await self.missing.call_async(Trigger.Request())

    @subscribe("wrong")
    async def on_wrong(self, _wrong: String) -> None:
        self.own(Trigger.Request())

    @subscribe("hang")
    async def on_hang(self, _hang: String) -> None:
        await asyncio.sleep(0.1)
        released.wait()

    @subscribe("tasks")
    async def on_tasks(self, _tasks: String) -> None:
        async def work() -> None:
            for _ in range(3):
                self.inside += 1
                self.most = max(self.most, self.inside)
                time.sleep(0.001)
                self.inside -= 1
                await asyncio.sleep(0)

        async with asyncio.TaskGroup() as group:
            for _ in range(3):
                group.create_task(work())

    @subscribe("tick")
    def on_tick(self, _tick: String) -> None:
        self.inside += 1
        self.most = max(self.most, self.inside)
        time.sleep(0.001)
        self.inside -= 1


released = threading.Event()
"""Ends what hangs, so that nothing of it is left."""


def test_services_are_called_with_await(run_node: RunNode, clock: Clock) -> None:
    run_node(Arm)
    crane = run_node(Crane)
    crane.send("lift", String())
    clock.advance(0.29)
    assert crane.published(Crane.told) == []
    clock.advance(0.01)
    assert crane.published(Crane.told) == [String("3 kg, gripped at 0.30")]


def test_a_service_that_nobody_serves_is_waited_for_by_the_clock(run_node: RunNode, clock: Clock) -> None:
    crane = run_node(Crane)
    crane.send("wish", String())
    clock.advance(1.9)
    with pytest.raises(ServiceError, match=r"service missing: nobody serves it \(waited 2 s\)"):
        clock.advance(0.2)


def test_a_call_that_would_hold_up_the_loop_is_refused(run_node: RunNode) -> None:
    crane = run_node(Crane)
    with pytest.raises(ContractError, match=r"write `await self\.client\.call_async\(request\)`"):
        crane.send("wrong", String())


def test_an_async_callback_that_hangs_is_named(run_node: RunNode, clock: Clock) -> None:
    released.clear()
    crane = run_node(Crane)
    clock.patience = 0.3
    crane.send("hang", String())
    with pytest.raises(Hung, match=r"crane: on_hang has been running for [\s\S]*robo-asyncio"):
        clock.advance(0.1)
    released.set()


def test_tasks_of_a_callback_take_its_turn(run_node: RunNode) -> None:
    crane = run_node(Crane)
    crane.send("tasks", String())
    for _ in range(5):
        crane.send("tick", String())
    assert (crane.node.inside, crane.node.most) == (0, 1)


class Patient(Node):
    """Waits for ever, in all the ways there are."""

    closed = Publisher(String, "closed")

    async def stay(self, name: str) -> None:
        try:
            await asyncio.sleep(3600)
        finally:
            self.closed.publish(String(name))

    @subscribe("go")
    async def on_go(self, _go: String) -> None:
        self.task = asyncio.create_task(self.stay("task"))
        await self.stay("callback")

    @service("ask")
    async def ask(self, _request: Trigger.Request) -> Trigger.Response:
        await self.stay("service")
        return Trigger.Response()

    async def main(self) -> None:
        await self.stay("main")


def test_what_waits_is_cancelled_when_the_node_stops(run_node: RunNode, clock: Clock) -> None:
    patient = run_node(Patient)
    patient.send("go", String())
    call = patient.begin_call("ask", Trigger.Request())
    clock.advance(1.0)
    begin = time.monotonic()
    patient.close()
    assert time.monotonic() - begin < 60
    assert sorted(texts(patient.published(Patient.closed))) == ["callback", "main", "service", "task"]
    with pytest.raises(ServiceError, match="NodeStopping: the node is told to stop"):
        call.result()
    assert patient.exit_code == 0
    assert patient.node.status.callback_errors == 0


class Player(Node):
    """Plays three notes, then ends."""

    notes = Publisher(String, "notes")

    async def main(self) -> None:
        for note in "abc":
            self.notes.publish(String(note))
            await asyncio.sleep(1.0)


def test_an_async_main_sleeps_by_the_clock_and_ends_the_node(run_node: RunNode, clock: Clock) -> None:
    player = run_node(Player)
    clock.advance(1.5)
    assert texts(player.published(Player.notes)) == ["a", "b"]
    clock.advance(2.0)
    assert player.has_ended()
    assert player.exit_code == 0
