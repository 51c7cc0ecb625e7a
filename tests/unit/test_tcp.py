"""TCP endpoints."""

import socket
import struct
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing, suppress

import pytest

from robo.wire import tcp
from robo.wire.network import Network
from robo.wire.session import close_session, open_session
from tests.conftest import free_port


@pytest.fixture
def listening() -> Iterator[str]:
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield f"tcp/127.0.0.1:{server.getsockname()[1]}"


@pytest.mark.parametrize(
    ("endpoint", "address"),
    [
        ("tcp/127.0.0.1:7447", ("127.0.0.1", 7447)),
        ("tcp/[::1]:7447", ("::1", 7447)),
        ("tcp/site.example:7447?prio=1#iface=eth0", ("site.example", 7447)),
        ("unixsock-stream//tmp/router.sock", None),
        ("tls/site.example:7447", ("site.example", 7447)),
        ("quic/site.example:7447", None),
        ("tcp/site.example:http", None),
        ("tcp/site.example:70000", None),
    ],
)
def test_where_an_endpoint_is(endpoint: str, address: tuple[str, int] | None) -> None:
    assert tcp.address_of(endpoint) == address


def test_who_answers_is_told_and_what_is_wrong_with_others(listening: str) -> None:
    refusing = f"tcp/127.0.0.1:{free_port()}"
    found = dict(tcp.tried([refusing, listening, "unixsock-stream//tmp/router.sock"], 5.0))
    assert found.keys() == {refusing, listening}
    assert found[listening] is None
    assert isinstance(found[refusing], ConnectionRefusedError)


def test_a_name_that_nobody_looks_up_holds_nobody_up(listening: str, monkeypatch: pytest.MonkeyPatch) -> None:
    answered = threading.Event()
    connect = socket.create_connection

    def hang(address: tuple[str, int], timeout: float) -> socket.socket:
        if address[0] == "site.example":
            answered.wait(60)
            raise OSError("no such name")
        return connect(address, timeout)

    monkeypatch.setattr(socket, "create_connection", hang)
    begin = time.monotonic()
    assert next(tcp.answering(["tcp/site.example:7447", listening], 20.0)) == listening
    assert list(tcp.answering(["tcp/site.example:7447"], 0.05)) == []
    assert time.monotonic() - begin < 10
    answered.set()


def test_connections_end_without_holding_anybody_up(listening: str) -> None:
    address = tcp.address_of(listening)
    assert address is not None
    with socket.create_connection(address) as connection, socket.create_connection(address) as of_a_user:
        for one in (connection, of_a_user):
            one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 10))
        tcp.end_without_waiting(f"tcp/127.0.0.1:{connection.getsockname()[1]}", listening)
        assert struct.unpack("ii", connection.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8))[0] == 0
        assert connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) == tcp.DEAD_AFTER * 1000
        assert struct.unpack("ii", of_a_user.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8)) == (1, 10)
        assert of_a_user.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) == 0
        assert connection.getpeername() == address, "and goes on"


def test_what_others_have_not_taken_is_known() -> None:
    before = tcp.unsent()
    one, other = socket.socketpair()
    with one, other:
        one.setblocking(False)
        with suppress(BlockingIOError):
            while True:
                one.send(bytes(100_000))
        assert tcp.unsent() > before + 50_000
        other.setblocking(False)
        with suppress(BlockingIOError):
            while True:
                other.recv(100_000)
        assert tcp.unsent() < before + 50_000


@pytest.mark.parametrize(("answer", "speaks"), [(b"HTTP/1.0 400", False), (b"", None), (b"\x20\x00\xe1\x09", True)])
def test_what_speaks_zenoh_is_told_by_its_answer(answer: bytes, speaks: bool | None) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            connection, _ = server.accept()
            with connection:
                connection.recv(100)
                connection.sendall(answer)

        serving = threading.Thread(target=serve)
        serving.start()
        assert tcp.speaks_zenoh(f"tcp/127.0.0.1:{server.getsockname()[1]}", 10.0) is speaks
        serving.join()


@pytest.mark.skipif(sys.platform != "linux", reason="other systems cannot hold a port")
def test_a_held_port_is_for_who_asks_for_it_by_number() -> None:
    with closing(tcp.HeldPort()) as port:
        address = ("127.0.0.1", port.number)
        with socket.socket() as any_of_them, pytest.raises(OSError, match="in use"):
            any_of_them.bind(address)  # as the system looks for one that is free
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(address)
        for _ in range(2):  # a router that is started again gets it again
            with socket.create_server(address) as server, socket.create_connection(address):
                server.accept()[0].close()
        router = open_session(Network(mode="peer", listen=(f"tcp/127.0.0.1:{port.number}",)))
        socket.create_connection(address).close()
        close_session(router)
    with socket.create_server(address):
        pass
