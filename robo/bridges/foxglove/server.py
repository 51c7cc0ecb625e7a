"""The server of the viewers' protocol: who may connect, and the sockets."""

import asyncio
import http
import math
import socket
import time
from collections.abc import Awaitable, Callable, Sequence
from contextlib import AbstractAsyncContextManager, suppress
from functools import partial
from typing import Any
from urllib.parse import parse_qs, urlsplit

import msgspec
import zenoh

from robo.bridges.foxglove import protocol
from robo.bridges.foxglove.bridge import Bridge, Pools
from robo.bridges.foxglove.client import Client
from robo.bridges.foxglove.protocol import Unreadable
from robo.bridges.foxglove.requests import ask
from robo.web.access import Doorkeeper, Right, Tokens, is_loopback
from robo.web.sockets import import_websockets, listening

_MOST_REQUEST = 16_000_000
"""Of what a client says at once, bytes: it may publish a picture."""
_MOST_REQUESTS = 4
"""That wait until they are read."""
_MOST_CLIENTS = 50
_SEND_BUFFER = 262_144
"""Of the system's, bytes: what waits there is sent however old it becomes, so that little is to wait there."""
_PING, _SILENCE = 5.0, 15.0
"""How often a client is asked whether it is there, and how long it may take to say so, s."""
_FRESH = 0.1
"""Between two questions by which it is known how old commands can be, s."""
VIEWERS = ("https://app.foxglove.dev", "file://")
"""Origins of pages that are viewers: Foxglove's web app, and programs that have their page with them."""


class Settings(msgspec.Struct, frozen=True):
    """Where the server is, and who is let in."""

    name: str = "robo"
    """That viewers show."""
    host: str = "127.0.0.1"
    port: int = 8765
    """0 for any that is free."""
    tokens: Tokens = Tokens()
    """Empty: whoever reaches the port is let in, but for pages of strangers."""
    look: bool = False
    """Whether nobody may do more than look."""
    origins: tuple[str, ...] = ()
    """Pages that may connect without a token beside known viewers; `*` for any."""


