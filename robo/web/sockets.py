"""The library for sockets, which is an extra, and a server that listens by it."""

import importlib
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import Any

import msgspec

from robo.errors import NetworkError, RunError


class Library(msgspec.Struct):
    """What is used of websockets."""

    serve: Any
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
        server.serve, structures.Headers, messages.Response, exceptions.ConnectionClosed, exceptions.NegotiationError
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
    try:
        server = await library.serve(
            connected,
            host,
            port,
            compression=None,  # numbers gain little, and cost much
            close_timeout=1.0,
            server_header=None,
            **options,
        )
    except (OSError, OverflowError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise NetworkError(f"{what} cannot be at {host}:{port}: {reason}; --listen says another place") from None
    try:
        yield next(iter(server.sockets)).getsockname()[1]
    finally:
        server.close()
        await server.wait_closed()
