"""What tells that a process is ready, without one."""

import asyncio
from collections.abc import Callable

import pytest

from robo.launch.plan import ReadyPlan
from robo.supervisor.readiness import Readiness, says_more_than_a_start
from robo.supervisor.topic_watch import Flow
from tests.plans import topic_plan


class World:
    """A time that jumps, a probe that fails a few times, and topics."""

    def __init__(self) -> None:
        self.now = 0.0
        self.failures = 0
        self.probes = 0
        self.flows: dict[str, Flow] = {}
        self.later: list[tuple[float, Callable[[], None]]] = []

    def readiness(self, plan: ReadyPlan) -> Readiness:
        return Readiness(plan, self.flows.get, self.probe, lambda: self.now, self.pause)

    async def probe(self) -> bool:
        self.probes += 1
        return self.probes > self.failures

    async def pause(self, seconds: float) -> None:
        self.now += seconds
        for at, action in self.later:
            if at <= self.now:
                action()
        await asyncio.sleep(0)


def flow(min_rate: float | None = None) -> Flow:
    return Flow(topic_plan("r1/odom", min_rate=min_rate), 0.0)


async def settled(task: "asyncio.Task[None]") -> bool:
    """Whether a task has ended once all have had their turn."""
    for _ in range(5):
        await asyncio.sleep(0)
    return task.done()


def test_what_says_nothing_is_ready_at_once() -> None:
    async def go() -> None:
        readiness = World().readiness(ReadyPlan(when="started"))
        assert await settled(asyncio.create_task(readiness.wait()))

    asyncio.run(go())


def test_a_token_and_then_a_line() -> None:
    async def go() -> None:
        readiness = World().readiness(ReadyPlan(when="node", log="listening on [0-9]+"))
        task = asyncio.create_task(readiness.wait())
        assert not await settled(task)
        assert readiness.missing == "its liveliness token does not show"
        readiness.see_token()
        assert not await settled(task)
        assert readiness.missing == "no line of its output holds 'listening on [0-9]+'"
        readiness.see_line("listening on all")
        assert not await settled(task)
        readiness.see_line("now listening on 80")
        assert await settled(task)

    asyncio.run(go())


def test_what_came_while_another_sign_was_waited_for_counts() -> None:
    async def go() -> None:
        readiness = World().readiness(ReadyPlan(when="node", log="here"))
        readiness.see_line("here")
        readiness.see_token()
        await readiness.wait()

    asyncio.run(go())


def test_a_probe_is_tried_five_times_a_second() -> None:
    async def go() -> None:
        world = World()
        world.failures = 10
        readiness = world.readiness(ReadyPlan(when="started", probe=("test", "-e", "a b")))
        await readiness.wait()
        assert world.probes == 11
        assert world.now == pytest.approx(2.0)
        assert readiness.missing == "`test -e 'a b'` does not succeed"

    asyncio.run(go())


def test_a_port_that_listens() -> None:
    async def go() -> None:
        server = await asyncio.start_server(lambda _, writer: writer.close(), "127.0.0.1", 0)
        port = server.sockets[0].getsockname()[1]
        world = World()
        await world.readiness(ReadyPlan(when="started", port=f"127.0.0.1:{port}")).wait()
        assert world.now == 0.0, "at the first try"
        server.close()
        await server.wait_closed()
        readiness = world.readiness(ReadyPlan(when="started", port=f"127.0.0.1:{port}"))
        task = asyncio.create_task(readiness.wait())
        while world.now < 1.0:
            await asyncio.sleep(0.001)
        assert readiness.missing == f"nothing listens at 127.0.0.1:{port}"
        task.cancel()

    asyncio.run(go())


def test_data_at_the_rate_that_is_promised() -> None:
    async def go() -> None:
        world = World()
        odom = world.flows["r1/odom"] = flow(min_rate=10.0)

        def publish() -> None:
            for _ in range(5):
                odom.add(world.now)

        world.later = [(1.0, publish)]
        readiness = world.readiness(ReadyPlan(when="started", topics=("r1/odom", "r1/nobody")))
        await readiness.wait()
        assert world.now > 1.0
        assert odom.count >= 10
        assert readiness.missing == "r1/nobody does not come as promised", "what nobody watches is not waited for"

    asyncio.run(go())


@pytest.mark.parametrize(
    ("plan", "more"),
    [
        (ReadyPlan(), True),
        (ReadyPlan(when="started"), False),
        (ReadyPlan(when="started", log="x"), True),
        (ReadyPlan(when="started", port="h:1"), True),
        (ReadyPlan(when="started", probe=("x",)), True),
        (ReadyPlan(when="started", topics=("x",)), True),
    ],
)
def test_readiness_that_says_more_than_a_start(plan: ReadyPlan, more: bool) -> None:
    assert says_more_than_a_start(plan) == more
