"""Keeping the process of a node small."""

import importlib
import sys
from typing import Any


def import_msgspec() -> None:
    """Import msgspec without typing_extensions.

    Where another package has brought typing_extensions, msgspec takes two names from it that Python's
    own typing has as well. It would cost each node 1 MB and some milliseconds.
    """
    modules: dict[str, Any] = sys.modules
    if "typing_extensions" in modules:
        return
    modules["typing_extensions"] = None  # an import of it fails
    try:
        importlib.import_module("msgspec")
    except ImportError:  # a msgspec that cannot do without gets it
        pass
    finally:
        del modules["typing_extensions"]
