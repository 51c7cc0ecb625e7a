"""Async callbacks on their loop, by the wall clock and by simulated time."""

import asyncio
import contextvars
import subprocess
import sys
import threading
import time

import pytest
import zenoh

from robo import Client, Node, Publisher, ServiceError, service, subscribe, timer
from robo.errors import ServiceTimeout
from robo_messages import Clock as ClockMessage
from robo_messages import String, Time, Trigger
from tests.support import PATIENCE, eventually

where = contextvars.ContextVar("where", default="nowhere")


class Waiter(Node):
    """Waits in its callbacks."""

    out = Publisher(String, "out")

    def on_start(self) -> None:
        self.heard: list[str] = []
        self.threads: set[str] = set()
        self.cancelled = 0

    @subscribe("in")
    async def on_text(self, text: String) -> None:
        self.threads.add(threading.current_thread().name)
        token = where.set(text.data)
        helped = await asyncio.to_thread(lambda: text.data.upper())
        await asyncio.sleep(0.001)
        assert where.get() == text.data
        where.reset(token)
        self.heard.append(helped)

    @subscribe("stay")
    async def on_stay(self, _stay: String) -> None:
        self.heard.append("stays")
        try:
            await asyncio.sleep(3600)
        finally:
            self.cancelled += 1

    @subscribe("block")
    async def on_block(self, _block: String) -> None:
        time.sleep(0.6)

    @subscribe("end")
    async def on_end(self, _end: String) -> None:
        await asyncio.sleep(0)
        raise SystemExit(3)

    @subscribe("stray")
    async def on_stray(self, _stray: String) -> None:
        async def fall() -> None:
            raise KeyError("stray")

        self.task: asyncio.Task[None] | None = asyncio.create_task(fall())
        self.task = None

    @service("echo")
    async def echo(self, _request: Trigger.Request) -> Trigger.Response:
        await asyncio.sleep(0.001)
        return Trigger.Response(message="echo")


class Sender(Node):
    """Sends, and asks from a loop of its own."""

    text = Publisher(String, "in")
    echo = Client(Trigger.Request, Trigger.Response, "echo", timeout=PATIENCE)

    def ask(self) -> str:
        async def ask() -> str:
            return (await self.echo.call_async(Trigger.Request())).message

        return asyncio.run(ask())


def test_async_callbacks_run_on_one_loop_which_ends_with_the_last_node(session: zenoh.Session) -> None:
    assert "robo-asyncio" not in names()
    with Waiter(name="first", session=session) as first, Sender(session=session) as sender:
        with Waiter(name="second", remappings={"echo": "other"}, session=session) as second:
            for text in "abc":
                sender.text.publish(String(text))
            for node in (first, second):
                eventually(lambda node=node: node.heard == ["A", "B", "C"], "all were heard, in order")  # type: ignore[misc]
            assert first.threads == second.threads == {"robo-asyncio"}
            assert names().count("robo-asyncio") == 1
            assert sender.ask() == "echo"
        assert "robo-asyncio" in names()
        assert sender.ask() == "echo"
    assert "robo-asyncio" not in names()


def names() -> list[str]:
    return [thread.name for thread in threading.enumerate()]


def test_what_waits_is_cancelled_at_once_when_the_node_closes(session: zenoh.Session) -> None:
    node = Waiter(session=session)
    with node:
        publisher = node.create_publisher(String, "stay")
        publisher.publish(String())
        eventually(lambda: node.heard == ["stays"], "it stays")
    assert node.cancelled == 1
    assert node.status.callback_errors == 0


def test_what_is_cancelled_may_put_things_in_order(session: zenoh.Session) -> None:
    class Tidy(Node):
        def on_start(self) -> None:
            self.log: list[str] = []

        async def main(self) -> None:
            self.task = asyncio.create_task(self.work("task"))
            await self.work("main")

        async def work(self, who: str) -> None:
            try:
                self.log.append(f"{who} begins")
                await asyncio.sleep(3600)
            finally:
                await asyncio.sleep(0.05)
                self.log.append(f"{who} is tidy")

    with Tidy(session=session) as node:
        eventually(lambda: len(node.log) == 2, "both wait")
    assert sorted(node.log[2:]) == ["main is tidy", "task is tidy"]


def test_who_holds_the_loop_is_named(session: zenoh.Session, caplog: pytest.LogCaptureFixture) -> None:
    with Waiter(session=session) as node:
        node.create_publisher(String, "block").publish(String())
        eventually(lambda: node.status.running == "on_block", "it is what runs")
        eventually(lambda: "on_block held up all async callbacks of this process for 0." in caplog.text, "it is told")


def test_a_task_that_nobody_awaits_and_an_end_are_told(
    session: zenoh.Session, caplog: pytest.LogCaptureFixture
) -> None:
    with Waiter(session=session) as node:
        node.create_publisher(String, "stray").publish(String())
        eventually(lambda: node.status.callback_errors == 1, "it is counted")
        eventually(lambda: "on_stray raised" in caplog.text, "it is logged")
        node.create_publisher(String, "end").publish(String())
        assert node.wait(PATIENCE)
        assert node.exit_code == 3


def test_a_call_with_await_that_nobody_answers_ends(session: zenoh.Session) -> None:
    with Sender(session=session) as sender:

        async def ask() -> None:
            await sender.echo.call_async(Trigger.Request(), timeout=0.05)

        with pytest.raises(ServiceTimeout, match=r"service echo: nobody serves it \(waited 0\.05 s\)"):
            asyncio.run(ask())

        def fail(_: Trigger.Request) -> Trigger.Response:
            raise ValueError("no")

        sender.create_service(Trigger.Request, Trigger.Response, "echo", fail)
        with pytest.raises(ServiceError, match="service echo: ValueError: no"):
            sender.ask()


class Simulated(Node):
    """Sleeps by simulated time."""

    def on_start(self) -> None:
        self.told: list[float] = []

    @timer(rate=1.0)
    async def tick(self) -> None:
        await asyncio.sleep(0.5)
        self.told.append(round(self.clock.monotonic(), 3))


def test_async_callbacks_sleep_by_simulated_time(session: zenoh.Session) -> None:
    with Simulated(session=session, parameters={"use_sim_time": True}) as node:
        clock = node.create_publisher(ClockMessage, "/clock")
        seconds = iter(range(1, 100_000))

        def go_on() -> bool:
            clock.publish(ClockMessage(Time.from_nanoseconds(next(seconds) * 100_000_000)))
            return len(node.told) >= 3

        eventually(go_on, "it has slept three times")
        assert node.told[0] >= 1.5, "a tick after a second, and half a second of sleep"


def test_a_node_without_async_callbacks_imports_no_asyncio() -> None:
    code = """
import sys, robo
from robo import Node, timer, open_session, Network
class Plain(Node):
    @timer(rate=1000.0)
    def tick(self): self.shutdown()
session = open_session(Network(mode="peer"))
with Plain(session=session) as node:
    node.wait(60)
session.close()
print("asyncio" in sys.modules)
"""
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120)
    assert told.stdout == "False\n"
