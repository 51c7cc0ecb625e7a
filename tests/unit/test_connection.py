"""Whether somebody answers, before a tool opens a session."""

import socket
import time

import pytest
import zenoh

from robo.cli import connection
from robo.cli.connection import unreached
from robo.cli.link import Link
from robo.cli.reach import Reach
from robo.errors import NetworkError
from robo.wire.network import Network
from robo.wire.session import close_session, open_session
from tests.conftest import free_port
from tests.support import eventually


def test_an_address_that_refuses_is_not_tried_for_long() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    begin = time.monotonic()
    wrong = unreached([endpoint], Reach(given_timeout=None))
    assert wrong is not None
    assert isinstance(wrong[endpoint], ConnectionRefusedError)
    assert time.monotonic() - begin >= Reach().refused_timeout


def test_one_that_says_nothing_has_as_long_as_an_answer_may_take() -> None:
    with socket.create_server(("127.0.0.1", 0), backlog=0) as server:
        address = server.getsockname()
        # The system takes no more than these: it passes over who comes next, as if the packet were lost.
        before = [socket.socket() for _ in range(3)]
        for one in before:
            one.setblocking(False)
            one.connect_ex(address)
        begin = time.monotonic()
        wrong = unreached([f"tcp/127.0.0.1:{address[1]}"], Reach(given_timeout=0.8))
        assert wrong is not None
        assert time.monotonic() - begin >= 0.8
        for one in before:
            one.close()
    assert isinstance(wrong.get(f"tcp/127.0.0.1:{address[1]}", TimeoutError()), TimeoutError)


def test_one_that_answers_is_enough() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        endpoints = [f"tcp/127.0.0.1:{free_port()}", f"tcp/127.0.0.1:{server.getsockname()[1]}"]
        assert unreached(endpoints, Reach()) is None
    assert unreached(["unixsock-stream//tmp/nobody.sock"], Reach()) is not None
    assert unreached(["quic/site.example:7447"], Reach()) is None, "it is not to be tried without Zenoh"


def test_a_link_to_a_node_alone_is_a_link_too(endpoint: str) -> None:
    node = open_session(Network(mode="peer", listen=(endpoint,)))
    tool = open_session(Network(mode="client", connect=(endpoint,)))
    link = Link(tool, Reach((endpoint,)))
    assert (link.look(), link.lost) == ("", "")
    close_session(node)
    eventually(lambda: link.look() == f"the link to {endpoint} is lost; it is dialled until it answers", "it is gone")
    assert link.lost == f"the link to {endpoint} is lost"
    close_session(tool)


class HangingRouter:
    """A session whose router takes nothing any more."""

    def __init__(self) -> None:
        self.closed = 0

    def close(self) -> None:
        self.closed += 1
        raise zenoh.ZError("close operation timed out!")


def test_a_router_that_hangs_is_told_in_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    hangs = HangingRouter()
    monkeypatch.setattr(connection, "join_robot", lambda _: hangs)
    told = "has not taken what was said last: close operation timed out"
    with pytest.raises(NetworkError, match=told), connection.connect_to_robot(Reach()):
        pass
    with pytest.raises(KeyboardInterrupt), connection.connect_to_robot(Reach()):
        raise KeyboardInterrupt
    assert hangs.closed == 2
