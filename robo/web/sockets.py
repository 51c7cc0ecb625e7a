"""The library for sockets, which is an extra, and a server that listens by it."""

import importlib
import os
import socket
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from typing import Any

import msgspec

from robo.errors import NetworkError, RunError
from robo.web.limits import WaitingRoom

_MOST_WAITING = 100
"""Connections that have not been let in: beyond them the one that has waited longest is closed."""
_PATIENCE = 5.0
"""So long one may take until it has said what it wants, s."""
_RECEIVE_BUFFER = 32_768
"""Bytes."""


class Library(msgspec.Struct):
    """What is used of websockets."""

    serve: Any
    ServerConnection: type[Any]
    Headers: Any
    Response: Any
    ConnectionClosed: type[Exception]
    NegotiationError: type[Exception]


def import_websockets(what: str, extra: str) -> Library:
    """The library.

    Args:
        what: needs it: `the bridge`.
        extra: that has it.

    Raises:
        RunError: it is not installed; names the extra.
    """
    try:
        server = importlib.import_module("websockets.asyncio.server")
        structures = importlib.import_module("websockets.datastructures")
        messages = importlib.import_module("websockets.http11")
        exceptions = importlib.import_module("websockets.exceptions")
    except ImportError:
        text = f"{what} needs websockets, which is not installed: pip install 'robo-zenoh[{extra}]'"
        raise RunError(text) from None
    return Library(
        server.serve,
        server.ServerConnection,
        structures.Headers,
        messages.Response,
        exceptions.ConnectionClosed,
        exceptions.NegotiationError,
    )


@asynccontextmanager
async def listening(
    library: Library, what: str, host: str, port: int, connected: Callable[[Any], Awaitable[None]], **options: Any
) -> AsyncIterator[int]:
    """A server that listens, and on which port.

    Args:
        library: its own.
        what: is served: `the bridge`.
        host: the address.
        port: 0 for any that is free.
        connected: has a connection, until it returns.
        options: of websockets' `serve`.

    Raises:
        NetworkError: the port cannot be had.
    """
    room: WaitingRoom[Any] = WaitingRoom(_MOST_WAITING)

    async def let_in(connection: Any) -> None:
        room.leave(connection)
        await connected(connection)

    try:
        server = await library.serve(
            let_in,
            host,
            port,
            create_connection=_counted(library, room),
            open_timeout=_PATIENCE,
            compression=None,  # numbers gain little, and cost much
            close_timeout=1.0,
            server_header=None,
            **options,
        )
    except (OSError, OverflowError, UnicodeError) as error:
        # asyncio puts the address into its words once more; those of a name server have no other number.
        number = getattr(error, "errno", None) or 0
        reason = os.strerror(number) if number > 0 else getattr(error, "strerror", None) or error
        raise NetworkError(f"{what} cannot be at {host}:{port}: {reason}; --listen says another place") from None
    for listener in server.sockets:
        # Those that are accepted have the same: what somebody sends in a flood is read a little at a time.
        with suppress(OSError):
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
    try:
        yield next(iter(server.sockets)).getsockname()[1]
    finally:
        server.close()
        await server.wait_closed()


def _counted(library: Library, room: WaitingRoom[Any]) -> Callable[..., Any]:
    """Connections that wait in a room until they are let in: nobody keeps others out by saying nothing."""

    class Counted(library.ServerConnection):  # type: ignore[misc,name-defined]
        def connection_made(self, transport: Any) -> None:
            super().connection_made(transport)
            longest = room.enter(self)
            if longest is not None:
                longest.transport.abort()

        def connection_lost(self, error: Exception | None) -> None:
            room.leave(self)
            super().connection_lost(error)

    return Counted
