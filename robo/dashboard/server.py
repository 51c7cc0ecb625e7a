"""The server of the page: its files, and the socket by which it hears and says everything else."""

import asyncio
import http
import importlib
import math
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from functools import partial
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs, urlsplit

import msgspec
import zenoh

from robo.dashboard import files, protocol
from robo.dashboard.access import Doorkeeper, Right, Tokens, is_own_host, is_own_origin
from robo.dashboard.driver import Driver
from robo.dashboard.files import Answer
from robo.dashboard.hub import BEAT, Hub, Page
from robo.dashboard.state import State
from robo.dashboard.topics import Topics
from robo.errors import NetworkError, RunError

SOCKET = "/socket"
COOKIE = "robo_dashboard"
_MOST_REQUEST = 100_000
"""Of what a page says at once, bytes."""
_CLOSED_TO = 4403
"""The code by which a socket is closed to somebody without a right."""
_SILENCE = 5.0
"""A page that says nothing for so long is gone, s: it acknowledges ten beats a second."""


class Settings(msgspec.Struct, frozen=True):
    """Where the page is, and who is let in."""

    host: str = "127.0.0.1"
    port: int = 8080
    """0 for any that is free."""
    tokens: Tokens = Tokens()
    """Empty for no tokens, on this machine alone."""
    names: tuple[str, ...] = ()
    """By which the page may be called beside those of this machine; `*` for any."""


class Dashboard:
    """Serves the page."""

    def __init__(self, session: zenoh.Session, settings: Settings) -> None:
        """
        Args:
            session: the network of the robots.
            settings: where, and for whom.

        Raises:
            RunError: the library for the socket is not installed.
        """
        self._websockets = import_websockets()
        self._session = session
        self._settings = settings
        self._door = Doorkeeper(settings.tokens)

    async def serve(self, ready: Callable[[int], object], over: Awaitable[object]) -> None:
        """Serve until `over`.

        Args:
            ready: is called with the port once pages are served.
            over: ends it.

        Raises:
            NetworkError: the port cannot be had.
        """
        loop = asyncio.get_running_loop()
        calls, stops = ThreadPoolExecutor(8, "robo-dashboard-call"), ThreadPoolExecutor(2, "robo-dashboard-stop")
        driver = Driver(self._session)
        hub: Hub

        def on_loop(work: Callable[[Any], None]) -> Callable[[Any], None]:
            return lambda what: loop.call_soon_threadsafe(work, what)  # type: ignore[func-returns-value]

        topics = Topics(self._session, on_loop(lambda what: hub.messages(what)))
        hub = Hub(self._session, topics, driver, calls, stops)
        state: State | None = None
        try:
            state = State(self._session, on_loop(hub.looked), on_loop(hub.lines), on_loop(hub.events))
            beats = loop.create_task(_every(BEAT, hub.beat))
            try:
                async with self._listening(partial(self._page, hub)) as server:
                    ready(next(iter(server.sockets)).getsockname()[1])
                    await over
            finally:
                beats.cancel()
        finally:
            driver.close()
            topics.close()
            if state is not None:
                await loop.run_in_executor(None, state.close)
            for pool in (calls, stops):
                pool.shutdown(wait=False, cancel_futures=True)

    @asynccontextmanager
    async def _listening(self, page: Callable[[Any], Awaitable[None]]) -> AsyncIterator[Any]:
        o = self._settings
        server = self._websockets.serve(
            page,
            o.host,
            o.port,
            process_request=self._answer,
            compression=None,  # binary messages gain little, and cost much
            max_size=_MOST_REQUEST,
            write_limit=2**16,
            ping_interval=None,  # beats are acknowledged
            close_timeout=1.0,
            server_header=None,
        )
        try:
            listening = await server
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or error
            raise NetworkError(f"the page cannot be at {o.host}:{o.port}: {reason}") from None
        try:
            yield listening
        finally:
            listening.close()
            await listening.wait_closed()

    def _answer(self, connection: Any, request: Any) -> Any:
        """A file; None for a socket that may be opened."""
        url = urlsplit(request.path)
        host = request.headers.get("Host", "")
        address = connection.remote_address[0]
        if not is_own_host(host, self._settings.names):
            return self._respond(files.text(http.HTTPStatus.MISDIRECTED_REQUEST, _WRONG_NAME.format(host=host)))
        now = time.monotonic()
        if (wait := self._door.wait(address, now)) > 0:
            retry = str(math.ceil(wait))
            words = f"too many wrong tokens: again in {retry} s"
            return self._respond(files.text(http.HTTPStatus.TOO_MANY_REQUESTS, words, Retry_After=retry))
        given = parse_qs(url.query).get("token", [""])[0]
        right = self._door.right(given or _cookie(request.headers), address, now)
        if right is Right.NONE:
            return self._respond(files.text(http.HTTPStatus.UNAUTHORIZED, _NO_TOKEN))
        if given:  # so that it does not stay in the address
            cookie = f"{COOKIE}={given}; HttpOnly; SameSite=Strict; Path=/"
            return self._respond(files.text(http.HTTPStatus.SEE_OTHER, "", Location="/", Set_Cookie=cookie))
        if url.path != SOCKET:
            return self._respond(files.answer(url.path))
        if not is_own_origin(request.headers.get("Origin"), host):
            return self._respond(files.text(http.HTTPStatus.FORBIDDEN, "another page may not use this socket"))
        connection.robo_right = right
        return None

    def _respond(self, answer: Answer) -> Any:
        headers = self._websockets.Headers(answer.headers)
        headers["Content-Length"] = str(len(answer.body))
        headers["Connection"] = "close"
        return self._websockets.Response(answer.status.value, answer.status.phrase, headers, answer.body)

    async def _page(self, hub: Hub, connection: Any) -> None:
        page = hub.join(connection.robo_right)
        sending = asyncio.get_running_loop().create_task(_send(page, connection))
        try:
            while True:
                async with asyncio.timeout(_SILENCE):
                    said = await connection.recv()
                hub.ask(page, protocol.request(said))
        except (TimeoutError, self._websockets.ConnectionClosed):
            pass  # it is gone
        except msgspec.MsgspecError as error:
            await connection.close(1007, f"that is no request: {error}"[:100])
        finally:
            hub.leave(page)
            sending.cancel()


