"""What a publisher puts on the wire, without a network."""

import math
import threading
import time
from datetime import UTC, datetime
from types import SimpleNamespace
from typing import Any

import msgpack
import pytest
import zenoh

from robo.node.topics import FLOOD, LONGEST_AGE, TopicPublisher, endpoint_token
from robo.wire.codec import unpack_attachment
from robo.wire.keys import EndpointToken, parse_token
from robo.wire.qos import KEEP_ALL, QoS
from robo_messages import Bool, String
from tests.support import PATIENCE

CLOCK_ID = zenoh.Timestamp.parse_rfc3339("2026-01-01T00:00:00Z/abc").get_id()


class Put:
    """One message as it leaves."""

    def __init__(self, payload: bytes, attachment: bytes, source_info: Any = None, timestamp: Any = None) -> None:
        self.message: dict[str, Any] = msgpack.unpackb(payload)
        stamp = unpack_attachment(attachment)
        assert stamp is not None
        self.number, self.time = stamp
        self.source: tuple[object, int] | None = source_info
        self.is_signed = source_info is not None
        self.said_at: datetime | None = None if timestamp is None else timestamp.get_time()


class Session:
    """Keeps what is put, and what is declared."""

    id = type("Entity", (), {"zid": "abc", "eid": 7})()

    def __init__(self) -> None:
        self.puts: list[Put] = []
        self.tokens: list[str] = []
        self.options: dict[str, Any] = {}
        self.error: Exception | None = None
        self.busy = 0
        """How often undeclaring is refused, as a thread is in a put."""
        self.is_declared = False

    def declare_publisher(self, topic: str, **options: Any) -> "Session":
        self.options = {"topic": topic, **options}
        self.is_declared = True
        return self

    def put(self, payload: bytes, **more: Any) -> None:
        if self.error is not None:
            raise self.error
        self.puts.append(Put(payload, **more))

    def undeclare(self) -> None:
        if self.busy:
            self.busy -= 1
            raise RuntimeError("already borrowed")
        self.is_declared = False

    def new_timestamp(self) -> Any:
        return type("Timestamp", (), {"get_id": lambda _: CLOCK_ID})()

    def liveliness(self) -> "Session":
        return self

    def declare_token(self, key: str) -> Any:
        self.tokens.append(key)
        return type("Token", (), {"undeclare": lambda _: self.tokens.remove(key)})()


@pytest.fixture
def session(monkeypatch: pytest.MonkeyPatch) -> Session:
    monkeypatch.setattr("zenoh.SourceInfo", lambda entity, number: (entity, number))
    return Session()


def publisher(session: Any, depth: int = 10) -> TopicPublisher[String]:
    return TopicPublisher(session, endpoint_token("r1", "base", "pub", String, QoS(depth=depth), "r1/out"), String)


def test_messages_are_numbered_stamped_and_signed(session: Session) -> None:
    out = publisher(session)
    assert out.published == 0
    before = time.time_ns()
    for text in ("a", "b", "c"):
        out.publish(String(text))
    assert [put.message for put in session.puts] == [{"data": "a"}, {"data": "b"}, {"data": "c"}]
    assert [put.number for put in session.puts] == [1, 2, 3]
    assert before <= session.puts[0].time <= session.puts[2].time <= time.time_ns()
    assert all(put.is_signed and put.said_at is None for put in session.puts)
    assert [put.source for put in session.puts] == [(session.id, 1), (session.id, 2), (session.id, 3)]
    assert out.published == 3


def test_a_publisher_is_announced_with_the_id_that_its_messages_carry(session: Session) -> None:
    out = publisher(session)
    (token,) = map(parse_token, session.tokens)
    assert isinstance(token, EndpointToken)
    assert (token.full_name, token.topic, token.type_name, token.qos) == (
        "/r1/base",
        "r1/out",
        "std/String",
        QoS.DEFAULT,
    )
    assert token.id == out.id == "abc:7"
    assert session.options["encoding"] == "application/msgpack;std/String"


def test_only_keep_all_waits_for_receivers(session: Session) -> None:
    publisher(session)
    assert session.options["congestion_control"] == zenoh.CongestionControl.DROP
    publisher(session, KEEP_ALL)
    assert session.options["congestion_control"] == zenoh.CongestionControl.BLOCK


@pytest.mark.parametrize("wrong", [Bool(True), "text", None, String(data=5)])  # type: ignore[arg-type]
def test_what_is_no_message_of_the_topic_is_told_where_it_is_sent(session: Session, wrong: Any) -> None:
    out = publisher(session)
    with pytest.raises(TypeError, match="r1/out"):
        out.publish(wrong)
    assert session.puts == []
    out.publish(String("right"))
    assert session.puts[0].number == 1, "what was not sent is not counted"


@pytest.mark.parametrize(
    ("age", "expected"),
    [(2.5, 2.5), (-1.0, -1.0), (math.inf, LONGEST_AGE), (math.nan, LONGEST_AGE), (1e300, LONGEST_AGE)],
)
def test_an_age_that_is_handed_on_is_the_time_at_which_it_was_said(
    session: Session, age: float, expected: float
) -> None:
    publisher(session).publish(String("old"), age)
    (put,) = session.puts
    assert put.said_at is not None
    told = (datetime.now(UTC) - put.said_at).total_seconds()
    assert math.isclose(told, expected, abs_tol=5.0)


def test_once_undeclared_it_sends_nothing_and_complains_of_nothing(session: Session) -> None:
    out = publisher(session)
    publish = out.publish
    publish(String("a"))
    out.undeclare()
    publish(String("late"))
    assert (len(session.puts), session.tokens, session.is_declared) == (1, [], False)


def test_an_error_of_the_network_is_the_publishers_while_it_is_declared(session: Session) -> None:
    out = publisher(session)
    session.error = zenoh.ZError("closed")
    with pytest.raises(zenoh.ZError):
        out.publish(String("a"))


def test_a_publisher_that_is_just_in_use_is_undeclared_when_it_is_free(session: Session) -> None:
    session.busy = 5
    publisher(session).undeclare()
    assert not session.is_declared
    session.busy = 10**9
    out = publisher(session)
    begin = time.monotonic()
    out.undeclare()  # the put that waits ends with the session
    assert time.monotonic() - begin < PATIENCE


def test_a_flood_goes_without_its_publishers_id_for_as_long_as_it_lasts(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = [0.0]
    own_time = SimpleNamespace(monotonic=lambda: clock[0], time_ns=time.time_ns)
    monkeypatch.setattr("robo.node.topics.time", own_time)
    out = publisher(session)

    def send(count: int, rate: float) -> list[bool]:
        session.puts.clear()
        for _ in range(count):
            clock[0] += 1 / rate
            out.publish(String("x"))
        return [put.is_signed for put in session.puts]

    assert all(send(200, FLOOD / 2))
    flood = send(200, FLOOD * 2)
    assert flood[0]
    assert not any(flood[-100:])
    assert all(send(200, FLOOD / 2)[-100:])
    assert out.published == 600


def test_threads_that_publish_at_once_share_no_number(session: Session) -> None:
    out = publisher(session)

    def send() -> None:
        for _ in range(500):
            out.publish(String("x"))

    threads = [threading.Thread(target=send) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(PATIENCE)
    assert sorted(put.number for put in session.puts) == list(range(1, 2001))
    assert out.published == 2000
