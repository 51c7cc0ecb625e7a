"""Parameters that change while a node runs, as other nodes and foreign clients change them."""

import json
import threading
import time
from collections.abc import Iterator, Set
from typing import Annotated, Any, Literal

import msgpack
import msgspec
import pytest
import zenoh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from msgspec import Meta

import robo
from robo import READ_ONLY, Node, ParameterError, Publisher, Unit, timer
from robo.testing import Clock, RunNode
from robo.testing.heard import Heard
from robo.tools import parameters as tools
from robo.wire.keys import NodeToken
from robo.wire.queries import read_fault
from robo_messages import String
from tests.support import PATIENCE


class Gains(msgspec.Struct, frozen=True):
    p: Annotated[float, Meta(ge=0)] = 1.0
    i: float = 0.0


class Base(Node):
    """Has parameters of every kind."""

    class Parameters(robo.Parameters):
        speed: Annotated[float, Meta(ge=-5, le=5, description="how fast"), Unit("m/s")] = 0.5
        rate: Annotated[float, Meta(gt=0)] = 20.0
        mode: Literal["slow", "fast"] = "slow"
        gains: Gains = Gains()
        frame: Annotated[str, READ_ONLY] = "base_link"
        names: list[str] = msgspec.field(default_factory=list)

    parameters: Parameters
    beat = Publisher(String, "beat")

    def on_start(self) -> None:
        self.told: list[set[str]] = []

    def on_parameters_changing(self, new: Parameters) -> None:
        if new.mode == "fast" and new.speed < 1:
            raise ValueError("fast needs a speed of at least 1 m/s")

    def on_parameters_changed(self, names: Set[str]) -> None:
        self.told.append(set(names))

    @timer(rate="rate")
    def tick(self) -> None:
        self.beat.publish(String(f"{self.parameters.speed} {self.parameters.gains.p}"))


def ask(session: zenoh.Session, verb: str, request: object = None, *, as_json: bool = False) -> Any:
    payload = None if request is None else json.dumps(request).encode() if as_json else msgpack.packb(request)
    (reply,) = session.get(f"r1/base/parameters/{verb}", payload=payload, timeout=40)
    if reply.ok is None:
        assert reply.err is not None
        raise RuntimeError(msgpack.unpackb(reply.err.payload.to_bytes())["message"])
    answer = reply.ok.payload.to_bytes()
    return json.loads(answer) if as_json else msgpack.unpackb(answer)


@pytest.fixture
def base(run_node: RunNode) -> Base:
    return run_node(Base, namespace="r1").node


@pytest.fixture
def threaded(robo_session: zenoh.Session) -> Iterator[Base]:
    """One whose threads run as they like, as in its process."""
    with Base(namespace="r1", session=robo_session) as node:
        yield node


@pytest.fixture
def other(robo_session: zenoh.Session) -> zenoh.Session:
    """A plain client of its network."""
    return robo_session


def test_any_client_reads_and_sets(base: Base, other: zenoh.Session) -> None:
    assert ask(other, "list")["names"] == [
        "speed",
        "rate",
        "mode",
        "gains.p",
        "gains.i",
        "frame",
        "names",
        "use_sim_time",
    ]
    assert ask(other, "get", {"names": ["speed", "gains.p"]}) == {"speed": 0.5, "gains.p": 1.0}
    assert ask(other, "set", {"speed": 1, "gains.p": 2.5}) == {"successful": True, "reason": ""}
    assert ask(other, "set", {"gains": {"i": 3}}, as_json=True) == {"successful": True, "reason": ""}
    assert base.parameters.gains == Gains(2.5, 3.0)
    described = ask(other, "describe", {"names": ["speed"]}, as_json=True)["speed"]
    assert described == {
        "name": "speed", "type": "float", "default": 0.5, "value": 1.0, "description": "how fast", "unit": "m/s",
        "constraints": {"ge": -5, "le": 5}, "read_only": False,
    }  # fmt: skip
    assert base.told == [{"speed", "gains.p"}, {"gains.i"}]
    explained = ask(other, "explain", {"names": ["speed"]})["speed"]
    assert explained == [{"value": 0.5, "source": "declared default"}, {"value": 1.0, "source": "set while running"}]


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"speed": 99}, "/r1/base: speed = 99: expected float <= 5.0 (how fast, m/s; -5 to 5)"),
        ({"speed": float("nan")}, "speed = nan: expected float >= -5.0"),
        ({"gains.i": float("inf")}, "gains.i = inf: expected a finite number"),
        ({"sped": 1}, "/r1/base has no parameter 'sped'; did you mean speed?"),
        ({"frame": "x"}, "frame is read-only; start the node with another value"),
        ({"mode": "fast"}, "/r1/base refuses: fast needs a speed of at least 1 m/s"),
        ({"speed": 2.0, "gains.p": -1}, "gains.p = -1: expected float >= 0.0"),
        ({"speed": 2.0, "gains": 7}, "no parameter 'gains'"),
        ({}, "expected a map from names to values"),
    ],
)
def test_a_refused_change_changes_nothing_and_says_why(
    changes: dict[str, object], reason: str, base: Base, other: zenoh.Session
) -> None:
    before = ask(other, "get")
    answer = ask(other, "set", changes)
    assert not answer["successful"]
    assert reason in answer["reason"]
    assert ask(other, "get") == before
    assert base.told == []


