"""Which files of ROS's definitions there are below some paths, and of which package each is.

Paths are asked for by `os.path`, which takes folders that may not be looked into and circles of links; pathlib raises.
"""

import os
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from robo.errors import InterfaceError, UnreadableFile
from robo.interfaces.catalogue import Kind
from robo.text.brief import shown
from robo.text.files import read_text

KINDS: dict[str, Kind] = {".msg": "message", ".srv": "service", ".action": "action"}
"""What a file defines, by how its name ends."""
FOLDERS = ("msg", "srv", "action")
_IGNORED = ("COLCON_IGNORE", "AMENT_IGNORE")
"""Files by which ROS's builds know folders to leave out, its own results among them."""
_MOST_FILES = 20_000
_NAME = re.compile(r"<name>([^<>]*)</name>")


class Source(NamedTuple):
    """A file that defines something."""

    path: Path
    package: str
    kind: Kind
    text: str

    @property
    def name(self) -> str:
        """Of what it defines."""
        return self.path.stem


def find_sources(paths: Iterable[Path], package: str | None) -> list[Source]:
    """All files that some paths name, in the order of their names.

    Args:
        paths: of files, and of folders with such below them; links are followed, as colcon does.
        package: of files that are in none.

    Raises:
        InterfaceError: a path leads to nothing, a file or a folder cannot be read, or it is not known of which package
            a file is; all that is so.
    """
    found: dict[str, Source] = {}
    faults: list[str] = []
    names: dict[Path, str | None] = {}
    for path in paths:
        for file in _files(path, faults):
            real = os.path.realpath(file)
            if real not in found:
                try:
                    found[real] = _source(file, package, names)
                except InterfaceError as error:
                    faults.append(str(error))
    if faults:
        raise InterfaceError("\n".join(dict.fromkeys(faults)))
    return sorted(found.values(), key=lambda source: (source.package, source.kind, source.name, str(source.path)))


def _files(path: Path, faults: list[str]) -> Iterator[Path]:
    """The files that a path names; adds what is wrong with it to faults."""
    if not os.path.isdir(path):
        if path.suffix not in KINDS and os.path.exists(path):
            faults.append(f"{path}: expected a folder, or a file that ends with .msg, .srv or .action")
        else:
            yield path
        return
    count, before = 0, len(faults)
    seen: set[str] = set()

    def unreadable(error: OSError) -> None:
        faults.append(f"{error.filename}: {error.strerror}")

    for folder, inner, files in os.walk(path, onerror=unreadable, followlinks=True):
        real = os.path.realpath(folder)
        if real in seen:  # links may lead anywhere, to a folder around them as well
            inner.clear()
            continue
        seen.add(real)
        here = Path(folder)
        inner[:] = sorted(name for name in inner if not name.startswith(".") and not _is_ignored(here / name))
        for name in sorted(files):
            if Path(name).suffix in KINDS:
                count += 1
                yield here / name
        if count > _MOST_FILES:
            faults.append(f"{path}: more than {_MOST_FILES:,} files; name the packages that you want")
            return
    if not count and len(faults) == before:
        faults.append(f"{path}: no file below it ends with .msg, .srv or .action")


def _is_ignored(folder: Path) -> bool:
    return any(os.path.exists(folder / name) for name in _IGNORED)


def _source(file: Path, package: str | None, names: dict[Path, str | None]) -> Source:
    try:
        text = read_text(file)
    except UnreadableFile as error:
        raise InterfaceError(f"{file}: {error}") from None
    name = _package_of(Path(os.path.realpath(file)), names) or package
    if name is None:
        raise InterfaceError(f"{file}: it is in the folder of no ROS package; say which one it is of: --package NAME")
    return Source(file, name, KINDS[file.suffix], text)


def _package_of(file: Path, names: dict[Path, str | None]) -> str | None:
    """As the nearest `package.xml` says, else the folder around `msg`, `srv` or `action`."""
    for folder in file.parents:
        if folder not in names:
            names[folder] = _said_in(folder / "package.xml")
        if names[folder] is not None:
            return names[folder]
    return file.parent.parent.name if file.parent.name in FOLDERS else None


def _said_in(file: Path) -> str | None:
    if not os.path.isfile(file):
        return None
    try:
        first, *rest = read_text(file).split("<!--")
    except UnreadableFile as error:
        raise InterfaceError(f"{file}: {error}") from None
    match = _NAME.search(first + "".join(part.partition("-->")[2] for part in rest))
    if match is None or not match[1].strip():
        raise InterfaceError(f"{file}: it does not say the name of its package; {shown('<name>my_msgs</name>')} does")
    return match[1].strip()
