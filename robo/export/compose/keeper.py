"""Containers that are killed by hand come back by their restart policy, as if they had crashed.

An engine takes a SIGKILL that it delivers itself (`docker kill`, `docker compose kill`) for a wish that the
container stay down, whatever its policy says. So it is, unless somebody asks for a keeper of his Compose project:
it sees the kill and starts the container again. What was asked to stop (`stop`, `down`, `restart`, `rm`: the engine
sends another signal first) stays stopped.
"""

import signal
import threading
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Protocol

from robo.errors import EngineError
from robo.export.compose.engine import Container, ContainerEvent

DELAY = 1.0
"""From a kill to the start, s: whoever kills the whole project, or removes what they have killed, means it."""

_KILL = str(int(signal.SIGKILL))
_POLICIES = ("on-failure", "always")


class Kills:
    """Tells by the events of containers which of them were killed without having been asked to stop. Pure."""

    def __init__(self) -> None:
        self._signals: dict[str, set[str | None]] = {}

    def shows(self, event: ContainerEvent) -> bool:
        """Whether with this event a container has been killed."""
        if event.action == "kill":
            self._signals.setdefault(event.container, set()).add(event.signal)
            return False
        signals = self._signals.pop(event.container, set())
        return event.action == "die" and signals == {_KILL}


class Containers(Protocol):
    """What the keeper needs of an engine; each raises EngineError where it cannot be had."""

    def events(self, project: str) -> Iterator[ContainerEvent | None]:
        """What happens to the containers of a project; first None, once it is told."""

    def container(self, container: str) -> Container | None:
        """A container as it is now, or None if it is gone."""

    def start(self, container: str) -> bool:
        """Start a container; False if there was nothing to do."""


def after(seconds: float, work: Callable[[], None]) -> None:
    """Do something later, beside all else."""
    timer = threading.Timer(seconds, work)
    timer.daemon = True
    timer.start()


class Keeper:
    """Starts the containers of a Compose project again.

    Args:
        engine: where they run.
        project: its name.
        say: tells people what is done.
        later: does something after so many seconds.
    """

    def __init__(
        self,
        engine: Containers,
        project: str,
        say: Callable[[str], None],
        later: Callable[[float, Callable[[], None]], None] = after,
    ) -> None:
        self._engine = engine
        self._project = project
        self._say = say
        self._later = later

    def run(self, ready_file: Path | None) -> None:
        """Watch for as long as the engine tells what happens.

        Args:
            ready_file: made once it does.

        Raises:
            EngineError: there is no engine, or it is gone. Whoever runs the keeper in a container lets it start again
                then: the socket that a container has is of no use once the engine has made a new one.
        """
        kills = Kills()
        for event in self._engine.events(self._project):
            if event is None:
                self._say(f"keeps the containers of {self._project} running by their restart policies")
                if ready_file is not None:
                    ready_file.touch()
            elif kills.shows(event):
                # Beside the events: what happens in the meantime is not missed.
                self._later(DELAY, partial(self._revive, event))

    def _revive(self, killed: ContainerEvent) -> None:
        try:
            found = self._engine.container(killed.container)
            if found is None or found.running:
                return
            if found.restart not in _POLICIES:
                self._say(f"{killed.service} was killed and stays down: its restart policy is {found.restart}")
            elif self._engine.start(killed.container):
                self._say(f"{killed.service} was killed and is started again: its restart policy is {found.restart}")
        except EngineError as error:
            self._say(f"{killed.service} was killed and stays down: {error}")
