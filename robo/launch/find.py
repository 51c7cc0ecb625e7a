"""Where manifests are looked for."""

import os
import re
from pathlib import Path

from robo.brief import shown
from robo.errors import ManifestError
from robo.suggestions import suggest

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
    the workspace's `launch/`, then among those that ship with robo.

    Raises:
        ManifestError: it is nowhere; says where it was looked for and what is there.
    """
    folders = [beside or Path.cwd(), Path.cwd() / "launch", SHARE / "launch"]
    for folder in folders:
        path = nearby(folder / name)
        if os.path.isfile(path):
            return Path(path)
    known = sorted({p.name for folder in folders[1:] if folder.is_dir() for p in folder.glob("*.yaml")})
    looked = ", ".join(dict.fromkeys(str(folder) for folder in folders))
    raise ManifestError(f"there is no manifest {shown(name)}; {suggest(name, known, 'there are')} (looked in {looked})")


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
