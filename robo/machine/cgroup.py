"""A control group for a run, where this user may make one: the kernel ends what is in it, whatever it did to hide."""

import os
from contextlib import suppress
from pathlib import Path


class ControlGroup:
    """The control group of one run; all that the processes in it start is in it as well."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._before = folder.parent

    @classmethod
    def make(cls, run: str) -> "ControlGroup | None":
        """A group within the one that this process is in; None where that is not to be had."""
        own = _own_folder()
        if own is None:
            return None
        folder = own / f"robo-{run}"
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
        return self._move_to(self._folder)

    def leave(self) -> None:
        """Put this process back."""
        self._move_to(self._before)

    def kill(self) -> None:
        """End everything in the group."""
        with suppress(OSError):
            (self._folder / "cgroup.kill").write_text("1")

    def remove(self) -> bool:
        """Remove the group. Returns whether it is gone: it has to be empty."""
        try:
            self._folder.rmdir()
        except FileNotFoundError:
            return True
        except OSError:
            return False
        return True

    def _move_to(self, folder: Path) -> bool:
        try:
            (folder / "cgroup.procs").write_text(str(os.getpid()))
        except OSError:
            return False
        return True


def _own_folder() -> Path | None:
    """Where the control group (version 2) of this process is."""
    try:
        mounts = [line.split(" - ") for line in Path("/proc/self/mountinfo").read_text().splitlines()]
        groups = Path("/proc/self/cgroup").read_text().splitlines()
    except OSError:
        return None
    mounted = [left.split()[4] for left, right in mounts if right.startswith("cgroup2 ")]
    inside = [line[3:] for line in groups if line.startswith("0::")]
    return Path(mounted[0] + inside[0]) if mounted and inside else None
