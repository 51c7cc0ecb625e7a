"""What tells that a process is ready."""

import asyncio
import re
import shlex
import time
from collections.abc import Awaitable, Callable, Iterator
from typing import NamedTuple

from robo.launch.plan import ReadyPlan
from robo.machine.probe import listens
from robo.supervisor.topic_watch import Flow

_PERIOD = 0.2
"""How often a probe is tried, s."""


class _Sign(NamedTuple):
    """One thing that tells of readiness."""

    missing: str
    """What is to be said while it has not come."""
    has_come: Callable[[], Awaitable[bool]]
    period: float = _PERIOD
    """How often that is asked, s."""


class Readiness:
    """All that tells of the readiness of one child: one sign after the other."""

    def __init__(
        self,
        plan: ReadyPlan,
        flow: Callable[[str], Flow | None],
        probe: Callable[[], Awaitable[bool]],
        clock: Callable[[], float] = time.monotonic,
        pause: Callable[[float], Awaitable[None]] = asyncio.sleep,
    ) -> None:
        """
        Args:
            plan: the signs.
            flow: what comes on a topic; None where nobody looks.
            probe: tries the probe command.
            clock: the time, s.
            pause: waits for a while, s.
        """
        self.missing = ""
        """The sign that it waits for, in words."""
        self._plan = plan
        self._flow = flow
        self._probe = probe
        self._clock = clock
        self._pause = pause
        self._token = asyncio.Event()
        self._line = asyncio.Event()
        self._pattern = re.compile(plan.log) if plan.log is not None else None

    def see_token(self) -> None:
        """The node's liveliness token shows."""
        self._token.set()

    def lose_token(self) -> None:
        """It shows no more."""
        self._token.clear()

    def see_line(self, text: str) -> None:
        """The child has printed a line."""
        if self._pattern is not None and self._pattern.search(text):
            self._line.set()

    async def wait(self) -> None:
        """Wait until every sign has come, for as long as that takes."""
        for sign in self._signs():
            self.missing = sign.missing
            while not await sign.has_come():
                await self._pause(sign.period)

    def _signs(self) -> Iterator[_Sign]:
        plan = self._plan
        if plan.when == "node":
            yield _Sign("its liveliness token does not show", self._token.wait)
        if plan.log is not None:
            yield _Sign(f"no line of its output holds {plan.log!r}", self._line.wait)
        if plan.port is not None:
            address = plan.port
            yield _Sign(f"nothing listens at {address}", lambda: listens(address))
        if plan.probe:
            yield _Sign(f"`{shlex.join(plan.probe)}` does not succeed", self._probe)
        for key in plan.topics:
            yield _Sign(f"{key} does not come as promised", self._flows(key), _PERIOD / 2)

    def _flows(self, key: str) -> Callable[[], Awaitable[bool]]:
        flow = self._flow(key)

        async def flows() -> bool:
            return flow is None or flow.flows(self._clock())

        return flows


def says_more_than_a_start(plan: ReadyPlan) -> bool:
    """Whether being ready says more than having been started."""
    return plan.when == "node" or bool(plan.log or plan.port or plan.probe or plan.topics)
