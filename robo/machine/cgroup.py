"""A control group for a run, where this user may make one: the kernel ends what is in it, whatever it did to hide."""

import os
from contextlib import suppress
from pathlib import Path


class ControlGroup:
    """The control group of one run; all that the processes in it start is in it as well."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.before = folder.parent
        """Where this process comes from, and goes back to."""

    @classmethod
    def make(cls, run: str) -> "ControlGroup | None":
        """A group within the one that this process is in; None where that is not to be had."""
        own = own_folders().get("")
        if own is None:
            return None
        folder = own / folder_name(run)
        try:
            folder.mkdir()
        except OSError:
            return None
        if not (folder / "cgroup.kill").exists():  # Linux before 5.14
            folder.rmdir()
            return None
        return cls(folder)

    def enter(self) -> bool:
        """Put this process, and with it all that it starts from now on, into the group. Returns whether that worked."""
        return self.take(os.getpid())

    def take(self, pid: int) -> bool:
        """Put another process into the group. Returns whether that worked."""
        return move(pid, self.folder)

    def leave(self) -> None:
        """Put this process back."""
        move(os.getpid(), self.before)

    def kill(self) -> None:
        """End everything in the group."""
        with suppress(OSError):
            (self.folder / "cgroup.kill").write_text("1")

    def remove(self) -> bool:
        """Remove the group and those in it. Returns whether it is gone: it has to be empty."""
        return remove(self.folder)


def folder_name(run: str) -> str:
    """What the group of a run is called."""
    return f"robo-{run}"


def move(pid: int, folder: Path) -> bool:
    """Put a process into the group of a folder. Returns whether that worked; for one that is gone it has."""
    try:
        (folder / "cgroup.procs").write_text(str(pid))
    except ProcessLookupError:
        return True
    except OSError:
        return False
    return True


def remove(folder: Path) -> bool:
    """Remove a group with those in it, one below the other. Returns whether it is gone: all have to be empty."""
    with suppress(OSError):
        for inner in folder.iterdir():
            if inner.is_dir():
                remove(inner)
    try:
        folder.rmdir()
    except FileNotFoundError:
        return True
    except OSError:
        return False
    return True


def own_folders(
    mounts: Path = Path("/proc/self/mountinfo"), groups: Path = Path("/proc/self/cgroup")
) -> dict[str, Path]:
    """Where the control groups of this process are: of version 2 by an empty name, of version 1 by their controller."""
    try:
        mounted = [line.split(" - ") for line in mounts.read_text().splitlines()]
        own = [line.split(":", 2) for line in groups.read_text().splitlines()]
    except OSError:
        return {}
    inside = {name: path for _, names, path in own for name in names.split(",")}
    found: dict[str, Path] = {}
    for left, right in mounted:
        root, point = left.split()[3:5]
        kind, _, options = right.split(" ", 2)
        names = [""] if kind == "cgroup2" else options.split(",") if kind == "cgroup" else []
        for name in names:
            # A container sees a part of the hierarchy; what it is in may be said as from outside.
            path = inside.get(name)
            if path is not None and name not in found:
                within = path.removeprefix(root.rstrip("/")) if path.startswith(root.rstrip("/")) else "/"
                found[name] = Path(point + within)
    return found