async def _send(page: Page, connection: Any) -> None:
    """Give a page what waits for it, as long as it takes it."""
    while True:
        frame = page.mailbox.take()
        if frame is None:
            page.wake.clear()
            await page.wake.wait()
        else:
            await connection.send(frame.data)


async def _every(period: float, work: Callable[[], None]) -> None:
    while True:
        work()
        await asyncio.sleep(period)


def _cookie(headers: Any) -> str:
    """The token that a browser remembers; empty where it has none."""
    try:
        found = SimpleCookie(headers.get("Cookie", "")).get(COOKIE)
    except CookieError:
        return ""
    return found.value if found is not None else ""


class Library(msgspec.Struct):
    """What is used of websockets."""

    serve: Any
    Headers: Any
    Response: Any
    ConnectionClosed: type[Exception]


def import_websockets() -> Library:
    """The library for sockets of pages.

    Raises:
        RunError: it is not installed; names the extra.
    """
    try:
        server = importlib.import_module("websockets.asyncio.server")
        structures = importlib.import_module("websockets.datastructures")
        messages = importlib.import_module("websockets.http11")
        exceptions = importlib.import_module("websockets.exceptions")
    except ImportError:
        text = "the dashboard needs websockets, which is not installed: pip install 'robo-zenoh[dashboard]'"
        raise RunError(text) from None
    return Library(server.serve, structures.Headers, messages.Response, exceptions.ConnectionClosed)


_NO_TOKEN = "this page needs a token: open the address that `robo dashboard` has printed"
_WRONG_NAME = "this page has no name {host}: say --name {host} where it is to have"
