"""The robot's router: a child of the run, started again when it dies or answers nobody any more."""

import asyncio
import sys
from collections.abc import Awaitable, Callable, Mapping, Sequence
from typing import Protocol

import msgspec

from robo.environment import NETWORK_VARIABLE
from robo.errors import NetworkError
from robo.machine.child import describe_exit
from robo.machine.forks import Fork, Template
from robo.process.router import LONGEST_LINGER, UNUSABLE
from robo.wire.network import Network

_MODULE = "robo.process.router"
_BREATH = 0.1
"""How long it stays away when it has died, s: one that dies at once must not keep a core busy."""
LOOK_EVERY = 2.0
"""How often somebody new knocks, s."""
ANSWERS_WITHIN = 3.0
"""How long one that is well takes at most to answer, on a machine under load, s."""
LISTENS_WITHIN = 15.0
"""How long one may take from its start until it listens, s, however busy its machine is."""
MISSES = 2
"""How often in a row there is no answer before it counts as hanging."""
_PATIENCE = 1.0
"""How long one that hangs is given to end by itself, s."""
_UNIX_SOCKET = "unixsock-stream/"
_EMPTY = b"\0\0"
"""A frame of no bytes, which is no message of Zenoh's."""


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
    """Where a router's trouble is told."""

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
        answers: Callable[[str], Awaitable[bool | None]] | None = None,
    ) -> None:
        """
        Args:
            process: in which it runs.
            network: where it listens and what it dials.
            environment: of the process.
            template: what to fork it from; None to start it the usual way.
            journal: is told when it has died or hangs.
            answers: tells whether the router at a unix socket answers a newcomer, None where nobody listens; by default
                it is tried.
        """
        self.network = network
        self._process = process
        self._environment = {**environment, NETWORK_VARIABLE: msgspec.json.encode(network).decode()}
        self._fork = template.module([_MODULE]) if template is not None else None
        self._journal = journal
        self._answers = answers or _answers
        self._entry = next(one for one in network.listen if one.startswith(_UNIX_SOCKET))

    @property
    def reached_at(self) -> str:
        """Where tools and other robots find it, for people: `at tcp/0.0.0.0:7447`."""
        return self.network.reached

    async def start(self) -> None:
        """Start it."""
        await self._process.start([sys.executable, "-m", _MODULE], self._environment, fork=self._fork)

    async def keep(self) -> None:
        """Start it again whenever it dies or hangs; nodes and tools find it again by themselves.

        Raises:
            NetworkError: the first one cannot do its work, and says why.
        """
        first = True
        while True:
            ended = asyncio.create_task(self._process.wait())
            hangs = asyncio.create_task(self._hangs())
            try:
                await asyncio.wait([ended, hangs], return_when=asyncio.FIRST_COMPLETED)
                if ended.done():
                    if first and ended.result() == UNUSABLE:
                        raise NetworkError("nobody could reach the robot's router, see above; nothing goes on")
                    self._journal.warn(f"the router ended with {describe_exit(ended.result())}; starting it again")
                else:
                    hangs.result()
                    self._journal.warn("the router runs, but answers nobody; starting it again")
                    await self._process.stop(ended, patience=_PATIENCE)
            finally:
                ended.cancel()
                hangs.cancel()
            first = False
            await asyncio.sleep(_BREATH)
            await self.start()

    async def _hangs(self) -> None:
        """Return once it answers nobody any more, or has not come as far as to listen."""
        now = asyncio.get_running_loop().time
        begun, misses, has_listened = now(), 0, False
        while misses < MISSES and (has_listened or now() < begun + LISTENS_WITHIN):
            await asyncio.sleep(LOOK_EVERY)
            answers = await self._answers(self._entry)
            has_listened = has_listened or answers is not None
            misses = misses + 1 if answers is False else 0

    async def stop(self) -> None:
        """Stop it; it takes leave of those that it is linked to."""
        if self._process.running:
            ended = asyncio.create_task(self._process.wait())
            await self._process.stop(ended, patience=LONGEST_LINGER + 1.0)


async def _answers(endpoint: str) -> bool | None:
    """Whether a router lets a newcomer in: who says something that means nothing is sent away at once.

    A session of its own would show that too, but cost the router some memory each time.

    Returns:
        None where nobody listens: it does not yet, or the socket's file was taken away from one that is well.
    """
    try:
        async with asyncio.timeout(ANSWERS_WITHIN):
            reader, writer = await asyncio.open_unix_connection(endpoint.removeprefix(_UNIX_SOCKET))
            try:
                writer.write(_EMPTY)
                await reader.read(1)
            finally:
                writer.close()
    except TimeoutError:
        return False
    except (FileNotFoundError, ConnectionRefusedError):
        return None
    except OSError:
        pass  # it has hung up already: only silence counts
    return True
