"""The keeper of a Compose project, as a process, with an engine that a test plays."""

import json
import queue
import signal
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler
from pathlib import Path
from socketserver import ThreadingMixIn, UnixStreamServer
from typing import Any

import pytest

from robo.export.compose.engine import SERVICE
from tests.support import eventually, robo, run_robo


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


@pytest.fixture
def engine(tmp_path: Path) -> Iterator[PlayedEngine]:
    with PlayedEngine(tmp_path / "engine.sock") as played:
        thread = threading.Thread(target=played.serve_forever, daemon=True)
        thread.start()
        yield played
        played.ends()
        played.shutdown()
        thread.join()


def test_what_is_killed_comes_back_by_its_policy(engine: PlayedEngine, tmp_path: Path) -> None:
    ready = tmp_path / "ready"
    keep = ("keeper", "--project", "mine", "--socket", str(engine.server_address), "--ready-file", str(ready))
    with robo(*keep) as keeper:
        keeper.wait_for("keeps the containers of mine")
        eventually(ready.exists, "the ready file")
        engine.happens("unless-stopped", "kill 15", "kill 9", "die")
        engine.happens("running", "kill 9", "die", "start")
        engine.happens("gone", "kill 9", "die", "destroy")
        engine.happens("crashed", "die")
        engine.happens("hung-up", "kill 1", "die")
        engine.happens("going", "kill 9", "die")
        engine.happens("no", "kill 9", "die")
        engine.happens("refused", "kill 9", "die")
        engine.happens("on-failure", "kill 9", "die")
        engine.happens("always", "kill 9", "die")
        keeper.wait_for("the no one was killed and stays down: its restart policy is no")
        keeper.wait_for("the refused one was killed and stays down: the engine at")
        keeper.wait_for("the on-failure one was killed and is started again")
        keeper.wait_for("the always one was killed and is started again")
        keeper.process.send_signal(signal.SIGTERM)
        assert keeper.wait() == 0
    asked = [engine.asked.get() for _ in range(engine.asked.qsize())]
    assert asked[0].startswith("/events")
    assert "mine" in asked[0]
    started = {path.split("/")[2] for path in asked if path.endswith("/start")}
    assert started == {"going", "refused", "on-failure", "always"}
    assert len(keeper.output.splitlines()) == 6


def test_a_keeper_without_an_engine_ends_and_says_why(engine: PlayedEngine, tmp_path: Path) -> None:
    with robo("keeper", "--project", "mine", "--socket", str(engine.server_address)) as keeper:
        keeper.wait_for("keeps the containers of mine")
        engine.ends()
        assert keeper.wait() == 1
    assert "error: the engine at" in keeper.output
    with robo("keeper", "--project", "mine", "--socket", str(engine.server_address)) as keeper:
        keeper.wait_for("keeps the containers of mine")
        engine.events.put(b'{"Type": "container", "Act')
        engine.ends()
        assert keeper.wait() == 1
    assert "error: the engine at" in keeper.output

    absent = run_robo("keeper", "--project", "mine", "--socket", str(tmp_path / "nothing.sock"))
    assert absent.returncode == 1
    assert "nothing.sock does not answer: No such file or directory; --socket names another" in absent.stderr
    a_folder = run_robo("keeper", "--project", "mine", "--socket", str(tmp_path))
    assert a_folder.returncode == 1
    assert "Traceback" not in a_folder.stderr
