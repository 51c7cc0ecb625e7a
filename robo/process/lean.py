"""Keeping processes small: what a library would bring along and nobody here uses stays out."""

import importlib
import os
import sys
import typing
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import Any


class _Later(ModuleType):
    """Stands for a module until something of it is wanted."""

    def __getattr__(self, name: str) -> object:
        if name.startswith("__"):  # what Python itself asks of a module while it imports others
            raise AttributeError(name)
        return getattr(self._module(), name)

    def _module(self) -> ModuleType:
        if sys.modules.get(self.__name__) is self:
            del sys.modules[self.__name__]
        return importlib.import_module(self.__name__)


class _FunctionsLater(_Later):
    """Stands for a module of functions, also for who takes them from it at once, until one is called."""

    def __getattr__(self, name: str) -> object:
        if name.startswith("__"):
            raise AttributeError(name)

        def function(*arguments: object, **options: object) -> object:
            return getattr(self._module(), name)(*arguments, **options)

        return function


class _PlatformLater(_Later):
    """Stands for `platform`, of which `uuid` wants to know but the system while it is imported."""

    def system(self) -> str:
        """The system's name, such as Linux."""
        return os.uname().sysname


def import_msgspec() -> None:
    """Import msgspec without typing_extensions, and without what nodes do not use until that is used.

    Where another package has brought typing_extensions, msgspec takes two names from it that Python's
    own typing has as well. It would cost each node 1 MB and some milliseconds. `msgspec.inspect` and what makes JSON
    Schemas would cost 0.4 MB, and `platform`, which its UUIDs bring along, 0.1 MB.
    """
    if "msgspec" not in sys.modules:
        for name in ("msgspec.inspect", "msgspec.toml", "msgspec.yaml"):
            sys.modules[name] = _Later(name)
        sys.modules["msgspec._json_schema"] = _FunctionsLater("msgspec._json_schema")
        if hasattr(os, "uname"):
            sys.modules.setdefault("platform", _PlatformLater("platform"))
    with _without_compiler():
        _import("msgspec", without="typing_extensions")


@contextmanager
def _without_compiler() -> Iterator[None]:
    """While msgspec is imported it tries what arguments a `ForwardRef` takes, which has Python's compiler set up.

    That takes 0.2 MB, and nobody needs it whose messages are no texts (`from __future__ import annotations`).
    """
    real = typing.ForwardRef
    typing.ForwardRef = _TakesAll  # type: ignore[misc, assignment]
    try:
        yield
    finally:
        typing.ForwardRef = real  # type: ignore[misc]


class _TakesAll:
    """In the place of `ForwardRef`."""

    def __init__(self, *_arguments: object, **_options: object) -> None:
        """Every Python that robo runs on takes `is_class`."""


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
