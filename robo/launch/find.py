"""Where manifests are looked for."""

import os
import re
from collections.abc import Iterable
from pathlib import Path

from robo.errors import ManifestError
from robo.packages.find import Package, find
from robo.text.brief import shown
from robo.text.suggestions import suggest

_IN_PACKAGE = re.compile(r"([A-Za-z_]\w*):(?!=)(.+)", re.ASCII)

SHARE = Path(__file__).resolve().parent.parent / "share"
"""The manifests and parameter files that ship with robo."""


def nearby(path: Path) -> str:
    """A path as people want to read it: relative where it lies in the current folder."""
    whole = os.path.abspath(path)
    here = os.getcwd().rstrip("/") + "/"
    return whole.removeprefix(here)


def find_manifest(name: str, beside: Path | None = None) -> Path:
    """The file of a manifest.

    Looked for as the path given (from the current folder, or from `beside` in an include), then in
    the workspace's `launch/`, then among those that ship with robo. `PACKAGE:FILE` is looked for in
    a Python package: in the `launch/` of its share folder, its `launch/`, then in the package's own folder.

    Raises:
        ManifestError: it is nowhere; says where it was looked for and what is there.
    """
    folders = [beside or Path.cwd(), Path.cwd() / "launch", SHARE / "launch"]
    found = _first(name, folders)
    if found is not None:
        return found
    given = folders[0] / name
    if os.path.exists(given) and not given.is_dir():  # a pipe, a device
        raise ManifestError(f"manifest {nearby(given)} cannot be read: it is not a file")
    within = _IN_PACKAGE.fullmatch(name)
    if within is not None:
        return _find_in_package(within[1], within[2])
    known = sorted({p.name for folder in folders[1:] if folder.is_dir() for p in folder.glob("*.yaml")})
    looked = ", ".join(dict.fromkeys(str(folder) for folder in folders))
    raise ManifestError(f"there is no manifest {shown(name)}; {suggest(name, known, 'there are')} (looked in {looked})")


def manifest_meant(word: str) -> str | None:
    """The manifest that a word without `.yaml`, or with `.launch.py` as in ROS 2, means, if there is one."""
    name = f"{re.sub(r'([.]launch)?[.](py|xml)$', '', word)}.yaml"
    try:
        find_manifest(name)
    except ManifestError:
        return None
    return name


def names_manifest(word: str) -> bool:
    """Whether a word of a command line names a manifest, and no group: groups are named with `/` too."""
    return word.endswith((".yaml", ".yml")) or _IN_PACKAGE.fullmatch(word) is not None or Path(word).is_file()


def _find_in_package(package: str, name: str) -> Path:
    try:
        own = find(package)
    except LookupError as error:
        raise ManifestError(f"manifest {package}:{name}: {error}") from None
    folders = manifest_folders(own)
    found = _first(name, folders) if not os.path.isabs(name) else None
    if found is not None:
        return found
    known = [f"{package}:{path.name}" for path in manifests_of(own)]
    looked = ", ".join(map(str, folders))
    instead = suggest(f"{package}:{name}", known, "it has") if known else "it has none"
    raise ManifestError(f"package {package} has no manifest {shown(name)}; {instead} (looked in {looked})")


def manifest_folders(package: Package) -> list[Path]:
    """Where a package's manifests are looked for, the first first."""
    share = [package.share / "launch"] if package.share is not None else []
    inside = [folder / place for folder in package.folders for place in ("share/launch", "launch", "")]
    return list(dict.fromkeys([*share, *inside]))


def manifests_of(package: Package) -> list[Path]:
    """A package's manifests; of two of one name the one that `PACKAGE:FILE` means."""
    found: dict[str, Path] = {}
    for folder in manifest_folders(package):
        for path in manifests_in(folder):
            found.setdefault(path.name, path)
    return list(found.values())


def _first(name: str, folders: Iterable[Path]) -> Path | None:
    paths = (nearby(folder / name) for folder in folders)
    return next((Path(path) for path in paths if os.path.isfile(path)), None)


_BEGINS = re.compile(rb"^(?:groups|nodes|include) *:", re.MULTILINE)
_HEAD = 100_000
"""Bytes of a file in which it is seen what it is."""


def manifests_in(folder: Path) -> list[Path]:
    """The files of a folder that read like manifests, and not like parameter or Compose files."""
    found = []
    for path in sorted([*folder.glob("*.yaml"), *folder.glob("*.yml")]):
        if not path.is_file():  # a pipe would make whoever reads it wait
            continue
        try:
            with path.open("rb") as file:
                if _BEGINS.search(file.read(_HEAD)):
                    found.append(path)
        except OSError:
            continue  # not for this user
    return found
