"""What a container engine is asked, over its Unix socket."""

import socket
import threading
from pathlib import Path

from robo.export.compose.engine import Engine

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
