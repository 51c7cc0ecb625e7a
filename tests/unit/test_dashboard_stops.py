"""Emergency stops that are on their way."""

import asyncio
import threading

import pytest
import zenoh

from robo.dashboard import requests
from robo.dashboard.stops import Stops
from robo.errors import ServiceTimeout
from tests.support import eventually

pytestmark = pytest.mark.timeout(30)


class Robot:
    """Answers each call when it is told to, with the number of the call."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.calls: list[threading.Event] = []
        self.said = 0
        self.problem: Exception | None = None
        monkeypatch.setattr(requests, "stop", self._stop)
        monkeypatch.setattr(requests, "say_stop", self._say)

    def _stop(self, _session: zenoh.Session, _service: str) -> object:
        answered = threading.Event()
        self.calls.append(answered)
        number = len(self.calls)
        assert answered.wait(20)
        if self.problem is not None:
            raise self.problem
        return number

    def _say(self, _session: zenoh.Session, _service: str) -> None:
        self.said += 1
        raise OSError("the network has been left")


@pytest.fixture
def robot(monkeypatch: pytest.MonkeyPatch) -> Robot:
    return Robot(monkeypatch)


async def begun(robot: Robot, count: int) -> None:
    await asyncio.to_thread(eventually, lambda: len(robot.calls) == count, f"{count} calls")


def test_a_stop_is_answered_by_a_call_that_began_after_it(robot: Robot, session: zenoh.Session) -> None:
    async def press() -> None:
        stops = Stops(session)
        first, second = (asyncio.create_task(stops.stop("r1/emergency_stop")) for _ in range(2))
        await begun(robot, 2)
        later = [asyncio.create_task(stops.stop("r1/emergency_stop")) for _ in range(3)]
        await asyncio.to_thread(eventually, lambda: robot.said == 3, "each is said on the topic at once")
        robot.calls[1].set()
        assert await second == 2
        await begun(robot, 3)
        assert not any(one.done() for one in later), "what answers an earlier one says nothing of them"
        robot.calls[2].set()
        assert await asyncio.gather(*later) == [3, 3, 3]
        robot.calls[0].set()
        assert await first == 1
        again = asyncio.create_task(stops.stop("r1/emergency_stop"))
        await begun(robot, 4)
        robot.calls[3].set()
        assert await again == 4
        stops.close()

    asyncio.run(press())


def test_who_waits_for_the_next_call_is_told_why_it_failed(robot: Robot, session: zenoh.Session) -> None:
    async def press() -> None:
        stops = Stops(session)
        pressed = [asyncio.create_task(stops.stop("r1/emergency_stop")) for _ in range(3)]
        await begun(robot, 2)
        robot.problem = ServiceTimeout("NOT CONFIRMED")
        robot.calls[0].set()
        await begun(robot, 3)
        for call in robot.calls:
            call.set()
        assert [str(one) for one in await asyncio.gather(*pressed, return_exceptions=True)] == ["NOT CONFIRMED"] * 3
        stops.close()

    asyncio.run(press())


def test_nobody_waits_any_more_when_the_server_ends(robot: Robot, session: zenoh.Session) -> None:
    async def press() -> None:
        stops = Stops(session)
        pressed = [asyncio.create_task(stops.stop("r1/emergency_stop")) for _ in range(3)]
        await begun(robot, 2)
        stops.close()
        found = await asyncio.gather(*pressed, return_exceptions=True)
        assert [type(one) for one in found] == [asyncio.CancelledError] * 3
        for call in robot.calls:
            call.set()

    asyncio.run(press())
