"""A page that is served by a thread of the test, and as much of a browser as its server knows of."""

import asyncio
import http.client
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, closing, contextmanager
from typing import Any

import msgspec
import pytest
import zenoh

import robo_messages
from robo.dashboard.place import Settings
from robo.dashboard.protocol import _HEAD
from robo.dashboard.server import Dashboard
from robo.samples.stream import Stream
from robo.web.access import Tokens
from robo_messages import Twist

client = pytest.importorskip("websockets.sync.client", reason="the extra dashboard is not installed")

TOKENS = Tokens(view="look-look-look", drive="drive-drive-drive")


class Served:
    """A page that is served by a thread."""

    def __init__(self, session: zenoh.Session, settings: Settings) -> None:
        self._loop = asyncio.new_event_loop()
        self._over = asyncio.Event()
        self._ready = threading.Event()
        self._dashboard = Dashboard(session, settings)
        self.port = 0
        self._thread = threading.Thread(target=self._run)
        self._thread.start()
        assert self._ready.wait(20)

    def _run(self) -> None:
        def ready(port: int) -> None:
            self.port = port
            self._ready.set()

        with closing(self._loop):
            self._loop.run_until_complete(self._dashboard.serve(ready, self._over))

    def cookie(self, token: str) -> dict[str, str]:
        """What a browser says that has been let in."""
        return {"Cookie": self.get(f"/?token={token}").headers["Set-Cookie"].partition(";")[0]}

    def get(self, path: str, address: str = "127.0.0.1", **headers: str) -> http.client.HTTPResponse:
        """What the server answers somebody who comes from an address of this machine, and to it where it is there."""
        to = "127.0.0.1" if address.startswith("127.") else address
        connection = http.client.HTTPConnection(to, self.port, timeout=10, source_address=(address, 0))
        connection.putrequest("GET", path, skip_host="Host" in headers)
        for name, value in headers.items():
            connection.putheader(name, value)
        connection.endheaders()
        answer = connection.getresponse()
        answer.body = answer.read()  # type: ignore[attr-defined]
        connection.close()
        return answer

    def page(self, host: str = "127.0.0.1", **settings: Any) -> AbstractContextManager["Browser"]:
        """A page that is open."""
        return browsing(f"{host}:{self.port}", **settings)

    def close(self) -> None:
        """Serve no more."""
        self._loop.call_soon_threadsafe(self._over.set)
        self._thread.join(20)
        assert not self._thread.is_alive()


class Browser:
    """As much of a browser as the server knows of."""

    def __init__(self, socket: Any) -> None:
        self.socket = socket
        self.beat = 0
        self.name = ""
        self.grip = 0
        self.channels: dict[int, tuple[str, str]] = {}

    def ask(self, **request: object) -> None:
        self.socket.send(msgspec.json.encode(request).decode())

    def drive(
        self, linear: float, *, robot: str = "r1", since: float = 0.0, heard: int | None = None, grip: int | None = None
    ) -> None:
        beat, hold = self.beat if heard is None else heard, self.grip if grip is None else grip
        self.ask(do="drive", robot=robot, linear=linear, angular=0.0, heard=beat, since=since, grip=hold)

    def take(self) -> dict[str, Any] | tuple[str, bytes]:
        """The next news, or message of a topic, which is acknowledged."""
        said = self.socket.recv(20)
        self.ask(do="read", count=1)
        if isinstance(said, bytes):
            number, _published, _arrived = _HEAD.unpack_from(said)
            return self.channels[number][0], said[_HEAD.size :]
        news: dict[str, Any] = msgspec.json.decode(said)
        if news["kind"] == "beat":
            self.beat = news["number"]
        elif news["kind"] == "channel":
            self.channels[news["number"]] = news["key"], news["encoding"]
        elif news["kind"] == "welcome":
            self.name = news["name"]
        elif news["kind"] == "drivers":
            self.grip = news["grip"]
        return news

    def hears(self, kind: str, wanted: Callable[[dict[str, Any]], bool] = lambda _: True) -> dict[str, Any]:
        """The next news of a kind."""
        while True:
            said = self.take()
            if isinstance(said, dict) and said["kind"] == kind and wanted(said):
                return said
            assert not isinstance(said, dict) or kind == "answer" or said["kind"] != "refused", said

    def answer(self, number: int) -> str:
        """What comes of something that was asked for: its answer, or why it is refused."""
        while True:
            said = self.take()
            if isinstance(said, dict) and said.get("id") == number:
                return str(said.get("reason") or said["answer"])

    def gets(self, key: str) -> bytes:
        """The next message of a topic."""
        while True:
            said = self.take()
            if isinstance(said, tuple) and said[0] == key:
                return said[1]


@contextmanager
def browsing(place: str, **settings: Any) -> Iterator[Browser]:
    """A page of the server at HOST:PORT that is open."""
    with client.connect(f"ws://{place}/socket", open_timeout=20, **settings) as socket:
        yield Browser(socket)


class Held:
    """A page that goes on commanding, as a hand does that never lets go; it never grips anew."""

    def __init__(self, page: Browser, linear: float, robot: str = "r1") -> None:
        while (said := page.take()) and not (isinstance(said, dict) and said["kind"] == "beat"):
            pass
        self._over = threading.Event()
        self.refusals: list[str] = []
        self._thread = threading.Thread(target=self._run, args=(page, linear, robot, page.grip))
        self._thread.start()

    def _run(self, page: Browser, linear: float, robot: str, grip: int) -> None:
        while not self._over.is_set():
            said = page.take()
            if isinstance(said, dict) and said["kind"] == "refused":
                self.refusals.append(said["reason"])
            if isinstance(said, dict) and said["kind"] == "beat":
                page.drive(linear, robot=robot, grip=grip)

    def close(self) -> None:
        self._over.set()
        self._thread.join(20)


def twists(stream: Stream, count: int) -> list[float]:
    """The next commands."""
    found: list[float] = []
    while len(found) < count:
        arrival = stream.get()
        assert arrival is not None
        found.append(robo_messages.decode(arrival.sample.payload.to_bytes(), Twist).linear.x)
    return found
