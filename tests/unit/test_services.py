"""Answering queries and calls without a network: the queryable and its queries are the test's."""

import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from types import TracebackType
from typing import Any

import msgpack
import msgspec
import pytest
import zenoh

from robo.node.services import ServiceServer, service_token
from robo.node.turn import Turn, paused
from robo.wire.queries import Fault, QueryLoop
from robo_messages import Message, message
from tests.support import PATIENCE, eventually


@message("test_services/Double_Request")
class Ask(Message):
    number: int = 0


@message("test_services/Double_Response")
class Answer(Message):
    number: int = 0


class Payload:
    def __init__(self, data: bytes) -> None:
        self.to_bytes = lambda: data


class Query:
    """A query and what is answered to it."""

    encoding = "zenoh/bytes"

    def __init__(self, key: str, payload: bytes | None = None) -> None:
        self.key_expr = key
        self.payload = None if payload is None else Payload(payload)
        self.replies: list[tuple[str, Any]] = []
        self.faults: list[Fault] = []
        self.gone = False
        self._done = threading.Event()

    def __enter__(self) -> "Query":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._done.set()

    def reply(self, key: str, payload: bytes, *, encoding: str) -> None:
        assert encoding
        if self.gone:
            raise zenoh.ZError("whoever asked is gone")
        self.replies.append((key, msgpack.unpackb(payload)))

    def reply_err(self, payload: bytes, *, encoding: str) -> None:
        assert encoding
        self.faults.append(msgspec.msgpack.decode(payload, type=Fault))

    def done(self) -> "Query":
        assert self._done.wait(PATIENCE)
        return self


class Network:
    """A session with one queryable."""

    def __init__(self) -> None:
        self._queries: deque[Query] = deque()
        self._changed = threading.Condition()
        self._open = True
        self.tokens: list[str] = []
        self.handler = self

    def declare_queryable(self, _key: str, _channel: object, *, complete: bool) -> "Network":
        assert complete
        return self

    def liveliness(self) -> "Network":
        return self

    def declare_token(self, key: str) -> Any:
        self.tokens.append(key)
        return type("Token", (), {"undeclare": lambda _: self.tokens.remove(key)})()

    def ask(self, key: str, request: object = None) -> Query:
        query = Query(key, None if request is None else msgpack.packb(request))
        return self.put(query)

    def put(self, query: Query) -> Query:
        with self._changed:
            self._queries.append(query)
            self._changed.notify_all()
        return query

    def recv(self) -> Query:
        with self._changed:
            assert self._changed.wait_for(lambda: self._queries or not self._open, PATIENCE)
            if not self._queries:
                raise zenoh.ZError("undeclared")
            return self._queries.popleft()

    def undeclare(self) -> None:
        with self._changed:
            self._open = False
            self._changed.notify_all()


@pytest.fixture
def network() -> Iterator[Network]:
    made = Network()
    yield made
    made.undeclare()


def answering(
    network: Any, answer: Callable[[Any, str], None], *, tells: Sequence[str], acts: Sequence[str] = ()
) -> QueryLoop:
    loop = QueryLoop(network, "r1/base/*", answer, acts=acts, tells=tells)
    loop.start()
    return loop


def test_a_query_is_answered_once_for_each_key_that_it_reaches(network: Network) -> None:
    answering(network, lambda query, key: query.reply(key, msgpack.packb(key), encoding="x"), tells=["r1/a", "r1/b"])
    assert network.ask("r1/*").done().replies == [("r1/a", "r1/a"), ("r1/b", "r1/b")]
    assert network.ask("r1/b").done().replies == [("r1/b", "r1/b")]


def test_whoever_reaches_nothing_is_told_what_there_is(network: Network) -> None:
    answering(network, lambda _query, key: pytest.fail(key), acts=["r1/set"], tells=["r1/get"])
    (too_wide,) = network.ask("*/set").done().faults
    assert (too_wide.error, too_wide.message.rpartition(": ")[2]) == ("TooWide", "r1/set")
    (misspelt,) = network.ask("r1/gett").done().faults
    assert (misspelt.error, misspelt.message) == ("UsageError", "nothing is answered on r1/gett; did you mean get?")


def test_a_query_that_goes_wrong_is_answered_and_the_next_one_is_too(network: Network) -> None:
    def answer(query: Query, key: str) -> None:
        if query.payload is None:
            raise ValueError("nothing to answer")
        query.reply(key, msgpack.packb(1), encoding="x")

    answering(network, answer, tells=["r1/get"])
    assert network.ask("r1/get").done().faults == [Fault("ValueError", "nothing to answer")]
    assert network.ask("r1/get", 1).done().replies == [("r1/get", 1)]


def test_whoever_is_gone_before_the_answer_ends_nothing(network: Network) -> None:
    answering(network, lambda query, key: query.reply(key, msgpack.packb(1), encoding="x"), tells=["r1/get"])
    left = Query("r1/get")
    left.gone = True
    network.put(left).done()
    assert network.ask("r1/get").done().replies == [("r1/get", 1)]


