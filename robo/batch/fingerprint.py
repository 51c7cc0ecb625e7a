"""What results follow from, as hashes: contents of recordings, manifests, and code."""

import hashlib
import sys
from collections.abc import Iterable, Iterator
from importlib.util import find_spec
from pathlib import Path

import msgspec

from robo.batch.plan import Work
from robo.version import VERSION

_BLOCK = 1 << 20
_FORM = 1
"""Of results: another one where a change of robo's makes other ones of the same inputs."""

_HOW = ("timeout", "keep", "folder")
"""Fields of the work by which a run is done, and that its result does not follow from."""


def of_work(work: Work, files: Iterable[str], modules: Iterable[str]) -> dict[str, object]:
    """What all runs of a batch follow from.

    Args:
        work: what is done.
        files: manifests, files of parameters and of tolerances.
        modules: of nodes and functions; the code of their packages counts.
    """
    said = {name: value for name, value in msgspec.to_builtins(work).items() if name not in _HOW}
    words = [word for word in work.command if Path(word).is_file()]
    return {
        "form": _FORM,
        "robo": VERSION,
        "work": said,
        "files": {name: of_file(Path(name)) for name in sorted({*files, *words})},
        "code": {name: of_code(name) for name in sorted({module.partition(".")[0] for module in modules})},
    }


def of_file(path: Path) -> str:
    """A hash of what a file holds, or of what the files of a folder do; of one that cannot be read, why.

    A file that cannot be read is a failure of the runs that read it, and no reason to run none.
    """
    hashed = hashlib.blake2b(digest_size=20)
    try:
        files = sorted(one for one in path.rglob("*") if one.is_file()) if path.is_dir() else [path]
        for file in files:
            hashed.update(f"{file.relative_to(path)}\0".encode(errors="surrogateescape"))
            with file.open("rb") as opened:
                while block := opened.read(_BLOCK):
                    hashed.update(block)
    except OSError as error:
        return f"unreadable: {error.strerror}"
    return hashed.hexdigest()


def of_code(module: str) -> str:
    """A hash of the Python files of a package, or of a module that is in none; empty where it is not there."""
    hashed = hashlib.blake2b(digest_size=20)
    found = False
    for file in _sources(module):
        found = True
        hashed.update(f"{file.name}\0{of_file(file)}\0".encode(errors="surrogateescape"))
    return hashed.hexdigest() if found else ""


def _sources(module: str) -> Iterator[Path]:
    if str(Path.cwd()) not in sys.path:
        sys.path.insert(0, str(Path.cwd()))  # as nodes are found
    try:
        spec = find_spec(module)
    except (ImportError, ValueError):
        return
    if spec is None:
        return
    for folder in spec.submodule_search_locations or ():
        yield from sorted(Path(folder).rglob("*.py"))
    if not spec.submodule_search_locations and spec.origin and Path(spec.origin).is_file():
        yield Path(spec.origin)
