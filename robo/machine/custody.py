"""What a run has on its machine, and gives back: its processes, wherever they go, and a folder for sockets."""

import asyncio
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

from robo.machine import orphans
from robo.machine.child import Spawned
from robo.machine.guard import Watchdog
from robo.machine.limits import Limiter


class Custody:
    """The processes and the temporary folder of one run. None of it outlives the run, however that ends."""

    def __init__(self, run: str, folder: Path, watchdog: Watchdog) -> None:
        """
        Args:
            run: its id.
            folder: of temporary files; it is removed at the end.
            watchdog: ends what is left where this process cannot.
        """
        self.run = run
        self.folder = folder
        self._watchdog = watchdog
        self.spawned = Spawned(watchdog.pid, watchdog.note)
        self.limiter = Limiter(watchdog.limit_groups)
        """Sets what its processes may use at most."""

    @classmethod
    def begin(cls, run: str) -> "Custody":
        """Take over the machine's part of a run; this process must have a single thread."""
        folder = Path(tempfile.mkdtemp(prefix="robo-"))
        watchdog = Watchdog(run, folder)
        orphans.adopt_orphans()
        return cls(run, folder, watchdog)

    def take_in(self, pid: int) -> None:
        """A process that was started before is of the run as well."""
        self._watchdog.take_in(pid)
        self.spawned.add(pid)

    async def end_leftovers(self) -> list[int]:
        """End what earlier runs have left behind, and return the process ids."""
        return await asyncio.to_thread(orphans.end_leftovers) if orphans.leftovers() else []

    def reap(self) -> None:
        """Collect what nodes have left behind and has ended; to be called a few times a second."""
        orphans.reap(self.spawned)

    async def sweep(self, tell: Callable[[orphans.Left], None]) -> None:
        """End every process of the run that is still there, and tell of each."""
        for left in await asyncio.to_thread(orphans.sweep, self.run, (self._watchdog.pid,), adopted=True):
            tell(left)

    def release(self) -> None:
        """The run has ended as it should: nobody needs to watch over it any more."""
        self._watchdog.dismiss()

    def remove_folder(self) -> None:
        """Remove the temporary files."""
        shutil.rmtree(self.folder, ignore_errors=True)
