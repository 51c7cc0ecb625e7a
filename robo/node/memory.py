"""What a node keeps when it is started again within a run: an emergency stop must outlive whoever holds it.

A launch makes a file for each of its nodes, which lasts as long as the run. In a container ROBO_MEMORY
names a folder that lasts as long as the container. A node that is run alone keeps nothing.
"""

import os
import threading
from contextlib import suppress

import msgspec

from robo.environment import MEMORY_VARIABLE
from robo.errors import NotKept
from robo.text.unreadable import UNREADABLE


class Memory:
    """Values by name: plain data, as JSON holds it."""

    def __init__(self, file: "str | os.PathLike[str] | None" = None, *, expected: bool = False) -> None:
        """
        Args:
            file: where it is kept; None: nowhere.
            expected: whether the file was made before this node was started.
        """
        self._file = os.fspath(file) if file is not None else ""  # pathlib would cost each node 0.5 MB
        self._values: dict[str, object] = {}
        self._writing = threading.Lock()
        """Turns run beside each other: what one writes must not take the place of what another has kept meanwhile."""
        self.problem = ""
        """Why what this node had kept cannot be read, or nothing can be written; empty where all is well."""
        if not self._file:
            return
        try:
            with open(self._file, "rb") as kept:
                self._values = msgspec.json.decode(kept.read(), type=dict[str, object])
        except FileNotFoundError:
            self.problem = f"{file} is gone" if expected else ""
        except OSError as error:
            self.problem = f"{file}: {error.strerror}"
        except UNREADABLE:
            self.problem = f"{file} is not as it was written"
        if not self.lost:
            with suppress(NotKept):  # what cannot be written now may hold less than was to be kept
                self._write()

    @classmethod
    def of(cls, full_name: str, file: str = "") -> "Memory":
        """The memory of a node: in the file that its launch has made, or in the folder that ROBO_MEMORY names."""
        if file:
            return cls(file, expected=True)
        folder = os.environ.get(MEMORY_VARIABLE)
        return cls(os.path.join(folder, file_name(full_name)) if folder else None)

    @property
    def folder(self) -> str:
        """Where it is kept, for what a node keeps in a file of its own; empty where nothing is."""
        return os.path.dirname(self._file)

    @property
    def lost(self) -> bool:
        """Whether something may be lost, so that this node has to expect the worst."""
        return bool(self.problem)

    def recall(self, name: str) -> object:
        """What was kept under a name; None where nothing was."""
        return self._values.get(name)

    def keep(self, name: str, value: object) -> None:
        """Keep a value; it is safe from whatever ends this process once this returns.

        Raises:
            NotKept: it cannot be written. A restart then finds nothing and knows that something is lost.
        """
        with self._writing:
            self._values[name] = value
            self._write()

    def _write(self) -> None:
        if not self._file:
            return
        new = f"{self._file}.new"
        try:
            _write_bytes(new, msgspec.json.encode(self._values))
            os.replace(new, self._file)
        except OSError as error:
            self.problem = f"{self._file}: {error.strerror}"
            with suppress(OSError):  # a folder that is read-only, or gone
                os.unlink(new)
            with suppress(OSError):
                _write_bytes(self._file, b"")  # a file that is missing may never have been; an empty one is a loss
            raise NotKept(f"{self.problem}; a restart of this node cannot know what was") from None


def file_name(full_name: str) -> str:
    """What the file of a node is called."""
    return full_name.strip("/").replace("/", "%") + ".json"


def _write_bytes(file: str, data: bytes) -> None:
    with open(file, "wb") as out:
        out.write(data)