def test_events_tell_of_changes_and_timers_follow_at_once(run_node: RunNode, clock: Clock) -> None:
    node = run_node(Base, namespace="r1")
    base = node.node
    clock.advance(0.05)
    assert len(node.published("beat")) == 1
    base.set_parameters(rate=0.01)
    clock.advance(1.0)
    assert len(node.published("beat")) == 1
    base.set_parameters({"rate": 50.0}, speed=2.0)
    clock.advance(0.06)
    assert node.published("beat")[1:] == [String("2.0 1.0")] * 4  # the first at once: it is overdue by the new rate
    events = node.published("parameter_events")
    assert [[p.name for p in event.changed_parameters] for event in events] == [["rate"], ["speed", "rate"]]
    assert events[0].node == "/r1/base"


def test_a_callback_may_set_its_own_parameters(run_node: RunNode, clock: Clock) -> None:
    class Counting(Base):
        @timer(rate=100.0)
        def count(self) -> None:
            if self.parameters.speed < 3:
                self.set_parameters(speed=self.parameters.speed + 0.5)

    node = run_node(Counting, name="base", namespace="r1")
    clock.advance(0.1)
    told = [event.changed_parameters[0].value for event in node.published("parameter_events")]
    assert told == [1.0, 1.5, 2.0, 2.5, 3.0]


def test_a_hook_that_fails_refuses(run_node: RunNode) -> None:
    class Broken(Base):
        def on_parameters_changing(self, new: Base.Parameters) -> None:
            raise KeyError(f"oops {new.speed}")

    node = run_node(Broken, name="base", namespace="r1")
    with pytest.raises(ParameterError, match=r"refuses: 'oops 1\.0'"):
        node.set(speed=1.0)
    assert node.node.parameters.speed == 0.5
    assert node.node.status.callback_errors == 1


@pytest.mark.usefixtures("threaded")
def test_many_sets_from_many_clients_lose_and_tear_nothing(other: zenoh.Session) -> None:
    """Each client sets two values that belong together; events come in the order of the sets."""
    count = 500
    heard = Heard(other, "r1/*")
    heard.wait_for_count("r1/beat", 1, PATIENCE)

    def work(client: int) -> None:
        for i in range(count):
            value = client + i / count
            assert ask(other, "set", {"speed": value, "gains.p": value})["successful"]

    threads = [threading.Thread(target=work, args=(client,)) for client in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    last = ask(other, "get", {"names": ["speed", "gains.p"]})
    assert last["speed"] == last["gains.p"]
    heard.wait_for(
        "r1/parameter_events", lambda event: {p.name: p.value for p in event.changed_parameters} == last, PATIENCE
    )
    events = heard.messages("r1/parameter_events")
    assert {p.name: p.value for p in events[-1].changed_parameters} == last, "the last event is the last set"
    for beat in heard.messages("r1/beat"):
        speed, p = beat.data.split()
        assert speed == p or (speed, p) == ("0.5", "1.0")
    per_client: dict[int, list[float]] = {}
    for event in events:
        value = next(p.value for p in event.changed_parameters if p.name == "speed")
        per_client.setdefault(int(value), []).append(value)
    assert all(values == sorted(values) for values in per_client.values())
    assert sum(map(len, per_client.values())) >= 4 * count - 4  # a value set twice in a row is no change
    heard.close()


requests = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=10) | st.binary(max_size=10),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=6), inner, max_size=3),
    max_leaves=10,
)
named = st.dictionaries(
    st.sampled_from(["speed", "mode", "gains", "gains.p", "frame", "names", "x"]), requests, max_size=3
)