def test_a_loop_that_is_stopped_waits_for_its_handler_as_long_as_it_is_granted(network: Network) -> None:
    entered, done = threading.Event(), threading.Event()

    def answer(_query: Query, _key: str) -> None:
        entered.set()
        done.wait(PATIENCE)

    loop = answering(network, answer, tells=["r1/get"])
    network.ask("r1/get")
    assert entered.wait(PATIENCE)
    assert not loop.stop(0.01)
    done.set()
    assert loop.stop(PATIENCE)


def test_a_handler_may_stop_its_own_loop(network: Network) -> None:
    stopped: list[bool] = []
    loop = answering(network, lambda _query, _key: stopped.append(loop.stop(PATIENCE)), tells=["r1/get"])
    network.ask("r1/get").done()
    assert stopped == [True], "it does not wait for itself"


class Server:
    """A service that doubles a number, with all that its handler raises."""

    def __init__(self, network: Any, handler: Callable[[Ask], Any] | None = None) -> None:
        self.errors: list[BaseException] = []
        self.turn = Turn()
        token = service_token("r1", "base", "srv", Ask, Answer, "r1/double")
        self.service = ServiceServer(
            network, token, Ask, Answer, self.turn, handler or self._double, self.errors.append
        )

    def _double(self, request: Ask) -> Answer:
        return Answer(2 * request.number)


def test_a_call_is_answered_and_counted(network: Network) -> None:
    server = Server(network)
    assert network.ask("r1/double", {"number": 21}).done().replies == [("r1/double", {"number": 42})]
    assert network.ask("r1/double").done().replies == [("r1/double", {"number": 0})], "nothing is an empty request"
    as_json = network.put(Query("r1/double", b'{"number": 4}')).done()
    assert as_json.replies == [("r1/double", {"number": 8})]
    assert server.service.served == 3
    assert server.turn.try_acquire(False), "its turn is free again"


def test_a_service_is_announced_while_it_answers(network: Network) -> None:
    server = Server(network)
    assert network.tokens == ["@robo/r1/srv/base/test_services%Double/0/r1%double"]
    assert server.service.stop(PATIENCE)
    assert network.tokens == []


@pytest.mark.parametrize("request_", [{"number": "many"}, [1, 2], "text"])
def test_a_request_that_cannot_be_read_reaches_no_handler(network: Network, request_: object) -> None:
    server = Server(network, lambda request: pytest.fail(str(request)))
    (fault,) = network.ask("r1/double", request_).done().faults
    assert fault.error == "Malformed"
    assert (server.service.served, server.errors) == (0, [])


@pytest.mark.parametrize(
    ("error", "told"),
    [(ValueError("too large"), "too large"), (KeyError("x"), "'x'"), (SystemExit(3), "3"), (KeyboardInterrupt(), "")],
)
def test_what_a_handler_raises_goes_to_the_caller_and_to_the_node(
    network: Network, error: BaseException, told: str
) -> None:
    def fail(_: Ask) -> Answer:
        raise error

    server = Server(network, fail)
    assert network.ask("r1/double", {}).done().faults == [Fault(type(error).__name__, told)]
    assert server.errors == [error]
    server.errors.clear()
    assert network.ask("r1/double", {}).done().faults, "and the next call is answered"


def test_an_answer_of_another_type_is_an_error_of_the_handler(network: Network) -> None:
    server = Server(network, lambda request: request)
    (fault,) = network.ask("r1/double", {}).done().faults
    assert fault == Fault("TypeError", "the handler returned Ask, not Answer")
    assert isinstance(server.errors[0], TypeError)


def test_a_handler_waits_for_the_nodes_turn(network: Network) -> None:
    server = Server(network)
    server.turn.acquire()
    query = network.ask("r1/double", {"number": 1})
    eventually(lambda: bool(server.turn.waiting), "the handler waits")
    assert query.replies == []
    server.turn.release()
    assert query.done().replies == [("r1/double", {"number": 2})]


def test_calls_are_served_in_order(network: Network) -> None:
    seen: list[int] = []

    def note(request: Ask) -> Answer:
        seen.append(request.number)
        return Answer()

    Server(network, note)
    queries = [network.ask("r1/double", {"number": number}) for number in range(50)]
    for query in queries:
        query.done()
    assert seen == list(range(50))


def test_a_handler_that_waits_for_another_service_lets_the_next_call_in(network: Network) -> None:
    inner = threading.Event()

    def outer_or_inner(request: Ask) -> Answer:
        if request.number == 1:
            with paused():  # as a call of a client does
                assert inner.wait(PATIENCE)
        else:
            inner.set()
        return Answer(request.number)

    server = Server(network, outer_or_inner)
    outer = network.ask("r1/double", {"number": 1})
    assert network.ask("r1/double", {"number": 2}).done().replies == [("r1/double", {"number": 2})]
    assert outer.done().replies == [("r1/double", {"number": 1})]
    assert server.service.stop(PATIENCE)
