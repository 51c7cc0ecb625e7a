"""Control groups that limit single processes of a run, where this user may make such.

In version 2 a group with groups below it that are limited holds no process itself. So all of the run that has no
limits goes into a group `rest`, and the run's watchdog, which outlives its group, into one beside it. In version 1,
which older systems have, memory and processor time are apart, and groups may hold both.
"""

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from robo.launch.plan import LimitsPlan
from robo.machine import cgroup
from robo.machine.cgroup import ControlGroup

CONTROLLERS = frozenset({"memory", "cpu"})

_CPU_PERIOD = 100_000
"""Of a process with half of a core, each half of this time is its own, µs."""
_ROUNDS = 5
_REST = "rest"
_WATCHDOGS = "robo-watchdogs"
"""One for all runs: who is in it cannot remove it."""


class LimitGroup:
    """The group of one process."""

    def __init__(self, folders: Mapping[str, Path]) -> None:
        """
        Args:
            folders: by controller, `memory` and `cpu`, where its group is.
        """
        self._folders = folders
        self._old = (folders["memory"] / "memory.limit_in_bytes").exists() if "memory" in folders else False

    def limit(self, limits: LimitsPlan) -> list[str]:
        """Set what is limited; returns what could not be, by its key."""
        missing = []
        if limits.memory is not None and not self._limit_memory(limits.memory):
            missing.append("memory")
        if limits.cpu is not None and not self._limit_cpu(limits.cpu):
            missing.append("cpu")
        return missing

    def take(self, pid: int) -> bool:
        """Put a process in, and with it all that it starts from now on. Returns whether that worked."""
        return all(cgroup.move(pid, folder) for folder in {*self._folders.values()})

    def memory_kills(self) -> int:
        """How many of its processes the kernel has ended since it was made, because they needed more memory."""
        folder = self._folders.get("memory")
        if folder is None:
            return 0
        with suppress(OSError, ValueError):
            lines = (folder / ("memory.oom_control" if self._old else "memory.events")).read_text().splitlines()
            return sum(int(line.split()[1]) for line in lines if line.startswith("oom_kill "))
        return 0

    def _limit_memory(self, size: int) -> bool:
        if self._old:
            return self._write("memory", "memory.limit_in_bytes", str(size))
        self._write("memory", "memory.swap.max", "0")  # where there is swap; a robot that swaps is no use
        self._write("memory", "memory.oom.group", "1")
        return self._write("memory", "memory.max", str(size))

    def _limit_cpu(self, cores: float) -> bool:
        quota = str(max(1_000, round(cores * _CPU_PERIOD)))
        if self._write("cpu", "cpu.max", f"{quota} {_CPU_PERIOD}"):
            return True
        return self._write("cpu", "cpu.cfs_period_us", str(_CPU_PERIOD)) and self._write(
            "cpu", "cpu.cfs_quota_us", quota
        )

    def _write(self, controller: str, file: str, text: str) -> bool:
        path = self._folders.get(controller, Path("/nowhere")) / file
        if not path.exists():  # else some file systems would make it
            return False
        try:
            path.write_text(text)
        except OSError:
            return False
        return True


class LimitGroups:
    """Makes the groups of a run's processes, once the first one asks for it."""

    def __init__(self, run: str, group: ControlGroup | None, watchdog: int, own: Mapping[str, Path]) -> None:
        """
        Args:
            run: its id.
            group: the run's, of version 2; None where there is none.
            watchdog: the process id of what stays outside.
            own: where the control groups of this process were at the beginning.
        """
        self._run = run
        self._group = group
        self._watchdog = watchdog
        self._own = own
        self._parents: dict[str, Path] | None = None
        self._made: dict[str, LimitGroup] = {}

    def of(self, name: str) -> LimitGroup | None:
        """The group of a process by its full name; None where none can be made."""
        if name not in self._made:
            folders = {}
            for controller, parent in self._prepared().items():
                folder = parent / name.strip("/").replace("/", ".")
                with suppress(OSError):
                    folder.mkdir(parents=True, exist_ok=True)
                    folders[controller] = folder
            if not folders:
                return None
            self._made[name] = LimitGroup(folders)
        return self._made[name]

    def _prepared(self) -> dict[str, Path]:
        """By controller, the group below which those of processes are made."""
        if self._parents is None:
            old = {name: self._own[name] / cgroup.folder_name(self._run) for name in _old(self._own)}
            self._parents = old or self._divide()
        return self._parents

    def _divide(self) -> dict[str, Path]:
        """Have the group of the run hand its controllers on; what is in it goes into one of those below."""
        if self._group is None:
            return {}
        outer, inner = self._group.before, self._group.folder
        have = _words(outer / "cgroup.controllers") & CONTROLLERS
        if not have:
            return {}
        watchdogs, rest = outer / _WATCHDOGS, inner / _REST
        with suppress(OSError):
            watchdogs.mkdir(exist_ok=True)
            rest.mkdir(exist_ok=True)
            cgroup.move(self._watchdog, watchdogs)
            self._group.before = watchdogs
            for _ in range(_ROUNDS):  # what is in there may start more meanwhile
                for pid in _words(inner / "cgroup.procs"):
                    cgroup.move(int(pid), rest)
            for folder in (outer, inner):
                for controller in have:  # each by itself: one may not be granted
                    with suppress(OSError):  # somebody else's process may be in there
                        (folder / "cgroup.subtree_control").write_text(f"+{controller}")
        return dict.fromkeys(have & _words(inner / "cgroup.subtree_control"), inner)


def remove(run: str, own: Mapping[str, Path]) -> bool:
    """Remove the groups of version 1 of a run. Returns whether none is left."""
    gone = [cgroup.remove(own[name] / cgroup.folder_name(run)) for name in _old(own)]
    return all(gone)


def _old(own: Mapping[str, Path]) -> list[str]:
    return [name for name in ("memory", "cpu") if name in own]


def _words(file: Path) -> set[str]:
    try:
        return {*file.read_text().split()}
    except OSError:
        return set()
