"""The server of the page: its files, and the socket by which it hears and says everything else."""

import asyncio
import http
import logging
import math
import threading
import time
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractAsyncContextManager, AsyncExitStack, suppress
from functools import partial
from typing import Any
from urllib.parse import parse_qs, urlsplit

import zenoh

from robo.dashboard import files, protocol
from robo.dashboard.delivery import Page
from robo.dashboard.driver import Driver
from robo.dashboard.files import Answer
from robo.dashboard.hub import BEAT, Hub
from robo.dashboard.place import Settings
from robo.dashboard.state import State
from robo.dashboard.stops import Stops
from robo.dashboard.topics import Topics
from robo.errors import UsageError
from robo.text.unreadable import UNREADABLE
from robo.web.access import Doorkeeper, Right, host_of, is_loopback, is_own_host, is_own_origin
from robo.web.limits import Budget
from robo.web.sessions import Sessions, cookie
from robo.web.sockets import import_websockets, listening

_logger = logging.getLogger("robo.dashboard")
_SILENT = logging.getLogger("robo.dashboard.websockets")
_SILENT.addHandler(logging.NullHandler())
_SILENT.propagate = False

SOCKET = "/socket"
COOKIE = "robo_dashboard_{port}"
"""With the port: browsers send cookies to all ports of a host, and there may be several dashboards."""
_MOST_REQUEST = 100_000
"""Of what a page says at once, bytes."""
_AT_ONCE, _RATE = 300, 200
"""Requests that a page may make at once, and each second: it says some 50."""
_HANDLING = 1.0
"""For so long a thread waits until pages have been given what it has brought, s."""
_SILENCE = 5.0
"""A page that says nothing for so long is gone, s: it acknowledges ten beats a second."""


