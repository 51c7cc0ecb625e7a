"""The Python files of a folder that are somebody's code: no tests, no environments, nothing private."""

import os
import re
from collections.abc import Iterator
from pathlib import Path

_DEEPEST = 4
_NOT_FOR_USE = re.compile(r"[._].*|tests?|test_.*|.*_test|conftest|build|dist|node_modules|site-packages")


def python_files(folder: Path, depth: int = 0) -> Iterator[Path]:
    """The Python files below a folder that may hold nodes and messages, each folder's in the order of their names."""
    try:
        entries = sorted(os.scandir(folder), key=lambda entry: entry.name)
    except OSError:
        return
    for entry in entries:
        stem, dot, suffix = entry.name.partition(".")
        if entry.is_dir(follow_symlinks=False):
            usable = entry.name.isidentifier() and not _NOT_FOR_USE.fullmatch(entry.name)
            if usable and depth < _DEEPEST and not os.path.exists(os.path.join(entry.path, "pyvenv.cfg")):
                yield from python_files(Path(entry.path), depth + 1)
        elif dot and suffix == "py" and (stem == "__init__" or not _NOT_FOR_USE.fullmatch(stem)):
            yield Path(entry.path)


def module_of(file: Path, folder: Path, package: str = "") -> str:
    """The module as which a file is imported that lies in the folder of a package, or in one on Python's path."""
    parts = file.relative_to(folder).with_suffix("").parts
    return ".".join([*([package] if package else []), *parts]).removesuffix(".__init__")
