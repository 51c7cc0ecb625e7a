"""Where the files of a Python package are, without importing it."""

import importlib.machinery
import importlib.util
import re
import sys
from pathlib import Path

NAME = re.compile(r"[A-Za-z_]\w*", re.ASCII)
"""What a package may be called."""

_MODULE = re.compile(r"[A-Za-z_]\w*([.][A-Za-z_]\w*)*", re.ASCII)


def is_module_name(text: str) -> bool:
    """Whether this may be the full name of a module."""
    return _MODULE.fullmatch(text) is not None


def spec_of(module: str) -> importlib.machinery.ModuleSpec | None:
    """Where a node's process finds a module: in the folder one works in, then where Python looks.

    None where it is in neither. Nothing is imported, its parents neither.
    """
    first, *others = module.split(".")
    spec = importlib.machinery.PathFinder.find_spec(first, [str(Path.cwd())])
    if spec is None or spec.origin is None:  # a folder without __init__.py is a package only where there is no other
        spec = _installed(first) or spec
    name = first
    for part in others:
        if spec is None or spec.submodule_search_locations is None:
            return None
        name = f"{name}.{part}"
        spec = importlib.machinery.PathFinder.find_spec(name, list(spec.submodule_search_locations))
    return spec


def folders_of(module: str) -> tuple[Path, ...]:
    """The folders of a package; more than one where several installations share its name, none where it is none."""
    spec = spec_of(module)
    return tuple(map(Path, spec.submodule_search_locations or ())) if spec is not None else ()


def share_of(folders: tuple[Path, ...]) -> Path | None:
    """The folder with a package's manifests and parameter files.

    It is `share` in the package; of a checkout, where a wheel would have that, the project's folder: the one
    above the package, or above the `src` that it stands in, with a `pyproject.toml`.
    """
    for folder in folders:
        if (folder / "share").is_dir():
            return folder / "share"
    for folder in folders:
        above = folder.parent.parent if folder.parent.name == "src" else folder.parent
        if (above / "pyproject.toml").is_file():
            return above
    return None


def _installed(module: str) -> importlib.machinery.ModuleSpec | None:
    if module in sys.modules and getattr(sys.modules[module], "__spec__", None) is None:
        return None
    try:
        return importlib.util.find_spec(module)
    except (ImportError, ValueError):
        return None
