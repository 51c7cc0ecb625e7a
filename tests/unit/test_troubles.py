"""What goes wrong in a node: counted, told in its log, and where it is too much, the end of the node."""

import logging
import threading
from collections.abc import Callable
from typing import Any

import pytest
import zenoh

from robo.node.ending import end_without, exit_code_of, obey
from robo.node.log import NodeLogger
from robo.node.message_info import PLAIN
from robo.node.troubles import MALFORMED_PERIOD, Troubles
from robo.wire.keys import EndpointToken
from robo.wire.qos import QoS
from tests.support import PATIENCE


class Base:
    """What troubles see of a node."""

    def __init__(self) -> None:
        self.logger = NodeLogger("test.troubles")
        self.exit_code = 0
        self.stopping = False
        self.shutdowns: list[int] = []

    def shutdown(self, exit_code: int = 0) -> None:
        self.shutdowns.append(exit_code)


@pytest.fixture
def base() -> Base:
    return Base()


@pytest.fixture
def lines(caplog: pytest.LogCaptureFixture) -> Callable[[], list[str]]:
    caplog.set_level(logging.DEBUG)
    return lambda: [f"{record.levelname} {record.getMessage()}" for record in caplog.records]


def on_text(_: object) -> None:
    """A callback."""


def test_what_a_callback_raises_is_counted_and_told(base: Base, lines: Callable[[], list[str]]) -> None:
    troubles = Troubles(base.logger, lambda _: None)
    handle = troubles.handler(on_text)
    for _ in range(3):
        handle(ValueError("broken"))
    troubles.handler(lambda: None)(KeyError("other"))
    assert troubles.callback_errors == 4
    assert lines() == ["ERROR on_text raised", "ERROR <lambda> raised"], "the same is not told again at once"


def test_a_callback_that_wishes_to_end_the_node_is_no_error(base: Base) -> None:
    wishes: list[SystemExit] = []
    troubles = Troubles(base.logger, wishes.append)
    wish = SystemExit(3)
    troubles.handler(on_text)(wish)
    assert (wishes, troubles.callback_errors) == ([wish], 0)


@pytest.mark.parametrize(
    ("code", "expected"),
    [(None, 0), (0, 0), (3, 3), ("no such device", 1), ("", 1), (True, 1)],
)
def test_an_exit_code_is_read_as_python_reads_it(code: Any, expected: int) -> None:
    assert exit_code_of(SystemExit(code)) == expected


def test_a_node_that_ends_with_a_text_says_it_last(base: Base, lines: Callable[[], list[str]]) -> None:
    obey(base, SystemExit("no such device: 100 % sure"))
    obey(base, SystemExit(4))
    obey(base, SystemExit())
    assert base.shutdowns == [1, 4, 0]
    assert lines() == ["CRITICAL no such device: 100 % sure"]


def test_a_node_does_not_outlive_one_of_its_threads(base: Base, lines: Callable[[], list[str]]) -> None:
    end_without(base, ValueError("broken"))
    base.exit_code = 3
    end_without(base, ValueError("broken"))
    assert base.shutdowns == [1, 3], "it does not take back what was said before"
    thread = threading.current_thread().name
    assert lines() == [f"ERROR the thread {thread} died; the node ends"] * 2


def test_a_thread_that_dies_while_the_node_stops_changes_nothing(base: Base, lines: Callable[[], list[str]]) -> None:
    base.stopping = True
    end_without(base, OSError("the network is gone"))
    assert base.shutdowns == []
    assert lines() == [
        f"WARNING {threading.current_thread().name} ended while the node stopped: OSError: the network is gone"
    ]


@pytest.mark.parametrize(
    ("wanted", "whose"),
    [("", "the node that came first"), (PLAIN, "a plain Zenoh client"), ("/r1/monitor", "/r1/monitor")],
)
def test_a_sender_whose_messages_do_not_count_is_told(
    base: Base, lines: Callable[[], list[str]], wanted: str, whose: str
) -> None:
    troubles = Troubles(base.logger, lambda _: None)
    for count in (1, 2):
        troubles.left_out("r1/cmd_vel", wanted, "/r1/joystick", count)
    assert lines() == [
        f"WARNING left out messages of /r1/joystick on r1/cmd_vel, 1 so far: it takes those of {whose} alone"
    ]
    troubles.left_out("r1/cmd_vel", wanted, "/r1/tablet", 1)
    assert len(lines()) == 2, "another one is told at once"


class Entity:
    def __init__(self, zid: str, eid: int) -> None:
        self.zid = zid
        self.eid = eid


class Sample:
    """A message that cannot be read."""

    def __init__(self, entity: Entity | None = None) -> None:
        self.source_info: Any = None if entity is None else type("Source", (), {"source_id": entity})


@pytest.fixture
def malformed(base: Base, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Tells of a malformed message at a time and waits until it is told; the network knows one publisher."""

    def publishers_of(session: object, topic: str, **_: object) -> list[EndpointToken]:
        if session is None:
            raise zenoh.ZError("closed")
        return [EndpointToken("r1", "foe", "pub", "std/String", QoS.DEFAULT, topic, "abc:7")]

    monkeypatch.setattr("robo.wire.discovery.publishers_of", publishers_of)
    clock = [0.0]
    troubles = Troubles(base.logger, lambda _: None, lambda: clock[0])

    def tell(at: float, count: int, entity: Entity | None = None, topic: str = "r1/in", session: Any = "open") -> None:
        clock[0] = at
        sample: Any = Sample(entity)
        troubles.malformed(session, topic, count, "cut short", sample)
        for thread in threading.enumerate():
            if thread.name == "robo-malformed":
                thread.join(PATIENCE)

    return tell


def test_malformed_messages_are_told_at_once_and_then_now_and_then(
    malformed: Any, lines: Callable[[], list[str]]
) -> None:
    malformed(at=0.0, count=1)
    malformed(at=1.0, count=2)
    malformed(at=1.0, count=1, topic="r1/other")
    malformed(at=MALFORMED_PERIOD, count=900)
    start = "WARNING dropped a malformed message on"
    assert lines() == [
        f"{start} r1/in (1 so far): cut short; from a plain Zenoh client",
        f"{start} r1/other (1 so far): cut short; from a plain Zenoh client",
        f"{start} r1/in (900 so far): cut short; from a plain Zenoh client",
    ]


def test_whoever_sends_malformed_messages_is_named(malformed: Any, lines: Callable[[], list[str]]) -> None:
    malformed(at=0.0, count=1, topic="a", entity=Entity("abc", 7))
    malformed(at=0.0, count=1, topic="b", entity=Entity("abc", 8))
    malformed(at=0.0, count=1, topic="c", entity=Entity("abc", 7), session=None)  # the node has just left
    senders = [line.rpartition("; from ")[2] for line in lines()]
    assert senders == ["/r1/foe", "abc:8, unannounced", "abc:7, unannounced"]
