"""The package that one stands in: the nearest `pyproject.toml` that announces one which is there, here or above."""

import tomllib
from pathlib import Path

import msgspec

from robo.create.addition import MESSAGE_TESTS, MESSAGES
from robo.create.render import MANIFEST, PARAMETERS
from robo.errors import CreateError, UnreadableFile
from robo.packages.announced import PACKAGES, PROJECT_FILE
from robo.text.files import read_text


class Project(msgspec.Struct, frozen=True):
    """A package of robo's, as files."""

    name: str
    """What it is imported as."""
    folder: Path
    """Where its `pyproject.toml` is."""
    package: Path
    """Where its Python files are."""

    @property
    def sources(self) -> str:
        """The path of its Python files within its folder."""
        return self.package.relative_to(self.folder).as_posix()

    def files(self) -> dict[str, str]:
        """The texts of the files that may be added to, by their paths within its folder.

        Raises:
            CreateError: one cannot be read.
        """
        found = {}
        for path in (MANIFEST, PARAMETERS, f"{self.sources}/{MESSAGES}", MESSAGE_TESTS):
            try:
                found[path] = read_text(self.folder / path)
            except UnreadableFile as error:
                if not error.missing:
                    raise CreateError(f"{path} cannot be read: {error}") from None
        return found


def find_project(here: Path) -> Project | None:
    """The package that a folder belongs to; None where it belongs to none.

    Raises:
        CreateError: a `pyproject.toml` cannot be read, or announces several packages.
    """
    for folder in (here, *here.parents):
        file = folder / PROJECT_FILE
        if not file.is_file():
            continue
        try:
            said = tomllib.loads(read_text(file))
        except (UnreadableFile, tomllib.TOMLDecodeError) as error:
            raise CreateError(f"{file} cannot be read: {error}") from None
        project = _project(folder, _announced(said))
        if project is not None:
            return project
    return None


def _announced(said: dict[str, object]) -> list[str]:
    """The modules of the entry points of our group."""
    inner: object = said
    for key in ("project", "entry-points", PACKAGES):
        inner = inner.get(key) if isinstance(inner, dict) else None
    return [str(module) for module in inner.values()] if isinstance(inner, dict) else []


def _project(folder: Path, announced: list[str]) -> Project | None:
    found = []
    for module in announced:
        for place in (folder / module.replace(".", "/"), folder / "src" / module.replace(".", "/")):
            if (place / "__init__.py").is_file():
                found.append(Project(module, folder, place))
    if len(found) > 1:
        file = folder / PROJECT_FILE
        raise CreateError(f"{file} announces several packages, {', '.join(announced)}; robo create adds to one alone")
    return found[0] if found else None
