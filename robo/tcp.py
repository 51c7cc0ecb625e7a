"""TCP endpoints: where they are, and whether somebody answers there."""

import queue
import socket
import threading
import time
from collections.abc import Iterator, Sequence


def address_of(endpoint: str) -> tuple[str, int] | None:
    """Host and port of a Zenoh endpoint over TCP; None for another kind."""
    protocol, _, rest = endpoint.partition("/")
    host, _, port = rest.partition("?")[0].partition("#")[0].rpartition(":")
    return (
        (host.strip("[]"), int(port))
        if protocol == "tcp" and port.isdecimal() and port.isascii() and int(port) < 65536
        else None
    )


def nearby(endpoint: str) -> str | None:
    """An endpoint to listen at, as this machine itself would dial it; None for another kind than TCP."""
    address = address_of(endpoint)
    if address is None:
        return None
    host = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}.get(address[0])
    return endpoint if host is None else f"tcp/{host}:{address[1]}"


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


def reason(error: OSError) -> str:
    """Why an endpoint cannot be reached, in words."""
    match error:
        case ConnectionRefusedError():
            return "nobody listens there"
        case TimeoutError():
            return "no answer"
        case socket.gaierror():
            return "there is no host of that name"
        case _:
            return f"it cannot be reached ({error.strerror or error})"


def listener(port: int) -> str:
    """Who listens at a port of this machine, as ` by process 17 (python3)`; empty where that cannot be known."""
    import psutil

    try:
        for one in psutil.net_connections("tcp"):
            if one.status == psutil.CONN_LISTEN and one.laddr and one.laddr[1] == port and one.pid is not None:
                return f" by process {one.pid} ({psutil.Process(one.pid).name()})"
    except psutil.Error:
        pass
    return ""
