"""The robot's router: a child of the run, started again when it dies."""

import asyncio
import sys
from collections.abc import Mapping, Sequence
from typing import Protocol

import msgspec

from robo.environment import NETWORK_VARIABLE
from robo.machine.child import describe_exit
from robo.machine.forks import Fork, Template
from robo.process.router import LONGEST_LINGER
from robo.wire.network import Network

_MODULE = "robo.process.router"
_BREATH = 0.1
"""How long it stays away when it has died, s: one that dies at once must not keep a core busy."""


class Process(Protocol):
    """What a router needs of the process that it runs in."""

    @property
    def running(self) -> bool:
        """Whether it has started and not yet ended."""

    async def start(self, command: Sequence[str], environment: Mapping[str, str], *, fork: Fork | None) -> None:
        """Start it."""

    async def wait(self) -> int:
        """Wait for its end and return the exit code."""

    async def stop(self, ended: "asyncio.Task[int]", *, patience: float) -> None:
        """Ask it to end, then insist."""


class Journal(Protocol):
    """Where a router's end is told."""

    def warn(self, text: str) -> None:
        """Tell what went wrong."""


class Router:
    """The process that passes on what tools, other robots and the nodes of this one say to each other."""

    def __init__(
        self,
        process: Process,
        network: Network,
        environment: Mapping[str, str],
        template: Template | None,
        journal: Journal,
    ) -> None:
        """
        Args:
            process: in which it runs.
            network: where it listens and what it dials.
            environment: of the process.
            template: what to fork it from; None to start it the usual way.
            journal: is told when it has died.
        """
        self.network = network
        self._process = process
        self._environment = {**environment, NETWORK_VARIABLE: msgspec.json.encode(network).decode()}
        self._fork = template.module([_MODULE]) if template is not None else None
        self._journal = journal

    @property
    def reached_at(self) -> str:
        """Where tools and other robots find it, for people."""
        return ", ".join(one for one in self.network.listen if not one.startswith("unixsock"))

    async def start(self) -> None:
        """Start it."""
        await self._process.start([sys.executable, "-m", _MODULE], self._environment, fork=self._fork)

    async def keep(self) -> None:
        """Start it again whenever it dies; nodes and tools find it again by themselves."""
        while True:
            code = await self._process.wait()
            self._journal.warn(f"the router ended with {describe_exit(code)}; starting it again")
            await asyncio.sleep(_BREATH)
            await self.start()

    async def stop(self) -> None:
        """Stop it; it takes leave of those that it is linked to."""
        if self._process.running:
            ended = asyncio.create_task(self._process.wait())
            await self._process.stop(ended, patience=LONGEST_LINGER + 1.0)
