"""A supervisor's control keys, asked by whoever can reach them."""

import asyncio
import gc
import logging
import random
import threading
import weakref
from collections.abc import Iterator
from contextlib import contextmanager

import msgspec
import pytest
import zenoh

from robo.errors import RunError
from robo.supervisor.control import Control
from robo.tools import runs
from robo.wire.keys import control_key
from robo.wire.queries import Fault, read_fault
from robo.wire.reports import COMMAND_LIMIT, LogsRequest
from tests.support import eventually


@contextmanager
def running_loop() -> Iterator[asyncio.AbstractEventLoop]:
    """A loop in a thread of its own."""
    loop = asyncio.new_event_loop()
    runner = threading.Thread(target=loop.run_forever)
    runner.start()
    try:
        yield loop
    finally:
        loop.call_soon_threadsafe(loop.stop)
        runner.join()
        loop.close()


@pytest.fixture
def control(session: zenoh.Session) -> Iterator[list[LogsRequest]]:
    """A control of robot r1; what its only verb was asked for."""
    asked: list[LogsRequest] = []

    async def logs(what: LogsRequest) -> list[str]:
        asked.append(what)
        return []

    with running_loop() as loop:
        Control(session, "r1", {"logs": logs}, {}, loop)
        yield asked


def ask(session: zenoh.Session, payload: bytes) -> Fault | None:
    """The error in the only reply; None where there is none."""
    (reply,) = session.get(control_key("r1", "logs"), payload=payload, timeout=10.0)
    return read_fault(reply)


@pytest.mark.parametrize(
    ("request_", "named"),
    [
        ({"level": "loud"}, "log level 'loud'"),
        ({"level": "x" * 1000}, "level: "),
        ({"level": 3}, "level: "),
        ({"lines": -1}, "lines: "),
        ({"lines": "many"}, "lines: "),
        ({"lines": 1.5}, "lines: "),
        ({"since": "yesterday"}, "since: "),
        ({"since": None}, "since: "),
        ({"names": "a"}, "names: "),
        ({"names": [1]}, "names[0]: "),
        ({"names": ["a"] * 1001}, "names: "),
        ({"names": ["a" * 200_000]}, "200,"),
        ([1, 2], "Expected `object`, got `array`"),
    ],
)  # fmt: skip
def test_nonsense_gets_an_error_that_names_the_field(
    control: list[LogsRequest], other: zenoh.Session, caplog: pytest.LogCaptureFixture, request_: object, named: str
) -> None:
    fault = ask(other, msgspec.msgpack.encode(request_))
    assert fault is not None
    assert fault.error == "UsageError"
    assert named in fault.message
    assert caplog.records == []
    assert control == []


def test_no_bytes_at_all_bring_about_a_traceback(
    control: list[LogsRequest], other: zenoh.Session, caplog: pytest.LogCaptureFixture
) -> None:
    chance = random.Random(14)
    good = msgspec.msgpack.encode(LogsRequest(["a"], 5, "warn", 3))
    refused = 0
    for _ in range(500):
        payload = bytearray(good)
        for _ in range(chance.randint(1, 4)):
            payload[chance.randrange(len(payload))] = chance.randrange(256)
        fault = ask(other, bytes(payload))
        assert fault is None or fault.error == "UsageError"
        refused += fault is not None
    assert 0 < refused < 500
    assert ask(other, b"\x91" * 50_000) is not None
    assert [record for record in caplog.records if record.levelno >= logging.WARNING] == []
    assert ask(other, good) is None
    assert control[-1] == LogsRequest(["a"], 5, "warn", 3)


def test_what_takes_too_long_is_given_up_and_told(session: zenoh.Session, other: zenoh.Session) -> None:
    given_up = threading.Event()

    async def stop(_: LogsRequest) -> None:
        try:
            await asyncio.sleep(3600)
        except asyncio.CancelledError:
            given_up.set()
            raise

    with running_loop() as loop:
        Control(session, "r1", {}, {"stop": stop}, loop, limit=0.05)
        (reply,) = other.get(control_key("r1", "stop"), timeout=10.0)
        assert read_fault(reply) == Fault("RunError", "not done within 0.05 s")
        assert given_up.wait(10.0), "nobody waits for it any more"
    assert runs.COMMAND_TIMEOUT > COMMAND_LIMIT, "the answer that it took too long is heard"


def test_nothing_is_kept_of_what_was_refused(session: zenoh.Session, other: zenoh.Session) -> None:
    """Whoever asks on and on for nodes that there are not does not fill the supervisor's memory."""
    left: weakref.WeakSet[BaseException] = weakref.WeakSet()

    class Refused(RunError):
        def __init__(self) -> None:
            super().__init__("there is no such node")
            left.add(self)

    async def ps(_: LogsRequest) -> None:
        raise Refused

    gc.disable()
    try:
        with running_loop() as loop:
            Control(session, "r1", {"ps": ps}, {}, loop)
            for _ in range(5):
                (reply,) = other.get(control_key("r1", "ps"), timeout=10.0)
                assert read_fault(reply) == Fault("Refused", "there is no such node")
            eventually(lambda: not left, "nobody had to look for rings")
    finally:
        gc.enable()
