"""The library for sockets, which is an extra."""

import importlib
from typing import Any

import msgspec

from robo.errors import RunError


class Library(msgspec.Struct):
    """What is used of websockets."""

    serve: Any
    Headers: Any
    Response: Any
    ConnectionClosed: type[Exception]


def import_websockets() -> Library:
    """The library.

    Raises:
        RunError: it is not installed; names the extra.
    """
    try:
        server = importlib.import_module("websockets.asyncio.server")
        structures = importlib.import_module("websockets.datastructures")
        messages = importlib.import_module("websockets.http11")
        exceptions = importlib.import_module("websockets.exceptions")
    except ImportError:
        text = "the bridge needs websockets, which is not installed: pip install 'robo-zenoh[foxglove]'"
        raise RunError(text) from None
    return Library(server.serve, structures.Headers, messages.Response, exceptions.ConnectionClosed)