class Dashboard:
    """Serves the page."""

    def __init__(self, session: zenoh.Session, settings: Settings) -> None:
        """
        Args:
            session: the network of the robots.
            settings: where, and for whom.

        Raises:
            RunError: the library for the socket is not installed.
            UsageError: others than this machine could open it without a token.
        """
        if not (settings.tokens.drive or is_loopback(settings.host)):
            raise UsageError(f"a page at {settings.host} needs a token")
        if "*" in settings.names and not settings.tokens.drive:
            raise UsageError("--name '*' needs tokens, else any page of the web could drive: --token-file FILE")
        self._websockets = import_websockets("the dashboard", "dashboard")
        self._session = session
        self._settings = settings
        self._door = Doorkeeper(settings.tokens)
        self._sessions = Sessions(settings.tokens, settings.key)
        self._port = settings.port

    async def serve(self, ready: Callable[[int], object], over: asyncio.Event) -> None:
        """Serve until `over`.

        Args:
            ready: is called with the port once pages are served.
            over: ends it when it is set.

        Raises:
            NetworkError: the port cannot be had.
        """
        loop = asyncio.get_running_loop()
        async with AsyncExitStack() as made:

            def ends(end: Callable[[], object]) -> None:
                """Have something that blocks done at the end, in the turn opposite to that of the beginnings."""
                made.push_async_callback(partial(loop.run_in_executor, None, end))

            calls, looks = ThreadPoolExecutor(8, "robo-dashboard-call"), ThreadPoolExecutor(2, "robo-dashboard-looks")
            for pool in (calls, looks):
                made.callback(pool.shutdown, wait=False, cancel_futures=True)
            stops = Stops(self._session)
            made.callback(stops.close)
            driver = Driver(self._session)
            ends(driver.close)
            # What comes before there is a hub is for nobody.
            topics = Topics(self._session, _by(loop, lambda what: hub.messages(what), waits=True))
            ends(topics.close)
            hub = Hub(self._session, topics, driver, calls, looks, stops)
            made.push_async_callback(hub.close)
            state = State(self._session, _by(loop, hub.looked), _by(loop, hub.lines), _by(loop, hub.events))
            ends(state.close)
            beats = loop.create_task(_every(BEAT, lambda: _beat(hub, state)))
            made.callback(beats.cancel)
            async with self._listening(partial(self._page, hub, state)) as self._port:
                ready(self._port)
                try:
                    await over.wait()
                finally:
                    # Robots first: they are to stand, however long pages take to go.
                    await loop.run_in_executor(None, driver.close)

    def _listening(self, page: Callable[[Any], Awaitable[None]]) -> AbstractAsyncContextManager[int]:
        o = self._settings
        return listening(
            self._websockets,
            "the page",
            o.host,
            o.port,
            page,
            process_request=self._answer,
            max_size=_MOST_REQUEST,
            max_queue=4,
            write_limit=2**16,
            ping_interval=None,  # beats are acknowledged
            logger=_SILENT,  # whoever knocks and goes is no fault
        )

    def _answer(self, connection: Any, request: Any) -> Any:
        """A file; None for a socket that may be opened."""
        host = request.headers.get("Host", "")
        tokens = self._settings.tokens
        try:
            url = urlsplit(request.path)
            given = parse_qs(url.query, max_num_fields=10).get("token", [""])[0]
        except ValueError:
            return self._respond(files.text(http.HTTPStatus.BAD_REQUEST, "that is no address of a page"))
        if not is_own_host(host, self._settings.names, addresses=bool(tokens.drive)):
            words = _WRONG_NAME.format(name=host_of(host)[:100])
            return self._respond(files.text(http.HTTPStatus.MISDIRECTED_REQUEST, words))
        name = COOKIE.format(port=self._port)
        # Who has been let in before waits for nobody's guesses, though they come from the same address.
        right = self._sessions.right(cookie(request.headers.get_all("Cookie"), name)) if not given else Right.NONE
        if right is Right.NONE:
            now, address = time.monotonic(), connection.remote_address[0]
            if (wait := self._door.wait(address, now)) > 0:
                retry = str(math.ceil(wait))
                words = f"too many wrong tokens: again in {retry} s"
                return self._respond(files.text(http.HTTPStatus.TOO_MANY_REQUESTS, words, Retry_After=retry))
            right = self._door.right(given, address, now)
        if right is Right.NONE:
            return self._respond(files.text(http.HTTPStatus.UNAUTHORIZED, _NO_TOKEN))
        if given:  # so that it does not stay in the address
            # Lax, so that a link in a mail lets in, too; what changes anything comes by the socket, which looks at the
            # origin. Without tokens any word is right, and none is to be remembered.
            word = f"{name}={self._sessions.word(right)}; HttpOnly; SameSite=Lax; Path=/"
            told = {"Set_Cookie": word} if tokens.drive else {}
            return self._respond(files.text(http.HTTPStatus.SEE_OTHER, "", Location="/", **told))
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

    async def _page(self, hub: Hub, state: State, connection: Any) -> None:
        if hub.is_full(connection.robo_right):
            await connection.close(1013, "too many pages are open")
            return
        page = hub.join(connection.robo_right)
        state.attend(True)
        sending = asyncio.get_running_loop().create_task(self._send(page, connection))
        budget, clock = Budget(_AT_ONCE, _RATE), asyncio.get_running_loop().time
        try:
            while budget.take(clock()):
                async with asyncio.timeout(_SILENCE):
                    said = await connection.recv()
                hub.ask(page, protocol.request(said))
                await asyncio.sleep(0)  # `recv` does not wait where something has come: others have their turn
            await connection.close(1008, "it says too much")
        except (TimeoutError, self._websockets.ConnectionClosed):
            pass  # it is gone
        except UNREADABLE as error:
            await connection.close(1007, f"that is no request: {error}"[:100])
        finally:
            hub.leave(page)
            sending.cancel()

    async def _send(self, page: Page, connection: Any) -> None:
        """Give a page what waits for it, as long as it takes it."""
        with suppress(self._websockets.ConnectionClosed):
            while not page.mailbox.is_lost:
                frame = page.mailbox.take()
                if frame is None:
                    page.wake.clear()
                    await page.wake.wait()
                else:
                    await connection.send(frame.data)
            await connection.close(1008, "it never says what it has read")


def _by(loop: asyncio.AbstractEventLoop, work: Callable[[Any], None], *, waits: bool = False) -> Callable[[Any], None]:
    """What has something done by the loop, for other threads; one that waits cannot bring more than is dealt with."""

    def ask(what: Any) -> None:
        done = threading.Event()

        def do() -> None:
            try:
                work(what)
            finally:
                done.set()

        loop.call_soon_threadsafe(do)
        if waits:
            done.wait(_HANDLING)

    return ask


def _beat(hub: Hub, state: State) -> None:
    hub.beat()
    state.attend(hub.has_pages)


async def _every(period: float, work: Callable[[], None]) -> None:
    while True:
        try:
            work()
        except Exception:  # nobody has thought of it: it is told, and beats go on, else all pages would lock driving
            _logger.exception("the dashboard could not tell its pages who drives")
        await asyncio.sleep(period)


_NO_TOKEN = "this page needs a token: open the address that `robo dashboard` has printed"
_WRONG_NAME = (
    "this page has no name {name}: `robo dashboard --name {name}` gives it that, or the parameter `names` of its node"
)
