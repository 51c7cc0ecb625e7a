"""What installed packages, and the project in the current folder, announce by entry points. Imports none of them."""

import contextlib
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote, urlsplit

import msgspec

from robo.errors import UnreadableFile
from robo.text.files import read_text
from robo.text.readable import readable

if TYPE_CHECKING:
    from importlib.metadata import Distribution

PACKAGES = "robo.packages"
"""The group of packages with nodes, messages and manifests: name of the package = its module."""
MESSAGES = "robo.messages"
"""The group of packages that hold only messages: any name = the module with the types."""

PROJECT_FILE = "pyproject.toml"


class Announced(msgspec.Struct, frozen=True, kw_only=True):
    """An entry point, and who announces it."""

    name: str
    value: str
    """Meant to be a module; whatever stands there."""
    distribution: str = ""
    """As `pip list` shows it; empty where nothing is installed, and the current folder's project announces it."""
    version: str = ""
    description: str = ""
    editable: bool = False
    """Whether it is installed such that the files of its project are used where they are."""
    home: Path
    """Where its modules are: the folder it was installed into, or its project."""

    @property
    def by(self) -> str:
        """Who announces it, in words."""
        return (
            f"{self.distribution} {self.version}".rstrip()
            if self.distribution
            else f"the {PROJECT_FILE} of this folder"
        )


def installed(group: str) -> list[Announced]:
    """What the installed distributions announce in a group, by name.

    Of two distributions of one name it is the one that Python meets first. Files that cannot be read are
    passed over: one that is damaged does not hide the others.
    """
    from importlib.metadata import distributions

    found: list[Announced] = []
    seen: set[str] = set()
    for distribution in distributions():
        entries = list(_entries(_read(distribution, "entry_points.txt"), group))
        if entries and (about := _about(distribution)).get("distribution", "") not in seen:
            seen.add(about["distribution"])
            found += [Announced(name=name, value=value, **about) for name, value in entries]
    return sorted(found, key=lambda one: (one.name, one.distribution))


def of_folder(folder: Path) -> list[Announced]:
    """The packages that the project in a folder would announce if it were installed.

    Raises:
        LookupError: its `pyproject.toml` cannot be read; says why.
    """
    file = folder / PROJECT_FILE
    if not file.is_file():
        return []
    import tomllib

    try:
        project = _table(tomllib.loads(read_text(file)), "project")
    except (UnreadableFile, ValueError, RecursionError) as error:
        raise LookupError(f"the {PROJECT_FILE} of this folder cannot be read: {error}") from None
    version, description = (str(project.get(key, "")) for key in ("version", "description"))
    entries = _table(_table(project, "entry-points"), PACKAGES)
    return [
        Announced(name=name, value=str(value), version=version, description=description, home=folder)
        for name, value in entries.items()
    ]


def _table(whole: Any, name: str) -> dict[str, Any]:
    table = whole.get(name, {})
    return table if isinstance(table, dict) else {}


def _entries(text: str, group: str) -> Iterator[tuple[str, str]]:
    """Names and values of a group; a line without a value has an empty one."""
    section = ""
    for line in map(str.strip, text.splitlines()):
        if line.startswith("["):
            section = line.strip("[] ")
        elif section == group and line and line[0] not in "#;":
            name, _, value = line.partition("=")
            # What is behind it in brackets are extras.
            yield name.strip(), re.sub(r"\s*\[.*\]$", "", value.strip())


def _about(distribution: "Distribution") -> dict[str, Any]:
    lines = _read(distribution, "METADATA") or _read(distribution, "PKG-INFO")
    fields = dict(_header(lines.splitlines()))
    about: dict[str, Any] = {
        "distribution": fields.get("Name", "a distribution without a name"),
        "version": fields.get("Version", ""),
        "description": fields.get("Summary", ""),
        "home": Path(str(distribution.locate_file(""))),
    }
    with contextlib.suppress(msgspec.DecodeError, ValueError):
        origin = msgspec.json.decode(_read(distribution, "direct_url.json") or "{}", type=readable(_Origin))
        if origin.dir_info.editable:
            about |= {"editable": True, "home": Path(unquote(urlsplit(origin.url).path))}
    return about


class _Folder(msgspec.Struct):
    editable: bool = False


class _Origin(msgspec.Struct):
    """What pip writes down of where a distribution comes from."""

    url: str = ""
    dir_info: _Folder = msgspec.field(default_factory=_Folder)


def _header(lines: Sequence[str]) -> Iterator[tuple[str, str]]:
    for line in lines:
        if not line:
            return  # below it stands the long description
        name, _, value = line.partition(":")
        yield name, value.strip()


def _read(distribution: "Distribution", name: str) -> str:
    with contextlib.suppress(OSError, ValueError):  # ValueError: it is not UTF-8
        return distribution.read_text(name) or ""
    return ""
