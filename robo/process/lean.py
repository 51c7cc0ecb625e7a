"""Keeping processes small: what a library would bring along and nobody here uses stays out."""

import importlib
import sys
from types import ModuleType
from typing import Any


class _Later(ModuleType):
    """Stands for a module until something of it is wanted."""

    def __getattr__(self, name: str) -> object:
        if name.startswith("__"):  # what Python itself asks of a module while it imports others
            raise AttributeError(name)
        if sys.modules.get(self.__name__) is self:
            del sys.modules[self.__name__]
        return getattr(importlib.import_module(self.__name__), name)


def import_msgspec() -> None:
    """Import msgspec without typing_extensions, and without `msgspec.inspect` until that is used.

    Where another package has brought typing_extensions, msgspec takes two names from it that Python's
    own typing has as well. It would cost each node 1 MB and some milliseconds. `msgspec.inspect`, which
    makes JSON Schemas, would cost 0.3 MB.
    """
    if "msgspec" not in sys.modules:
        sys.modules["msgspec.inspect"] = _Later("msgspec.inspect")
    _import("msgspec", without="typing_extensions")


def import_yaml() -> None:
    """Import PyYAML without its C parser: 0.4 MB that do not pay for a small file.

    Not for a process that reads manifests: they are read ten times as fast with it.
    """
    _import("yaml", without="yaml._yaml")


def import_asyncio() -> None:
    """Import asyncio without TLS, which is Zenoh's business here: OpenSSL takes a supervisor some MB."""
    _import("asyncio", without="ssl")


def _import(name: str, *, without: str) -> None:
    modules: dict[str, Any] = sys.modules
    if name in modules or without in modules:
        return
    modules[without] = None  # an import of it fails
    try:
        importlib.import_module(name)
    except ImportError:  # one that cannot do without gets it
        pass
    finally:
        del modules[without]
