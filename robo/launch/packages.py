"""Installed Python packages, and those of the folder one works in: where their files are, without importing them."""

import importlib.machinery
import importlib.util
import pkgutil
from pathlib import Path

from robo.text.brief import shown
from robo.text.suggestions import hint
from robo.wire.names import is_word


def folders_of(package: str) -> list[Path]:
    """The folders of a package; more than one where several installations share its name.

    Raises:
        LookupError: there is no such package; its text says so.
    """
    if not is_word(package):
        raise LookupError(f"{shown(package)} is not a valid name of a Python package; for example robo")
    try:
        spec = importlib.util.find_spec(package)
    except (ImportError, ValueError):
        spec = None
    # A package of the folder one works in needs no installation.
    spec = spec or importlib.machinery.PathFinder.find_spec(package, [str(Path.cwd())])
    if spec is None or not spec.submodule_search_locations:
        meant = hint(package, _known(), "; is it installed here?")
        raise LookupError(f"there is no package {shown(package)}{meant}")
    return [Path(place) for place in spec.submodule_search_locations]


def _known() -> list[str]:
    paths = [None, [str(Path.cwd())]]
    return [module.name for path in paths for module in pkgutil.iter_modules(path) if module.ispkg]
