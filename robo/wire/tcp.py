"""TCP endpoints, also those of TLS: where they are, whether somebody answers, and how connections to them end."""

import fcntl
import os
import queue
import socket
import struct
import sys
import termios
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress

from robo.wire import meeting


def address_of(endpoint: str) -> tuple[str, int] | None:
    """Host and port of a Zenoh endpoint over TCP or TLS; None for another kind."""
    protocol, _, rest = endpoint.partition("/")
    host, _, port = rest.partition("?")[0].partition("#")[0].rpartition(":")
    return (
        (host.strip("[]"), int(port))
        if protocol in ("tcp", "tls") and port.isdecimal() and port.isascii() and int(port) < 65536
        else None
    )


def nearby(endpoint: str) -> str | None:
    """An endpoint to listen at, as this machine itself would dial it; None for another kind than TCP."""
    address = address_of(endpoint)
    if address is None:
        return None
    host = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}.get(address[0])
    return endpoint if host is None else f"{endpoint.partition('/')[0]}/{host}:{address[1]}"


def cannot_listen(endpoint: str) -> OSError | None:
    """Why this process cannot listen at an endpoint over TCP; None where it can, or where that cannot be known."""
    address = address_of(endpoint)
    if address is None:
        return None
    try:
        family, kind, protocol, _, place = socket.getaddrinfo(*address, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(place)
    except OSError as error:
        return error
    return None


class HeldPort:
    """A free port of loopback, held for a process that is told to listen there.

    One that was free a moment ago may be another's by then: the system chooses from the same ports for connections, and
    for whoever else looks for one that is free. Who asks by number gets it although it is held, where he says
    SO_REUSEADDR, as servers do. Other systems than Linux cannot hold a port so.
    """

    def __init__(self) -> None:
        self._holder = socket.socket()
        self._holder.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._holder.bind(("127.0.0.1", 0))
        self.number: int = self._holder.getsockname()[1]
        if sys.platform != "linux":
            self._holder.close()

    def close(self) -> None:
        """Hold it no longer; who listens there goes on."""
        self._holder.close()


def tried(endpoints: Sequence[str], within: float) -> Iterator[tuple[str, OSError | None]]:
    """Try to connect to those of some endpoints that are over TCP, to all at once.

    Yields each with what is wrong, or None if somebody answers, in the order in which it turns out. One of which
    nothing is known in time is left out: a name that cannot be looked up takes 10 s and more to say so.

    Args:
        endpoints: in Zenoh's form.
        within: how long to wait for all of them, s.
    """
    known: queue.SimpleQueue[tuple[str, OSError | None]] = queue.SimpleQueue()
    asked = {endpoint: address for endpoint in endpoints if (address := address_of(endpoint)) is not None}

    def ask(endpoint: str, address: tuple[str, int]) -> None:
        try:
            socket.create_connection(address, timeout=within).close()
        except OSError as error:
            known.put((endpoint, error))
        else:
            known.put((endpoint, None))

    for item in asked.items():
        threading.Thread(target=ask, args=item, daemon=True).start()
    end = time.monotonic() + within
    for _ in asked:
        try:
            yield known.get(timeout=max(0.0, end - time.monotonic()))
        except queue.Empty:
            return


def answering(endpoints: Sequence[str], within: float) -> Iterator[str]:
    """Those of some endpoints where somebody answers in time; as `tried`."""
    return (endpoint for endpoint, wrong in tried(endpoints, within) if wrong is None)


def speaks_zenoh(endpoint: str, within: float) -> bool | None:
    """Whether what listens at an endpoint answers as Zenoh does; None where it says nothing in time, or is over TLS."""
    address = address_of(endpoint)
    if address is None or not endpoint.startswith("tcp/"):
        return None
    try:
        with socket.create_connection(address, timeout=within) as connection:
            connection.sendall(_INIT_SYN)
            connection.settimeout(within)
            answer = connection.recv(3)
    except OSError:
        return None
    if not answer:
        return None
    # A length of two bytes, then a message of kind 1 (init) that is an answer (bit 5).
    return len(answer) == 3 and answer[2] & 0x3F == 0x21


_INIT_SYN = bytes.fromhex("2000c109f2dbc794ecefc1319f7bda204e27c220260ac8ff81c205f183b0b2092701")
"""What a client of Zenoh 1 says first."""


def reason(error: OSError) -> str:
    """Why an endpoint cannot be reached, in words."""
    match error:
        case ConnectionRefusedError() | FileNotFoundError():
            return "nobody listens there"
        case TimeoutError():
            return "no answer"
        case socket.gaierror():
            return "there is no host of that name"
        case _:
            return f"it cannot be reached ({error.strerror or error})"


def listener(port: int, uid: int | None = None) -> str:
    """Who listens at a port of this machine, as ` by process 17 (python3)`; empty where that cannot be known.

    Args:
        port: the number.
        uid: whose it is, where that is known and to be told: ` by process 17 (python3) of user alice`.
    """
    import psutil

    of = f" of user {meeting.user_name(uid)}" if uid is not None else ""
    try:
        for one in psutil.net_connections("tcp"):
            if one.status == psutil.CONN_LISTEN and one.laddr and one.laddr[1] == port and one.pid is not None:
                return f" by process {one.pid} ({psutil.Process(one.pid).name()}){of}"
    except psutil.Error:
        pass
    return of.replace(" of ", " by ")


DEAD_AFTER = 2.0
"""How long the other end of a connection on this machine may take nothing of what waits for it, s."""


def end_without_waiting(here: str, there: str) -> None:
    """Let a TCP connection of this process end without holding up the process.

    Zenoh (1.10) tells every socket to wait in `close` until the other end has taken all, for up to 10 s, and
    has no setting for it. Where that end is stopped or its cable is cut, a thread of Zenoh stands still for so
    long, and all that passes through it. Here `close` comes back at once, and the system sends what is left.

    A connection within this machine, where no message is ever lost on the way, also ends where its other end
    is stopped and reads no more. Elsewhere a bad link takes its time.

    Args:
        here: Zenoh's name of this end, `tcp/127.0.0.1:56888`; what else is open here stays as it is.
        there: of the other.
    """
    ports = _port(here), _port(there)
    for name in os.listdir("/dev/fd"):
        try:
            found = socket.socket(fileno=int(name))
        except OSError:
            continue  # no socket, or closed meanwhile
        try:
            if found.type != socket.SOCK_STREAM or found.family not in (socket.AF_INET, socket.AF_INET6):
                continue
            if (found.getsockname()[1], found.getpeername()[1]) == ports:
                found.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _NO_LINGER)
                if found.getpeername()[0] in LOOPBACK and hasattr(socket, "TCP_USER_TIMEOUT"):
                    found.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, round(DEAD_AFTER * 1000))
        except OSError:
            continue  # it listens, or was closed meanwhile
        finally:
            found.detach()  # it is Zenoh's


def unsent() -> int:
    """How many bytes wait in connections of this process for other ends to take them; 0 where that cannot be known."""
    waiting = 0
    for name in os.listdir("/dev/fd"):
        with suppress(OSError):  # it is no connection, or was closed meanwhile
            waiting += int.from_bytes(fcntl.ioctl(int(name), termios.TIOCOUTQ, bytes(4)), sys.byteorder)
    return waiting


def _port(locator: str) -> int:
    digits = locator.partition("?")[0].partition("#")[0].rpartition(":")[2]
    return int(digits) if digits.isdecimal() else 0


_NO_LINGER = struct.pack("ii", 0, 0)
LOOPBACK = ("127.0.0.1", "::1", "::ffff:127.0.0.1")
"""Addresses of this machine, between which nothing gets lost."""
