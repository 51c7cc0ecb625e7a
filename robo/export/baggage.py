"""The files and folders that containers get along, and where they stand in them."""

import os
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

from robo.export.names import slug, take
from robo.export.placeholders import Placeholders
from robo.launch.find import SHARE

FILES = "/etc/robo"
"""Where the files that processes read stand in their containers."""

PROJECT = "/srv"
"""Where folders that processes run in stand in theirs."""

PACKAGES = "/opt/robo/site-packages"
"""Where the image has the packages that are installed in it; its Dockerfile makes this link."""


class Project:
    """The files of a project, as a Compose file in its folder names them."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder.absolute()
        self._configs: dict[str, dict[str, str]] = {}

    @property
    def configs(self) -> Mapping[str, dict[str, str]]:
        """By name, the files that containers get, for the section `configs`."""
        return dict(sorted(self._configs.items()))

    def source(self, path: Path) -> str:
        """A path of the project as the Compose file names it."""
        relative = os.path.relpath(path, self._folder)
        return relative if relative.startswith(".") else f"./{relative}"

    def path(self, source: str) -> Path:
        """Where a file is that `source` has named."""
        return Path(os.path.normpath(self._folder / source))

    def within(self, path: Path) -> str | None:
        """A path as it is called in the project: below the folder of the Compose file, or below the current one."""
        for folder in (self._folder, Path.cwd()):
            if path.is_relative_to(folder):
                return str(path.relative_to(folder))
        return None

    def packaged(self, path: Path) -> str | None:
        """Where the image has a file that belongs to an installed package; None for any other file."""
        for number, part in enumerate(path.parts):
            if part in ("site-packages", "dist-packages"):
                return "/".join((PACKAGES, *path.parts[number + 1 :]))
        if path.is_relative_to(SHARE) and self.within(path) is None:
            return f"{PACKAGES}/robo/share/{path.relative_to(SHARE)}"
        return None

    def has(self, path: Path) -> bool:
        """Whether a path is one of the project's or of an installed package's."""
        return self.within(path) is not None or self.packaged(path) is not None

    def config(self, path: Path) -> tuple[str, str]:
        """The name of the config that brings a file, and how the file is called within `FILES`."""
        within = self.within(path)
        source = {"file": str(path) if within is None else self.source(path)}
        called = path.name if within is None else within
        name = next((name for name, known in self._configs.items() if known == source), None)
        if name is None:
            name = take(slug(called).strip("_"), set(self._configs))
            self._configs[name] = source
        return name, called


class Baggage:
    """What one container gets along of its project: files as configs, folders as volumes that it cannot write."""

    def __init__(self, project: Project, names: Placeholders, shown: Callable[[str], str] | None = None) -> None:
        """
        Args:
            project: whose files they are.
            names: the words that stand for variables.
            shown: a text with its variables as the system has them; by default as Compose has.
        """
        self._project = project
        self._names = names
        self._shown = shown or names.shown
        self._files: dict[str, str] = {}
        self._volumes: dict[str, str] = {}

    @property
    def configs(self) -> list[dict[str, str]]:
        """The files, for the key `configs` of its service."""
        return [{"source": name, "target": target} for name, target in self._files.items()]

    @property
    def volumes(self) -> list[str]:
        """The folders, for the key `volumes` of its service."""
        return [f"{source}:{target}:ro" for source, target in self._volumes.items()]

    def file(self, path: Path) -> str:
        """Bring a file; returns where it stands in the container."""
        path = Path(os.path.abspath(path))
        packaged = self._project.packaged(path)
        if packaged is not None:
            return packaged
        name, called = self._project.config(path)
        if name not in self._files:
            target = f"{FILES}/{called}"
            self._files[name] = target if target not in self._files.values() else f"{FILES}/{name}/{path.name}"
        return self._files[name]

    def word(self, word: str, cwd: str | None) -> str:
        """A word of a command that runs in a folder; a file of the project that the word names is brought."""
        portable = _portable(word)
        if portable == word and (os.path.isabs(word) or cwd is None):
            path = Path(os.path.abspath(word))
            if path.is_file() and self._project.has(path):
                return self.file(path)
        return portable

    def folder(self, folder: str) -> str:
        """The folder that a process runs in: one of the project is mounted, another is the container's own."""
        path = Path(os.path.abspath(folder))
        packaged = self._project.packaged(path)
        if packaged is not None:
            return packaged
        within = self._project.within(path)
        if within is None or not path.is_dir():
            return self._shown(folder)
        target = os.path.normpath(f"{PROJECT}/{within}")
        self._volumes[self._project.source(path)] = target
        return target

    def value(self, value: object) -> object:
        """A parameter's value, with the path of a file as it is within the container."""
        if not isinstance(value, str):
            return value
        folder, named = self._names.parted(value)
        # Below other folders a container has files of its own.
        if named and os.path.isabs(folder) and self._project.has(Path(os.path.abspath(folder))):
            source = self._shown(named)
            self._volumes[source] = f"{FILES}/{slug(source.partition(':')[0]).strip('_').lower()}"
            return self._volumes[source]
        if os.path.isabs(value) and Path(value).is_file():
            return self.file(Path(value))
        return value


def _portable(word: str) -> str:
    """A word of a command without where things are on this machine."""
    if word == sys.executable:
        return "python"
    path = Path(word)
    installed = path == Path(sys.executable).with_name("robo") or (
        path.parents[1:] and _is_environment(path.parents[1])
    )
    return path.name if installed else word


def _is_environment(folder: Path) -> bool:
    """Whether it is a virtual environment of Python."""
    return (folder / "pyvenv.cfg").is_file()
