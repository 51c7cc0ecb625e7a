"""A viewer for tests: as much of one as the server of viewers knows of, over the library for sockets alone."""

import asyncio
import socket
import struct
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from typing import Any

import msgspec
import pytest
import zenoh

from robo.bridges.foxglove.server import Server, Settings

client = pytest.importorskip("websockets.sync.client", reason="the extra foxglove is not installed")

PATIENCE = 30.0
"""s."""
SDK, PLAIN = "foxglove.sdk.v1", "foxglove.websocket.v1"


class Served:
    """A bridge that a thread serves."""

    def __init__(self, session: zenoh.Session, settings: Settings | None = None, **how: Any) -> None:
        self.told: list[str] = []
        self._loop = asyncio.new_event_loop()
        self._over = asyncio.Event()
        self._ready = threading.Event()
        self._server = Server(session, settings or Settings(port=0), self.told.append, **how)
        self.port = 0
        self._thread = threading.Thread(target=self._run)
        self._thread.start()
        assert self._ready.wait(PATIENCE)

    def _run(self) -> None:
        def ready(port: int) -> None:
            self.port = port
            self._ready.set()

        with closing(self._loop):
            self._loop.run_until_complete(self._server.serve(ready, self._over.wait()))

    @contextmanager
    def viewer(self, path: str = "/", subprotocol: str = SDK, **how: Any) -> Iterator["Viewer"]:
        """One that is connected."""
        address = f"ws://127.0.0.1:{self.port}{path}"
        protocols = [subprotocol]
        with client.connect(address, open_timeout=PATIENCE, subprotocols=protocols, max_size=None, **how) as found:
            yield Viewer(found)

    @contextmanager
    def narrow_viewer(self) -> Iterator["Viewer"]:
        """One whose end of the link holds as good as nothing, while a kernel may give a plain one 32 MB."""
        with socket.socket() as link:
            link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 65_536)
            link.connect(("127.0.0.1", self.port))
            with self.viewer(sock=link, max_queue=1) as found:
                yield found

    def close(self) -> None:
        """Serve no more."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._over.set)
        self._thread.join(PATIENCE)
        assert not self._thread.is_alive()


class Viewer:
    """One viewer. What comes while it waits for something else is kept."""

    def __init__(self, socket: Any) -> None:
        self.socket = socket
        self.topics: dict[str, dict[str, Any]] = {}
        self.services: dict[str, dict[str, Any]] = {}
        self.messages: dict[int, list[tuple[int, bytes]]] = {}
        self.times: list[int] = []
        self.said: list[dict[str, Any]] = []
        self.frames: list[bytes] = []
        self._numbers = iter(range(1, 1_000_000))

    def ask(self, op: str, **what: object) -> None:
        """Say a word."""
        self.socket.send(msgspec.json.encode({"op": op, **what}).decode())

    def send(self, frame: bytes) -> None:
        """Say bytes."""
        self.socket.send(frame)

    def take(self) -> None:
        """Take in what comes next."""
        said = self.socket.recv(PATIENCE)
        if isinstance(said, bytes):
            self._take_bytes(said)
            return
        word = msgspec.json.decode(said)
        if word["op"] == "advertise":
            self.topics |= {one["topic"]: one for one in word["channels"]}
        elif word["op"] == "unadvertise":
            gone = word["channelIds"]
            self.topics = {name: one for name, one in self.topics.items() if one["id"] not in gone}
        elif word["op"] == "advertiseServices":
            self.services |= {one["name"]: one for one in word["services"]}
        self.said.append(word)

    def _take_bytes(self, frame: bytes) -> None:
        if frame[0] == 1:
            number, time = struct.unpack_from("<IQ", frame, 1)
            self.messages.setdefault(number, []).append((time, frame[13:]))
        elif frame[0] == 2:
            self.times.append(struct.unpack_from("<Q", frame, 1)[0])
        else:
            self.frames.append(frame)

    def until(self, condition: Callable[[], Any]) -> Any:
        """Take in what comes until something is so."""
        while not (found := condition()):
            self.take()
        return found

    def hears(self, op: str, wanted: Callable[[dict[str, Any]], bool] = lambda _: True) -> dict[str, Any]:
        """The next word of a kind; it is heard once."""

        def find() -> dict[str, Any] | None:
            return next((one for one in self.said if one["op"] == op and wanted(one)), None)

        found: dict[str, Any] = self.until(find)
        self.said.remove(found)
        return found

    def subscribe(self, topic: str) -> int:
        """Want the messages of a topic, once it is there; returns the number of the subscription."""
        channel = self.until(lambda: self.topics.get(topic))
        number = next(self._numbers)
        self.ask("subscribe", subscriptions=[{"id": number, "channelId": channel["id"]}])
        return number

    def next_of(self, number: int) -> bytes:
        """The next message of a subscription."""
        self.until(lambda: self.messages.get(number))
        return self.messages[number].pop(0)[1]

    def call(self, service: str, data: bytes, encoding: str = "cdr", call: int = 7) -> None:
        """Call a service, once it is there."""
        known = self.until(lambda: self.services.get(service))
        head = struct.pack("<BIII", 2, known["id"], call, len(encoding))
        self.send(head + encoding.encode() + data)

    def answer(self) -> tuple[int, str, bytes]:
        """The next answer of a service: of which call, in which encoding, and its bytes."""
        self.until(lambda: any(frame[0] == 3 for frame in self.frames))
        frame = next(frame for frame in self.frames if frame[0] == 3)
        self.frames.remove(frame)
        _service, call, length = struct.unpack_from("<III", frame, 1)
        return call, frame[13 : 13 + length].decode(), frame[13 + length :]

    def state(self, wanted: Callable[[tuple[int, int, float, bool, str]], bool]) -> tuple[int, int, float, bool, str]:
        """The next word on a recording that is played: status, position, rate, whether it jumped, to which request."""
        while True:
            self.until(lambda: any(frame[0] == 5 for frame in self.frames))
            frame = next(frame for frame in self.frames if frame[0] == 5)
            self.frames.remove(frame)
            status, position, rate, jumped, _ = struct.unpack_from("<BQfBI", frame, 1)
            found = status, position, rate, bool(jumped), frame[19:].decode()
            if wanted(found):
                return found