@given(st.one_of(requests, named), st.binary(max_size=64))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=60)
def test_fuzzed_requests_are_refused_or_leave_valid_values(
    base: Base, other: zenoh.Session, request: object, noise: bytes
) -> None:
    before = ask(other, "get")
    try:
        payload = msgpack.packb(request)
    except (OverflowError, ValueError):
        payload = noise
    for body in (payload, noise, payload[: len(payload) // 2]):
        for verb in ("set", "get", "describe", "explain", "list", "nonsense"):
            list(other.get(f"r1/base/parameters/{verb}", payload=body, timeout=40))
    after = ask(other, "get")
    assert after == before or base.told
    assert -5 <= after["speed"] <= 5
    assert after["frame"] == "base_link"


def test_huge_and_deep_requests_are_refused(base: Base, other: zenoh.Session) -> None:
    for payload in (b"x" * 2_000_000, b"\x91" * 100_000, b"[" * 100_000, b"\x81\xa1x" * 50_000):
        (reply,) = other.get("r1/base/parameters/set", payload=payload, timeout=40)
        assert reply.ok is None or not msgpack.unpackb(reply.ok.payload.to_bytes())["successful"]
    assert base.parameters == Base.Parameters()


@pytest.mark.usefixtures("base")
def test_one_query_reads_the_parameters_of_all_nodes(run_node: RunNode, other: zenoh.Session) -> None:
    run_node(Base, name="second", namespace="r1")
    keys = {str(r.ok.key_expr) for r in other.get("r1/*/parameters/get", timeout=40) if r.ok}
    assert keys == {"r1/base/parameters/get", "r1/second/parameters/get"}


def test_a_set_waits_for_the_callback_that_runs(robo_session: zenoh.Session) -> None:
    class Slow(Base):
        @timer(rate=10.0)
        def dawdle(self) -> None:
            before = self.parameters
            time.sleep(0.05)
            assert self.parameters is before

    with Slow(name="base", namespace="r1", session=robo_session) as node:
        for i in range(10):
            assert ask(robo_session, "set", {"speed": i / 10 + 1})["successful"]
        assert node.status.callback_errors == 0


def test_a_rate_that_no_timer_can_keep_is_refused(run_node: RunNode, clock: Clock) -> None:
    class Ticker(Node):
        class Parameters(robo.Parameters):
            rate: float = 100.0
            period: float = 0.01

        parameters: Parameters
        beat = Publisher(String, "beat")

        def on_start(self) -> None:
            self.create_timer(lambda: self.parameters.period, lambda: None)

        @timer(rate="rate")
        def tick(self) -> None:
            self.beat.publish(String())

    node = run_node(Ticker, namespace="r1")
    for name, said in (("rate", ": rate: a timer's rate of"), ("period", " refuses: a timer's period of")):
        for value in (0, -1, 1e-300, 1e300):
            with pytest.raises(ParameterError, match=f"^/r1/ticker{said} .*: use 1e-"):
                node.node.set_parameters({name: value})
    assert node.node.parameters == Ticker.Parameters()
    clock.advance(0.02)
    assert len(node.published("beat")) == 2
    with pytest.raises(ParameterError, match=r"^/r1/ticker: rate: a timer's rate of 0\.0 Hz"):
        run_node(Ticker, namespace="r1", rate=0)


def test_an_answer_that_lacks_what_was_asked_for_is_told(other: zenoh.Session) -> None:
    token = NodeToken("r1", "ghost", "m:Ghost", 1, "here")

    def answer(query: zenoh.Query) -> None:
        with query:
            query.reply(query.key_expr, msgpack.packb({"rate": []}))

    served = other.declare_queryable("r1/ghost/parameters/*", answer)
    for ask in (tools.get, tools.explain):
        with pytest.raises(ParameterError, match="the answer of /r1/ghost cannot be read: it lacks width"):
            ask(other, token, ["width"])
    with pytest.raises(ParameterError, match="it lacks rate"):
        tools.explain(other, token, ["rate"])
    served.undeclare()


def test_a_large_request_holds_up_no_callback(threaded: Base, other: zenoh.Session) -> None:
    entered, done = threading.Event(), threading.Event()

    def block() -> None:
        entered.set()
        done.wait(PATIENCE)

    threaded.create_timer(0.001, block)
    assert entered.wait(PATIENCE)  # from here on the node's turn is held
    try:
        many = {f"spee{number}": number for number in range(10_000)}
        for verb, request in (("set", many), ("get", list(many)), ("describe", {"names": list(many)})):
            (reply,) = other.get(f"r1/base/parameters/{verb}", payload=msgpack.packb(request), timeout=40)
            fault = read_fault(reply)
            assert fault is not None
            assert fault.message == "the request names 10,000 parameters; name at most 1,000"
        fewer = dict(list(many.items())[:1000])
        (reply,) = other.get("r1/base/parameters/set", payload=msgpack.packb(fewer), timeout=40)
        assert reply.ok is not None
        answer = msgpack.unpackb(reply.ok.payload.to_bytes())
        assert not answer["successful"]
        assert len(answer["reason"].splitlines()) == 21
    finally:
        done.set()
