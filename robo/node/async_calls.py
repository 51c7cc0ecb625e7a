"""Calling a service with `await`: what waits is a future of the loop, and no thread."""

import asyncio
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Protocol, TypeVar

import zenoh

from robo.errors import ServiceTimeout
from robo.node.async_loop import Loop
from robo.wire import queries
from robo.wire.qos import Priority, zenoh_priority
from robo.wire.queries import Fault
from robo.wire.targets import OF_ONE

T = TypeVar("T")


class Presence(Protocol):
    """Whether somebody serves a service."""

    def tell(self, notice: Callable[[], None]) -> Callable[[], None]:
        """Call `notice` once somebody does, at once if so already, in any thread. Returns what ends that."""


async def appear(presence: Presence, key: str, timeout: float) -> float:
    """Wait until somebody serves a service. Returns how much of `timeout` is left, s.

    Raises:
        ServiceTimeout: nobody does within that time.
    """
    loop = asyncio.get_running_loop()
    begin = time.monotonic()
    present: asyncio.Future[bool] = loop.create_future()
    settle = _settler(loop, present)
    forget = presence.tell(lambda: settle(True))
    late = _later(loop, timeout, lambda: settle(False))
    try:
        if not await present:
            raise ServiceTimeout(f"service {key}: nobody serves it (waited {timeout:g} s)")
    finally:
        late.cancel()
        forget()
    return max(timeout - (time.monotonic() - begin), 0.001)


async def first_answer(
    session: zenoh.Session,
    key: str,
    request: tuple[bytes, bytes],
    encoding: str,
    timeout: float,
    priority: Priority = "data",
) -> zenoh.Sample | Fault | None:
    """Send one request, payload and attachment, and wait for its answer; None where there is none in time."""
    loop = asyncio.get_running_loop()
    answer: asyncio.Future[zenoh.Sample | Fault | None] = loop.create_future()
    settle = _settler(loop, answer)
    # On Zenoh's own thread: it only tells the loop, which waits for nothing.
    handler: Any = zenoh.handlers.Callback(
        lambda reply: settle(queries.first_answer([reply])), drop=lambda: settle(None), indirect=False
    )
    session.get(
        key,
        handler,
        payload=request[0],
        attachment=request[1],
        encoding=encoding,
        timeout=timeout,
        priority=zenoh_priority(priority),
        **OF_ONE,
    )
    return await answer


def _settler(loop: asyncio.AbstractEventLoop, future: "asyncio.Future[T]") -> Callable[[T], None]:
    """What gives a future its value from any thread; the first one counts."""

    def settle(value: T) -> None:
        if not future.done():
            future.set_result(value)

    def tell(value: T) -> None:
        with suppress(RuntimeError):  # the loop is closed, and nobody waits any more
            loop.call_soon_threadsafe(settle, value)

    return tell


def _later(loop: asyncio.AbstractEventLoop, delay: float, callback: Callable[[], None]) -> asyncio.TimerHandle:
    """By the wall clock, as all waiting for services, where the loop's time may be simulated."""
    return loop.wall_later(delay, callback) if isinstance(loop, Loop) else loop.call_later(delay, callback)
