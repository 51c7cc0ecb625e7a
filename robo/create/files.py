"""Writing what was made: all of it or nothing, and never over what is there."""

import os
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path

from robo.errors import CreateError


def conflicts(folder: Path, paths: Iterable[str]) -> list[str]:
    """What stands in the way of new files: a sentence for each."""
    found = []
    for path in paths:
        file = folder / path
        if os.path.lexists(file):
            found.append(f"{file} is there already; nothing is overwritten")
            continue
        above = next(parent for parent in file.parents if os.path.lexists(parent))
        if not above.is_dir():
            found.append(f"{above} is there already, and is no folder")
    return list(dict.fromkeys(found))


def write(folder: Path, new: Mapping[str, str | bytes], changed: Mapping[Path, tuple[str, str]] | None = None) -> None:
    """Write new files below a folder, and change others.

    Args:
        folder: made where it is not there.
        new: by path within it.
        changed: by path, the text as it was read and as it is to be.

    Raises:
        CreateError: something is in the way, has changed meanwhile, or cannot be written; nothing has been written.
    """
    in_the_way = conflicts(folder, new)
    if in_the_way:
        raise CreateError("\n".join(in_the_way))
    undo = _Undo()
    try:
        for path, text in new.items():
            undo.make_folders((folder / path).parent)
            with open(folder / path, "xb") as file:
                undo.files.append(folder / path)
                file.write(text if isinstance(text, bytes) else text.encode())
        for changed_file, (before, after) in (changed or {}).items():
            undo.replace(changed_file, before, after)
    except OSError as error:
        undo.all()
        raise CreateError(f"{error.filename} cannot be written: {error.strerror}; nothing is created") from None
    except BaseException:
        undo.all()
        raise


class _Undo:
    """What has been written so far."""

    def __init__(self) -> None:
        self.files: list[Path] = []
        self.folders: list[Path] = []
        self.texts: list[tuple[Path, bytes]] = []

    def make_folders(self, folder: Path) -> None:
        """Make a folder and those above it, where they are not there."""
        absent = [one for one in (folder, *folder.parents) if not one.is_dir()]
        for one in reversed(absent):
            one.mkdir()
            self.folders.append(one)

    def replace(self, file: Path, before: str, after: str) -> None:
        """Give a file another text, at once, if it is still as it was read."""
        whole = file.resolve()  # what a link points to
        if whole.read_bytes() != before.encode():
            raise CreateError(f"{file} has changed meanwhile; nothing is created")
        beside = whole.with_name(f".{whole.name}.new")
        with open(beside, "xb") as target:
            self.files.append(beside)
            target.write(after.encode())
        os.chmod(beside, whole.stat().st_mode & 0o7777)
        os.replace(beside, whole)
        self.files.remove(beside)
        self.texts.append((whole, before.encode()))

    def all(self) -> None:
        """Take all of it back, as far as that goes."""
        for file, text in self.texts:
            with suppress(OSError):
                file.write_bytes(text)
        for file in self.files:
            with suppress(OSError):
                file.unlink()
        for folder in reversed(self.folders):
            with suppress(OSError):
                folder.rmdir()
