"""A container engine that a test plays: it tells the events it is given, and collects what is asked of it."""

import json
import queue
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler
from pathlib import Path
from socketserver import ThreadingMixIn, UnixStreamServer
from typing import Any

from robo.export.compose.engine import SERVICE


class PlayedEngine(ThreadingMixIn, UnixStreamServer):
    """Tells the events that the test gives it, and collects what is to be started.

    A container's id says how it is: `<restart policy>`, `running`, `gone`, `going` or `refused`.
    """

    daemon_threads = True

    def __init__(self, path: Path) -> None:
        super().__init__(str(path), _Answers)
        self.asked: queue.Queue[str] = queue.Queue()
        self.events: queue.Queue[bytes] = queue.Queue()

    def happens(self, container: str, *actions: str) -> None:
        for action in actions:
            name, _, number = action.partition(" ")
            attributes = {SERVICE: f"the {container} one", **({"signal": number} if number else {})}
            told = {"Type": "container", "Action": name, "Actor": {"ID": container, "Attributes": attributes}}
            self.events.put(json.dumps(told).encode() + b"\n")

    def ends(self) -> None:
        self.events.put(b"")


class _Answers(BaseHTTPRequestHandler):
    server: PlayedEngine
    protocol_version = "HTTP/1.1"

    def address_string(self) -> str:
        return "a keeper"

    def log_message(self, *_: object) -> None:
        """Say nothing."""

    def do_GET(self) -> None:
        self.server.asked.put(self.path)
        if self.path.startswith("/events"):
            self.send_response(200)
            self.send_header("Transfer-Encoding", "chunked")
            self.end_headers()
            while line := self.server.events.get():
                self.wfile.write(b"%x\r\n%s\r\n" % (len(line), line))
            self.close_connection = True
            return
        container = self.path.split("/")[2]
        if container == "gone":
            self._answer(404, {"message": "No such container: gone"})
            return
        policy = container if container in ("no", "always", "on-failure", "unless-stopped") else "always"
        state = {"Running": container == "running", "Restarting": False}
        self._answer(200, {"State": state, "HostConfig": {"RestartPolicy": {"Name": policy}}})

    def do_POST(self) -> None:
        container = self.path.split("/")[2]
        status = {"going": 409, "refused": 500}.get(container, 204)
        self.server.asked.put(self.path)
        self._answer(status, {"message": "out of order"} if status >= 400 else None)

    def _answer(self, status: int, tree: dict[str, Any] | None) -> None:
        body = b"" if tree is None else json.dumps(tree).encode()
        self.send_response(status)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)


@contextmanager
def playing(path: Path) -> Iterator[PlayedEngine]:
    """An engine at a socket."""
    with PlayedEngine(path) as played:
        thread = threading.Thread(target=played.serve_forever, daemon=True)
        thread.start()
        yield played
        played.ends()
        played.shutdown()
        thread.join()
