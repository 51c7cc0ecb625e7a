"""Modules that a node says it needs, and that are not installed."""

import sys
from collections.abc import Mapping
from importlib.util import find_spec


def absent(requires: Mapping[str, str]) -> list[str]:
    """What to install for modules that are not there, a sentence for each.

    Args:
        requires: by module, what `pip install` brings it.
    """
    return [
        f"needs the module {module}, which is not installed: {installing(install)}"
        for module, install in requires.items()
        if not _is_there(module)
    ]


def installing(what: str) -> str:
    """The command that installs something; in quotes where a shell would look for files of such names."""
    return f"pip install '{what}'" if "[" in what else f"pip install {what}"


def _is_there(module: str) -> bool:
    """Whether it can be imported, without importing it."""
    if module in sys.modules:
        return sys.modules[module] is not None
    try:
        return find_spec(module) is not None
    except (ImportError, ValueError):  # what it is part of is not there
        return False
