"""Who sent a message and how old it is, without a network: announcements and samples are the test's."""

import math
import struct
from collections.abc import Callable
from typing import Any

import pytest
import zenoh

from robo.node.clock import Clock
from robo.node.intake import Intake
from robo.node.message_info import LEASE, PLAIN, MessageInfo
from robo.wire.keys import EndpointToken
from robo.wire.qos import QoS
from robo_services.arrivals import Arrivals

S = 1_000_000_000
WALL = 1_700_000_000 * S
"""The wall clock of everybody at the beginning, ns."""


class Entity:
    """Zenoh's id of a publisher."""

    def __init__(self, zid: str, eid: int = 1) -> None:
        self.zid = zid
        self.eid = eid


class Bytes:
    def __init__(self, data: bytes) -> None:
        self.to_bytes = lambda: data


class Sample:
    """A message of a publisher; `stamp` is when it was sent, ns, by a publisher that says so."""

    timestamp = None

    def __init__(self, zid: str | None, number: int = 1, stamp: int | None = None) -> None:
        self.source_info = None if zid is None else type("Source", (), {"source_id": Entity(zid)})
        self.attachment = None if stamp is None else Bytes(struct.pack("<qq", number, stamp))


class News:
    """An announcement, or its end."""

    def __init__(self, key: str, kind: Any = zenoh.SampleKind.PUT) -> None:
        self.key_expr = key
        self.kind = kind


class Session:
    """Hands announcements to whoever listens for them."""

    def __init__(self) -> None:
        self.listened: list[str] = []
        self.hear: Callable[[News], None] = lambda _: None

    def zid(self) -> str:
        return "5e55"

    def liveliness(self) -> "Session":
        return self

    def declare_subscriber(self, key: str, handler: Any, *, history: bool) -> "Session":
        assert history, "those who were there before are announced too"
        self.listened.append(key)
        self.hear = handler.callback
        return self

    def undeclare(self) -> None:
        self.listened.clear()

    def announce(self, node: str, zid: str, kind: Any = zenoh.SampleKind.PUT) -> None:
        self.hear(News(EndpointToken("r1", node, "pub", "std/String", QoS.DEFAULT, "r1/cmd", f"{zid}:1").key(), kind))


class Clocks(Clock):
    """Time as the receiver sees it, s since the beginning."""

    def __init__(self) -> None:
        self.time = 0.0
        self.arrival_ns = lambda: round(self.time * S)
        self.time_ns = lambda: WALL + round(self.time * S)


@pytest.fixture
def clocks() -> Clocks:
    return Clocks()


class Receiver:
    """An intake with its network."""

    def __init__(self, clocks: Clocks, wanted: str | None = None, lifespan: float | None = None) -> None:
        self.session = Session()
        session: Any = self.session
        self.told: list[tuple[str, int]] = []
        self._clocks = clocks
        self.intake = Intake(
            session,
            "r1/cmd",
            None if wanted is None else lambda: wanted,
            lambda sender, count: self.told.append((sender, count)),
            clocks,
            lifespan,
        )

    def take(self, zid: str | None, *, at: float, number: int = 1, sent: float | None = None) -> MessageInfo | None:
        self._clocks.time = at
        sample: Any = Sample(zid, number, None if sent is None else WALL + round(sent * S))
        return self.intake.examine(sample)


def test_a_message_is_of_the_node_that_announced_its_publisher(clocks: Clocks) -> None:
    receiver = Receiver(clocks)
    receiver.session.announce("monitor", "abc")
    info = receiver.take("abc", at=2.0, number=7, sent=1.75)
    assert info is not None
    assert (info.source, info.source_id, info.sequence_number) == ("/r1/monitor", "abc:1", 7)
    assert info.source_time == WALL + 1_750_000_000
    assert math.isclose(info.age, 0.25, abs_tol=1e-6)


def test_a_message_gets_older_while_its_callback_waits(clocks: Clocks) -> None:
    receiver = Receiver(clocks)
    info = receiver.take("abc", at=2.0, sent=1.75)
    assert info is not None
    clocks.time = 4.0  # this process was stopped between the arrival and the callback
    assert math.isclose(info.age, 2.25, abs_tol=1e-6)
    assert math.isclose(Arrivals(unstamped=True).sent(info, 4.0, 4.0), 1.75, abs_tol=1e-6)


def test_a_node_that_has_left_is_still_known_by_what_comes_late(clocks: Clocks) -> None:
    receiver = Receiver(clocks)
    receiver.session.announce("monitor", "abc")
    receiver.session.announce("monitor", "abc", zenoh.SampleKind.DELETE)
    info = receiver.take("abc", at=1.0, sent=1.0)
    assert info is not None
    assert info.source == "/r1/monitor"