class Server:
    """Serves viewers."""

    def __init__(
        self,
        session: zenoh.Session,
        settings: Settings,
        tell: Callable[[str], None] = lambda _: None,
        covers: Callable[[str], bool] = lambda _: True,
        lost: Callable[[], str] = lambda: "",
    ) -> None:
        """
        Args:
            session: the network of the robots.
            settings: where, and for whom.
            tell: is told what whoever runs the server should know.
            covers: which topics and services are offered, by their keys.
            lost: that the robots' network is lost, in a sentence; empty where it is not.

        Raises:
            RunError: the library for the socket is not installed.
        """
        self._websockets = import_websockets("the bridge", "foxglove")
        self._session, self._settings, self._tell = session, settings, tell
        self._covers, self._lost = covers, lost
        self._door = Doorkeeper(settings.tokens)
        self._clients: set[Client] = set()

    async def serve(self, ready: Callable[[int], object], over: Awaitable[object]) -> None:
        """Serve until `over`.

        Args:
            ready: is called with the port once viewers may connect.
            over: ends it.

        Raises:
            NetworkError: the port cannot be had.
        """
        pools = Pools.new()
        bridge = Bridge(self._session, self._settings.name, pools, self._tell, self._covers, self._lost)
        self._clients = bridge.clients
        try:
            async with self._listening(partial(self._connected, bridge)) as port:
                ready(port)
                await over
        finally:
            await bridge.close()
            pools.close()

    def _listening(self, connected: Callable[[Any], Awaitable[None]]) -> AbstractAsyncContextManager[int]:
        o = self._settings
        return listening(
            self._websockets,
            "the bridge",
            o.host,
            o.port,
            connected,
            select_subprotocol=self._spoken,
            process_request=self._judge,
            max_size=_MOST_REQUEST,
            max_queue=_MOST_REQUESTS,
            write_limit=2**16,
            ping_interval=_PING,
            ping_timeout=_SILENCE,
        )

    def _spoken(self, _: Any, offered: Sequence[str]) -> str:
        """Which protocol is spoken: the first one that a client offers, since it knows that best.

        Raises:
            NegotiationError: it offers none that is known here.
        """
        for one in offered:
            if one in protocol.SUBPROTOCOLS:
                return one
        raise self._websockets.NegotiationError(f"this bridge speaks {' and '.join(protocol.SUBPROTOCOLS)}")

    def _judge(self, connection: Any, request: Any) -> Any:
        """What somebody gets who may not connect, or asks for no socket; None for who may."""
        address = str(connection.remote_address[0])
        now = time.monotonic()
        if (wait := self._door.wait(address, now)) > 0:
            return self._words(429, f"too many wrong tokens: again in {math.ceil(wait)} s", str(math.ceil(wait)))
        token = parse_qs(urlsplit(request.path).query).get("token", [""])[0]
        right = self._door.right(token, address, now)
        if right is Right.NONE:
            self._tell(f"{address} was refused: {'its token is wrong' if token else 'it has shown no token'}")
            return self._words(
                401, "this bridge needs a token: open the address that `robo bridge foxglove` has printed"
            )
        if request.headers.get("Upgrade", "").lower() != "websocket":
            return self._words(426, _NO_PAGE)
        origin = request.headers.get("Origin")
        # Who shows a token has been given it; a page of a stranger has none, and no browser shows one for it.
        if not self._settings.tokens.drive and not is_viewer(origin, self._settings.origins):
            self._tell(f"a page of {origin} was refused: --origin {origin} lets it in, where it is a viewer of yours")
            return self._words(403, "a page of this origin may not connect: see --origin of `robo bridge foxglove`")
        if len(self._clients) >= _MOST_CLIENTS:
            return self._words(503, f"{_MOST_CLIENTS} viewers are here already")
        connection.robo_right, connection.robo_since = right, now
        return None

    def _words(self, status: int, text: str, retry: str = "") -> Any:
        body = f"{text}\n".encode()
        headers = self._websockets.Headers({"Content-Type": "text/plain; charset=utf-8", "Connection": "close"})
        headers["Content-Length"] = str(len(body))
        headers["X-Content-Type-Options"] = "nosniff"
        if retry:
            headers["Retry-After"] = retry
        return self._websockets.Response(status, http.HTTPStatus(status).phrase, headers, body)

    async def _connected(self, bridge: Bridge, connection: Any) -> None:
        _keep_little(connection)
        drives = connection.robo_right is Right.DRIVE and not self._settings.look
        client = bridge.join(drives=drives, knows_playback=connection.subprotocol == protocol.SDK)
        client.fresh = connection.robo_since  # it has said nothing before it was let in
        self._tell(f"{client.name} has connected from {connection.remote_address[0]}{'' if drives else ', to look'}")
        loop = asyncio.get_running_loop()
        tasks = [loop.create_task(self._send(client, connection))]
        if drives:
            tasks.append(loop.create_task(self._keep_fresh(client, connection)))
        try:
            async for said in connection:
                try:
                    ask(bridge, client, protocol.read(said))
                except Unreadable as reason:
                    client.status(protocol.ERROR, f"what this viewer says cannot be read: {reason}"[:500])
        except self._websockets.ConnectionClosed:
            pass  # it is gone
        finally:
            bridge.leave(client)
            for task in tasks:
                task.cancel()
            left = client.outbox.left_out.total() + client.outbox.forgotten
            self._tell(f"{client.name} is gone{f', {left:,} messages were left out for it' if left else ''}")

    async def _keep_fresh(self, client: Client, connection: Any) -> None:
        """Know how old what a client says can be: what comes after the answer to a ping was said after the ping.

        One ping is under way at a time, and what has come before its answer has been read before it: a link that was
        held up and lets all go at once makes nothing young.
        """
        with suppress(self._websockets.ConnectionClosed):
            while True:
                sent = time.monotonic()
                await (await connection.ping())
                client.fresh = sent
                await asyncio.sleep(_FRESH)

    async def _send(self, client: Client, connection: Any) -> None:
        """Give a client what waits for it, as long as it takes it."""
        with suppress(self._websockets.ConnectionClosed):
            while not client.is_full:
                frame = client.outbox.take()
                if frame is None:
                    client.wake.clear()
                    await client.wake.wait()
                else:
                    await connection.send(frame)
            await connection.close(1008, "too much waits for this client")


def is_viewer(origin: str | None, origins: tuple[str, ...] = ()) -> bool:
    """Whether a page may connect to a server that asks for no token: a viewer's, or one from this machine.

    Any page that somebody visits may open a socket to his machine, and could drive his robot; but a browser says whose
    page it is. A client that is no browser says nothing.

    Args:
        origin: what it says.
        origins: others that may.
    """
    if origin is None or "*" in origins:
        return True
    try:
        said = urlsplit(origin)
        host = said.hostname
    except ValueError:
        return False
    return origin in VIEWERS or origin in origins or (said.scheme in ("http", "https") and is_loopback(host or ""))


def _keep_little(connection: Any) -> None:
    """Have the system keep little of what is to be sent: the newest is sent, and not what waits in there."""
    found: socket.socket | None = connection.transport.get_extra_info("socket")
    if found is not None:
        with suppress(OSError):
            found.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)


_NO_PAGE = (
    "this is robo's bridge for Foxglove and Lichtblick, and no page.\n"
    "In the viewer: Open connection, Foxglove WebSocket, and this address with ws:// in the place of http://"
)
