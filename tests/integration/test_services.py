"""Services: typed calls between nodes, and from clients that know nothing of robo."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import msgpack
import pytest
import zenoh

import robo
from robo import Client, Node, ServiceError, ServiceTimeout, service, subscribe, timer
from robo.node.turn import paused
from robo.wire import queries
from robo.wire.discovery import wait_for_nodes
from robo.wire.network import Network
from robo.wire.queries import MOST_IDLE
from robo.wire.session import close_session, open_session
from robo_messages import Message, SetBool, String, Trigger, message
from tests.support import PATIENCE, eventually


class Double:
    @message("test/Double_Request")
    class Request(Message):
        """A number."""

        number: int = 0

    @message("test/Double_Response")
    class Response(Message):
        """Twice the number."""

        number: int = 0


class Server(Node):
    """Doubles numbers."""

    def on_start(self) -> None:
        self.inside = 0

    @service("double")
    def double(self, request: Double.Request) -> Double.Response:
        assert self.inside == 0, "two callbacks at once"
        self.inside += 1
        if request.number == 13:
            self.inside -= 1
            raise ValueError("13 brings bad luck")
        if request.number == 99:
            time.sleep(1.0)
        self.inside -= 1
        return Double.Response(2 * request.number)

    @service("~/nested")
    def nested(self, request: Double.Request) -> Double.Response:
        """Calls its own node, and itself."""
        if request.number == 0:
            return Double.Response(1)
        inner = self.myself if request.number > 1 else self.doubling
        return Double.Response(inner(Double.Request(request.number - 1)).number + 1)

    myself = Client(Double.Request, Double.Response, "~/nested", timeout=5.0)
    doubling = Client(Double.Request, Double.Response, "double", timeout=5.0)


class Caller(Node):
    """Calls from within a timer."""

    doubling = Client(Double.Request, Double.Response, "double", timeout=5.0)

    def on_start(self) -> None:
        self.answers: list[int] = []

    @timer(rate=50.0)
    def tick(self) -> None:
        self.answers.append(self.doubling(Double.Request(len(self.answers))).number)


def test_a_call_returns_its_answer(session: zenoh.Session, other: zenoh.Session) -> None:
    caller = Caller(namespace="r1", session=other)
    with Server(namespace="r1", session=session), caller:
        eventually(lambda: len(caller.answers) >= 5, "five answers")
        assert caller.answers[:5] == [0, 2, 4, 6, 8]
        assert caller.status.callback_errors == 0


def test_any_client_calls(session: zenoh.Session, other: zenoh.Session) -> None:
    with Server(namespace="r1", session=session):
        assert not wait_for_nodes(other, ["/r1/server"], 40)
        for payload in (msgpack.packb({"number": 4}), b'{"number": 4}'):
            (reply,) = other.get("r1/double", payload=payload, timeout=40)
            assert reply.ok is not None
            assert msgpack.unpackb(reply.ok.payload.to_bytes()) == {"number": 8}
            assert str(reply.ok.encoding) == "application/msgpack;test/Double_Response"
        for payload in (b"\xff", b"{", msgpack.packb({"nmber": 1}), msgpack.packb([1])):
            (reply,) = other.get("r1/double", payload=payload, timeout=40)
            assert reply.err is not None
            assert msgpack.unpackb(reply.err.payload.to_bytes())["error"] == "Malformed"


@pytest.mark.parametrize("target", [zenoh.QueryTarget.BEST_MATCHING, zenoh.QueryTarget.ALL])
def test_a_query_with_wildcards_runs_nothing(
    session: zenoh.Session, other: zenoh.Session, target: zenoh.QueryTarget
) -> None:
    class Actor(Node):
        class Parameters(robo.Parameters):
            speed: float = 0.5

        parameters: Parameters

        def on_start(self) -> None:
            self.calls: list[str] = []

        @service("emergency_stop")
        def stop(self, _request: Trigger.Request) -> Trigger.Response:
            self.calls.append("emergency_stop")
            return Trigger.Response()

        @service("~/renamed")
        def renamed(self, _request: Trigger.Request) -> Trigger.Response:
            self.calls.append("elsewhere")
            return Trigger.Response()

    def ask(key: str, payload: bytes | None = None) -> tuple[dict[str, Any], list[str]]:
        """What was answered by key, and the kinds of errors."""
        replies = list(other.get(key, payload=payload, target=target, timeout=40))
        answers = {str(r.ok.key_expr): msgpack.unpackb(r.ok.payload.to_bytes()) for r in replies if r.ok is not None}
        return answers, [msgpack.unpackb(r.err.payload.to_bytes())["error"] for r in replies if r.err is not None]

    actor = Actor(namespace="r1", remappings={"~/renamed": "/site/elsewhere"}, session=session)
    reading = {f"r1/actor/parameters/{verb}" for verb in ("list", "get", "describe", "explain")}
    with actor:
        assert not wait_for_nodes(other, ["/r1/actor"], 40)
        for wide in ("**", "r1/**", "*/*", "**/emergency_stop/**", "r1/emergency_$*", "r1/$*stop", "site/else$*"):
            for payload in (None, b"\x80", msgpack.packb({"speed": 9.0})):
                answers, errors = ask(wide, payload)
                assert set(answers) <= reading, wide
                assert "TooWide" in errors, wide
        for wide in ("r1/actor/parameters/set/**", "r1/*/parameters/set", "**/set", "**/$*et"):
            assert set(ask(wide, msgpack.packb({"speed": 9.0}))[0]) <= reading, wide
        assert set(ask("**")[0]) == reading
        assert set(ask("@robo/**")[0]) == {"@robo/r1/status/actor", "@robo/r1/status/actor/log"}
        assert actor.calls == []
        assert set(actor.status.served.values()) == {0}
        assert actor.parameters.speed == 0.5

        assert set(ask("r1/emergency_stop")[0]) == {"r1/emergency_stop"}
        assert set(ask("site/elsewhere?who=me")[0]) == {"site/elsewhere"}
        assert ask("r1/actor/parameters/set", msgpack.packb({"speed": 9.0}))[0]["r1/actor/parameters/set"]["successful"]
        assert actor.calls == ["emergency_stop", "elsewhere"]
        assert set(actor.status.served.values()) == {1}
        assert actor.parameters.speed == 9.0


BIG = b"\x91" * 3_000_000
ODD_PAYLOADS = [None, b"", b"\xc1", b"\xff" * 1_500_000, BIG, b"[" * 100_000, b'{"x": "\\ud800"}']


@pytest.mark.parametrize(
    ("key", "wrong", "right"),
    [
        ("r1/double", msgpack.packb({"number": "x"}), msgpack.packb({"number": 4})),
        ("r1/server/parameters/list", BIG, msgpack.packb({})),
        ("r1/server/parameters/get", msgpack.packb({"names": [{}]}), msgpack.packb(["use_sim_time"])),
        ("r1/server/parameters/set", msgpack.packb([{"name": [], "value": 1}]), msgpack.packb({"use_sim_time": True})),
        ("r1/server/parameters/unknown", b"", None),
        ("@robo/r1/status/server", None, BIG),
    ],
)
def test_every_query_gets_one_answer_that_says_something(
    session: zenoh.Session,
    other: zenoh.Session,
    key: str,
    wrong: bytes | None,
    right: bytes | None,
    caplog: pytest.LogCaptureFixture,
) -> None:
    with Server(namespace="r1", session=session):
        assert not wait_for_nodes(other, ["/r1/server"], 10)
        for payload in (*ODD_PAYLOADS, wrong, right):
            for encoding in (None, "application/json", "application/msgpack;no/Such", "x" * 200):
                for attachment in (None, b"", b"\xff" * 16, b"x" * 10_000):
                    replies = list(
                        other.get(key, payload=payload, encoding=encoding, attachment=attachment, timeout=10)
                    )
                    assert len(replies) == 1
                    if replies[0].ok is not None:
                        assert len(replies[0].ok.payload) > 0
                    else:
                        assert replies[0].err is not None
                        fault = msgpack.unpackb(replies[0].err.payload.to_bytes())
                        assert fault["error"] in ("Malformed", "ParameterError", "UsageError")
                        assert 0 < len(fault["message"]) < 2000
        (reply,) = other.get(key, payload=right, timeout=10)
        assert reply.ok is not None or right is None
    assert not caplog.records


def test_queries_that_wait_hold_up_no_message(
    session: zenoh.Session, other: zenoh.Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(queries, "MOST_WAITING", 10)
    free, heard = threading.Event(), threading.Event()

    class Slow(Node):
        @service("take")
        def take(self, _request: Trigger.Request) -> Trigger.Response:
            with paused():  # as while it calls another service
                free.wait(30)
            return Trigger.Response()

        @subscribe("words")
        def listen(self, _word: String) -> None:
            heard.set()

    with Slow(namespace="r1", session=session):
        assert not wait_for_nodes(other, ["/r1/slow"], 10)
        for _ in range(300):
            other.get("r1/take", lambda _: None, timeout=30)
        other.put("r1/words", msgpack.packb({"data": "hello"}))
        assert heard.wait(10)
        assert threading.active_count() > 64
        free.set()
        eventually(lambda: sum("r1/take" in t.name for t in threading.enumerate()) <= MOST_IDLE + 1, "the threads end")


def test_an_exception_reaches_the_caller(session: zenoh.Session, other: zenoh.Session) -> None:
    with Server(namespace="r1", session=session) as server, Node(name="me", namespace="r1", session=other) as me:
        double = me.create_client(Double.Request, Double.Response, "double", timeout=5.0)
        with pytest.raises(ServiceError, match="service r1/double: ValueError: 13 brings bad luck") as error:
            double(Double.Request(13))
        assert (error.value.kind, error.value.message) == ("ValueError", "13 brings bad luck")
        assert double(Double.Request(3)).number == 6
        assert server.status.callback_errors == 1
        with pytest.raises(TypeError, match="takes test/Double_Request, not Request"):
            double(Trigger.Request())  # type: ignore[arg-type]


def test_calls_within_callbacks_of_the_same_node_return(session: zenoh.Session, other: zenoh.Session) -> None:
    with Server(namespace="r1", session=session), Node(name="me", namespace="r1", session=other) as me:
        nested = me.create_client(Double.Request, Double.Response, "server/nested", timeout=10.0)
        assert nested(Double.Request(0)).number == 1
        assert nested(Double.Request(1)).number == 1
        assert nested(Double.Request(6)).number == 6


def test_two_nodes_that_call_each_other_return(session: zenoh.Session, other: zenoh.Session) -> None:
    class Ping(Node):
        there = Client(Double.Request, Double.Response, "pong", timeout=5.0)

        @service("ping")
        def ping(self, request: Double.Request) -> Double.Response:
            if request.number <= 0:
                return Double.Response(0)
            return Double.Response(self.there(Double.Request(request.number - 1)).number + 1)

    class Pong(Node):
        back = Client(Double.Request, Double.Response, "ping", timeout=5.0)

        @service("pong")
        def pong(self, request: Double.Request) -> Double.Response:
            return Double.Response(self.back(Double.Request(request.number - 1)).number + 1)

    pong = Pong(namespace="r1", session=other)
    with Ping(namespace="r1", session=session), pong:
        assert pong.back(Double.Request(8), timeout=10.0).number == 8


def test_a_thousand_concurrent_calls_get_their_own_answers(session: zenoh.Session, other: zenoh.Session) -> None:
    with Server(namespace="r1", session=session) as server, Node(name="me", namespace="r1", session=other) as me:
        double = me.create_client(Double.Request, Double.Response, "double", timeout=30.0)
        numbers = [n for n in range(1100) if n not in (13, 99)][:1000]
        with ThreadPoolExecutor(50) as pool:
            answers = list(pool.map(lambda n: double(Double.Request(n)).number, numbers))
        assert answers == [2 * n for n in numbers]
        assert server.status.callback_errors == 0


def test_calls_are_served_in_order(session: zenoh.Session, other: zenoh.Session) -> None:
    order: list[int] = []

    class Ordered(Node):
        @service("take")
        def take(self, request: Double.Request) -> Double.Response:
            order.append(request.number)
            return Double.Response()

    with Ordered(namespace="r1", session=session):
        assert not wait_for_nodes(other, ["/r1/ordered"], 40)
        done = threading.Semaphore(0)
        for i in range(200):
            other.get("r1/take", lambda _: done.release(), payload=msgpack.packb({"number": i}), timeout=40)
        for _ in range(200):
            assert done.acquire(timeout=40)
    assert order == sorted(order)


def test_nobody_serves_or_too_slow(session: zenoh.Session, other: zenoh.Session) -> None:
    with Node(name="me", namespace="r1", session=other) as me:
        double = me.create_client(Double.Request, Double.Response, "double", timeout=0.2)
        begin = time.monotonic()
        with pytest.raises(ServiceTimeout, match=r"service r1/double: nobody serves it \(waited 0.2 s\)"):
            double(Double.Request(1))
        assert time.monotonic() - begin < PATIENCE / 2
        assert not double.wait_for_service(0.05)
        with Server(namespace="r1", session=session):
            assert double.wait_for_service(40.0)
            with pytest.raises(ServiceTimeout, match=r"service r1/double did not answer within 0.2 s"):
                double(Double.Request(99))
            with pytest.raises(TimeoutError):
                double(Double.Request(99), timeout=0.1)


def test_a_server_that_comes_later_is_waited_for(session: zenoh.Session, other: zenoh.Session) -> None:
    with Node(name="me", namespace="r1", session=other) as me:
        double = me.create_client(Double.Request, Double.Response, "double", timeout=10.0)
        with ThreadPoolExecutor(1) as pool:
            answer = pool.submit(double, Double.Request(5))
            with Server(namespace="r1", session=session):
                assert answer.result(10).number == 10


def test_a_server_that_goes_away_ends_the_call(other: zenoh.Session, endpoint: str) -> None:
    leaving = open_session(Network(mode="client", connect=(endpoint,)))
    server = Server(namespace="r1", session=leaving)
    server.start()
    with Node(name="me", namespace="r1", session=other) as me, ThreadPoolExecutor(1) as pool:
        double = me.create_client(Double.Request, Double.Response, "double", timeout=5.0)
        assert double(Double.Request(1)).number == 2
        answer = pool.submit(double, Double.Request(99))
        eventually(lambda: server.inside == 1, "the call has arrived")
        close_session(leaving)
        with pytest.raises(ServiceTimeout, match="service r1/double"):
            answer.result(10)
    server.close()


def test_the_contract_says_what_is_served() -> None:
    node = Server()
    assert [(s.service, s.method) for s in node.contract.services] == [("double", "double"), ("~/nested", "nested")]
    assert {c.attribute for c in node.contract.clients} == {"myself", "doubling"}
    assert SetBool.Response().success


def test_what_is_interrupted_while_it_begins_can_be_stopped(
    session: zenoh.Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C in a tool comes at any moment."""

    def interrupted(_self: threading.Thread) -> None:
        raise KeyboardInterrupt

    loop = queries.QueryLoop(session, "r1/reset", lambda _query, _key: None, acts=["r1/reset"])
    with monkeypatch.context() as patch:
        patch.setattr(threading.Thread, "start", interrupted)
        with pytest.raises(KeyboardInterrupt):
            loop.start()
    assert loop.stop(1.0)