def test_what_says_nothing_of_itself_has_no_age_and_no_name(clocks: Clocks) -> None:
    assert Receiver(clocks).take(None, at=1.0) == MessageInfo(math.inf, "", "")


def test_what_is_older_than_its_lifespan_is_left_out_and_counted(clocks: Clocks) -> None:
    receiver = Receiver(clocks, lifespan=0.5)
    assert receiver.take("abc", at=1.0, sent=0.75) is not None
    assert receiver.take("abc", at=2.0, sent=1.0) is None
    assert receiver.take(None, at=3.0) is not None, "of a plain client nobody knows how old it is"
    assert receiver.intake.expired == 1


@pytest.mark.parametrize("key", ["@robo/nonsense", "@robo/r1/sub/base/std%String/10/r1%cmd", "r1/cmd"])
def test_what_announces_no_publisher_names_nobody(clocks: Clocks, key: str) -> None:
    receiver = Receiver(clocks)
    receiver.session.hear(News(key))
    info = receiver.take("abc", at=1.0, sent=1.0)
    assert info is not None
    assert (info.source, info.sender) == ("", "a plain Zenoh client")


def test_only_the_wanted_source_counts_and_the_other_is_told(clocks: Clocks) -> None:
    receiver = Receiver(clocks, wanted="/r1/monitor")
    receiver.session.announce("monitor", "abc")
    receiver.session.announce("joystick", "def")
    assert receiver.take("abc", at=0.0, sent=0.0) is not None
    assert receiver.take("def", at=0.1, sent=0.1) is None
    assert receiver.take("def", at=0.2, sent=0.2) is None
    assert receiver.told == [("/r1/joystick", 1), ("/r1/joystick", 2)]
    (refused,) = receiver.intake.refused
    assert (refused.sender, refused.count) == ("/r1/joystick", 2)


def test_a_publisher_that_is_not_announced_yet_is_neither_taken_nor_accused_at_once(clocks: Clocks) -> None:
    receiver = Receiver(clocks, wanted="/r1/monitor")
    assert receiver.take("abc", at=0.0, sent=0.0) is None
    assert receiver.take("abc", at=0.4, sent=0.4) is None
    assert receiver.told == [], "it may be the one that is wanted"
    receiver.session.announce("monitor", "abc")
    assert receiver.take("abc", at=0.5, sent=0.5) is not None
    assert receiver.told == []


def test_a_publisher_that_never_announces_itself_is_told_of_in_the_end(clocks: Clocks) -> None:
    receiver = Receiver(clocks, wanted="/r1/monitor")
    for number in range(10):
        assert receiver.take("bad", at=number / 10, sent=number / 10) is None
    assert receiver.told[0] == ("a plain Zenoh client", 1)
    assert len(receiver.told) == 4, "from half a second on"


def test_plain_clients_count_where_they_are_wanted_and_only_there(clocks: Clocks) -> None:
    assert Receiver(clocks, wanted=PLAIN).take(None, at=0.0) is not None
    first_that_comes = Receiver(clocks, wanted="")
    assert first_that_comes.take(None, at=0.0) is None
    assert first_that_comes.told == [("a plain Zenoh client", 1)]


def test_another_takes_over_when_the_first_has_left(clocks: Clocks) -> None:
    receiver = Receiver(clocks, wanted="")
    receiver.session.announce("monitor", "abc")
    receiver.session.announce("spare", "def")
    assert receiver.take("abc", at=0.0, sent=0.0) is not None
    assert receiver.take("def", at=LEASE / 2, sent=LEASE / 2) is None
    assert receiver.take("def", at=LEASE + 0.1, sent=LEASE + 0.1) is not None
    assert receiver.told == [], "a successor is no intruder"


def test_made_up_names_fill_no_memory(clocks: Clocks) -> None:
    receiver = Receiver(clocks, wanted="/r1/monitor")
    for number in range(5_000):
        receiver.session.announce("liar", f"{number:x}")
        receiver.take(f"f{number:x}", at=number / 1e4, sent=number / 1e4)
    receiver.session.announce("monitor", "abc")
    assert receiver.take("abc", at=1.0, sent=1.0) is not None
    kept = [len(value) for value in vars(receiver.intake).values() if isinstance(value, dict)]
    assert kept
    assert max(kept) <= 1024


def test_an_intake_that_is_closed_listens_no_more(clocks: Clocks) -> None:
    receiver = Receiver(clocks)
    assert receiver.session.listened == ["@robo/**/pub/*/*/*/r1%cmd"]
    receiver.intake.close()
    assert receiver.session.listened == []
