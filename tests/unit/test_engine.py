"""What a container engine is asked, over its Unix socket."""

import socket
import threading
from pathlib import Path
from urllib.parse import unquote

import pytest

from robo.errors import EngineError
from robo.export.compose.engine import Container, ContainerEvent, Engine
from tests.played_engine import playing

ABSENT = b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\n\r\n"


def test_an_engine_with_many_callers_is_waited_for(tmp_path: Path) -> None:
    path = tmp_path / "engine.sock"
    with socket.socket(socket.AF_UNIX) as listening, socket.socket(socket.AF_UNIX) as somebody:
        listening.bind(str(path))
        listening.listen(0)
        somebody.connect(str(path))  # and now nobody else finds room

        def serve() -> None:
            listening.accept()[0].close()
            caller, _ = listening.accept()
            with caller:
                caller.recv(4096)
                caller.sendall(ABSENT)

        later = threading.Timer(0.1, serve)
        later.start()
        assert Engine(path).container("gone") is None
        later.join()


def test_an_engine_tells_what_happens_to_the_containers_of_a_project(tmp_path: Path) -> None:
    with playing(tmp_path / "engine.sock") as played:
        events = Engine(tmp_path / "engine.sock").events("mine")
        assert next(events) is None
        assert "mine" in unquote(played.asked.get())
        played.happens("always", "kill 9", "die")
        assert next(events) == ContainerEvent("always", "the always one", "kill", "9")
        assert next(events) == ContainerEvent("always", "the always one", "die")
        played.ends()
        with pytest.raises(EngineError, match="has ended"):
            next(events)


@pytest.mark.parametrize("line", [b"nonsense\n", b'{"Action": 3}\n', b"[]\n", b'\xff"\n'])
def test_an_engine_that_tells_nonsense_does_not_answer(line: bytes, tmp_path: Path) -> None:
    with playing(tmp_path / "engine.sock") as played:
        events = Engine(tmp_path / "engine.sock").events("mine")
        assert next(events) is None
        played.events.put(line)
        with pytest.raises(EngineError, match=r"does not answer: .*; --socket names another"):
            next(events)


def test_a_container_is_told_as_it_is(tmp_path: Path) -> None:
    with playing(tmp_path / "engine.sock"):
        engine = Engine(tmp_path / "engine.sock")
        assert engine.container("on-failure") == Container(running=False, restart="on-failure")
        assert engine.container("running") == Container(running=True, restart="always")
        assert engine.container("gone") is None


def test_what_cannot_be_started_is_told_from_what_need_not(tmp_path: Path) -> None:
    with playing(tmp_path / "engine.sock"):
        engine = Engine(tmp_path / "engine.sock")
        assert engine.start("always")
        assert not engine.start("going")
        with pytest.raises(EngineError, match=r"refuses POST /containers/refused/start: 500 .*out of order"):
            engine.start("refused")


def test_no_engine_is_told_with_what_to_do(tmp_path: Path) -> None:
    for path in (tmp_path / "nothing.sock", tmp_path):
        with pytest.raises(EngineError, match=r"does not answer: .*DOCKER_SOCKET"):
            Engine(path).container("x")
