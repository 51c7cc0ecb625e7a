"""A Docker engine, over its socket: the three things that the keeper needs of it.

The API is Docker's Engine API, which other engines speak too; without a version in the path an engine answers
in its own.
"""

import json
import socket
import struct
from collections.abc import Iterator
from contextlib import closing, contextmanager
from http.client import HTTPConnection, HTTPException, HTTPResponse
from pathlib import Path
from urllib.parse import quote

import msgspec

from robo.errors import EngineError
from robo.text.readable import readable
from robo.text.unreadable import UNREADABLE

SOCKET = Path("/var/run/docker.sock")
PROJECT = "com.docker.compose.project"
SERVICE = "com.docker.compose.service"

_ANSWERS_WITHIN = 10.0
_NOTHING_TO_DO = (304, 404, 409)
"""It runs already, it is gone, it is about to go."""


class ContainerEvent(msgspec.Struct, frozen=True):
    """Something that happened to a container."""

    container: str
    """Its id."""
    service: str
    """What it is called in the Compose file."""
    action: str
    """`start`, `kill`, `die`, `destroy`."""
    signal: str | None = None
    """The number, of a `kill`."""


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

    def events(self, project: str) -> Iterator[ContainerEvent | None]:
        """What happens to the containers of a Compose project from now on; first None, once the engine tells."""
        filters = {
            "type": ["container"],
            "label": [f"{PROJECT}={project}"],
            "event": ["start", "kill", "die", "destroy"],
        }
        with self._asked("GET", f"/events?filters={quote(json.dumps(filters))}", timeout=None) as answer:
            yield None
            for line in answer:
                told = msgspec.json.decode(line, type=readable(_Told))
                about = told.actor.attributes
                yield ContainerEvent(told.actor.id, about.get(SERVICE, ""), told.action, about.get("signal"))
        raise EngineError(f"the engine at {self._path} has ended")

    def container(self, container: str) -> Container | None:
        """A container as it is now, or None if it is gone."""
        with self._asked("GET", f"/containers/{container}/json", allowed=(404,)) as answer:
            if answer.status == 404:
                return None
            found = msgspec.json.decode(answer.read(), type=readable(_Inspected))
        return Container(found.state.running or found.state.restarting, found.host_config.restart_policy.name or "no")

    def start(self, container: str) -> bool:
        """Start a container; False if it runs already, is gone or is being removed."""
        with self._asked("POST", f"/containers/{container}/start", allowed=_NOTHING_TO_DO) as answer:
            return answer.status not in _NOTHING_TO_DO

    @contextmanager
    def _asked(
        self, method: str, url: str, *, allowed: tuple[int, ...] = (), timeout: float | None = _ANSWERS_WITHIN
    ) -> Iterator[HTTPResponse]:
        with closing(_UnixConnection(self._path, timeout)) as connection:
            try:
                connection.request(method, url)
                answer = connection.getresponse()
                if answer.status >= 300 and answer.status not in allowed:
                    said = answer.read().decode(errors="replace").strip()
                    raise EngineError(f"the engine at {self._path} refuses {method} {url}: {answer.status} {said}")
                yield answer
            except (OSError, HTTPException, *UNREADABLE) as error:
                reason = error.strerror if isinstance(error, OSError) and error.strerror else error
                advice = "--socket names another, in an exported Compose file DOCKER_SOCKET"
                raise EngineError(f"the engine at {self._path} does not answer: {reason}; {advice}") from None


class _Actor(msgspec.Struct, rename={"id": "ID", "attributes": "Attributes"}):
    id: str
    attributes: dict[str, str]


class _Told(msgspec.Struct, rename="pascal"):
    """An event as the engine tells it."""

    action: str
    actor: _Actor


class _State(msgspec.Struct, rename="pascal"):
    running: bool
    restarting: bool


class _RestartPolicy(msgspec.Struct, rename="pascal"):
    name: str


class _HostConfig(msgspec.Struct, rename="pascal"):
    restart_policy: _RestartPolicy


class _Inspected(msgspec.Struct, rename="pascal"):
    """A container as the engine describes it."""

    state: _State
    host_config: _HostConfig


class _UnixConnection(HTTPConnection):
    """HTTP over a Unix socket."""

    def __init__(self, path: Path, timeout: float | None) -> None:
        super().__init__("localhost", timeout=timeout)
        self._path = path

    def connect(self) -> None:
        self.sock = socket.socket(socket.AF_UNIX)
        # A call that waits: one with a time limit fails at once where many others ask just now (EAGAIN).
        if self.timeout is not None:
            limit = struct.pack("@ll", int(self.timeout), 0)
            self.sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, limit)
        self.sock.connect(str(self._path))
        self.sock.settimeout(self.timeout)
