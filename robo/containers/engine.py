"""A Docker engine, over its socket: the three things that the keeper needs of it.

The API is Docker's Engine API, which other engines speak too; without a version in the path an engine answers
in its own.
"""

import json
import socket
from collections.abc import Iterator, Mapping
from contextlib import closing
from http.client import HTTPConnection, HTTPException, HTTPResponse
from pathlib import Path
from typing import Any
from urllib.parse import quote

import msgspec

from robo.errors import EngineError

SOCKET = Path("/var/run/docker.sock")
PROJECT = "com.docker.compose.project"
SERVICE = "com.docker.compose.service"

_ANSWERS_WITHIN = 10.0
_NOTHING_TO_DO = (304, 404, 409)
"""It runs already, it is gone, it is about to go."""


class Event(msgspec.Struct, frozen=True):
    """Something that happened to a container."""

    container: str
    """Its id."""
    service: str
    """What it is called in the Compose file."""
    action: str
    """`start`, `kill`, `die`, `destroy`."""
    signal: int | None = None
    """Of a `kill`."""


class Container(msgspec.Struct, frozen=True):
    """A container as it is now."""

    running: bool
    restart: str
    """Its restart policy: `no`, `on-failure`, `always`, `unless-stopped`."""


class Engine:
    """The engine behind a socket.

    Each method raises EngineError where the engine cannot be reached or refuses.
    """

    def __init__(self, path: Path) -> None:
        self._path = path

    def events(self, project: str) -> Iterator[Event | None]:
        """What happens to the containers of a Compose project from now on; first None, once the engine tells."""
        filters = {
            "type": ["container"],
            "label": [f"{PROJECT}={project}"],
            "event": ["start", "kill", "die", "destroy"],
        }
        with closing(self._connection(None)) as connection:
            answer = self._ask(connection, "GET", f"/events?filters={quote(json.dumps(filters))}")
            yield None
            try:
                for line in answer:
                    yield _event(json.loads(line))
            except (OSError, HTTPException, ValueError) as error:  # in the middle of a line, too
                raise EngineError(f"the engine at {self._path} is gone: {error}") from None
        raise EngineError(f"the engine at {self._path} has ended")

    def container(self, container: str) -> Container | None:
        """A container as it is now, or None if it is gone."""
        with closing(self._connection(_ANSWERS_WITHIN)) as connection:
            answer = self._ask(connection, "GET", f"/containers/{container}/json", allowed=(404,))
            if answer.status == 404:
                return None
            found: dict[str, Any] = json.loads(answer.read())
        state = found["State"]
        return Container(state["Running"] or state["Restarting"], found["HostConfig"]["RestartPolicy"]["Name"] or "no")

    def start(self, container: str) -> bool:
        """Start a container; False if it runs already, is gone or is being removed."""
        with closing(self._connection(_ANSWERS_WITHIN)) as connection:
            return self._ask(connection, "POST", f"/containers/{container}/start", allowed=_NOTHING_TO_DO).status < 300

    def _connection(self, timeout: float | None) -> HTTPConnection:
        return _UnixConnection(self._path, timeout)

    def _ask(self, connection: HTTPConnection, method: str, url: str, allowed: tuple[int, ...] = ()) -> HTTPResponse:
        try:
            connection.request(method, url)
            answer = connection.getresponse()
            if answer.status < 300 or answer.status in allowed:
                return answer
            said = answer.read().decode(errors="replace").strip()
        except (OSError, HTTPException) as error:
            reason = error.strerror if isinstance(error, OSError) and error.strerror else error
            advice = "--socket names another, in an exported Compose file DOCKER_SOCKET"
            raise EngineError(f"no Docker engine answers at {self._path}: {reason}; {advice}") from None
        raise EngineError(f"the engine at {self._path} refuses {method} {url}: {answer.status} {said}")


def _event(told: Mapping[str, Any]) -> Event:
    attributes = told["Actor"]["Attributes"]
    number = attributes.get("signal")
    return Event(
        told["Actor"]["ID"],
        attributes.get(SERVICE, attributes.get("name", "")),
        told["Action"],
        None if number is None else int(number),
    )


class _UnixConnection(HTTPConnection):
    """HTTP over a Unix socket."""

    def __init__(self, path: Path, timeout: float | None) -> None:
        super().__init__("localhost", timeout=timeout)
        self._path = path

    def connect(self) -> None:
        self.sock = socket.socket(socket.AF_UNIX)
        self.sock.settimeout(self.timeout)
        self.sock.connect(str(self._path))
