"""The nodes of Python packages. Their modules are imported in a process of its own, which reports on each."""

import contextlib
import inspect
import re
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import ModuleType

import msgspec

from robo.errors import UnreadableFile
from robo.packages.find import Package
from robo.packages.imports import PATIENCE, import_apart, report
from robo.packages.modules import module_of, python_files
from robo.text.files import read_bytes

_CLASS = re.compile(rb"^[ \t]*class\s+\w+\s*(\[[^\]]*\]\s*)?\(", re.MULTILINE)
"""A class with a base: what has none has no node."""


class Executable(msgspec.Struct, frozen=True):
    """A node that a package has."""

    package: str
    node: str
    """As `robo run PACKAGE NODE` takes it."""
    service: str
    """As a manifest takes it: `package.module`, or `package.module:Class` where the module has several."""
    class_name: str
    description: str
    """The first line of what is said of the class."""
    file: str


class Contents(msgspec.Struct, frozen=True):
    """What was found in packages."""

    executables: list[Executable]
    broken: list[str]
    """A sentence for each module that cannot be imported."""
    messages: list[str]
    """The names of the types that their modules define."""


class _Seen(msgspec.Struct):
    """What a module has, and those that it imports."""

    nodes: list[tuple[str, str]]
    """Class and description."""
    types: list[tuple[str, str]]
    """Name of each message type of a user's that is known by then, and the module that defines it."""


class _Place(msgspec.Struct, frozen=True):
    package: str
    root: str
    """The package's module."""
    module: str
    file: Path


def look_into(packages: Sequence[Package], patience: float = PATIENCE) -> Contents:
    """Import the modules of packages that may define nodes, elsewhere, and tell what they define.

    Args:
        packages: where to look.
        patience: how long the import of one module may take, s.
    """
    places = {place.module: place for package in packages for place in _places(package)}
    roots = tuple(f"{package.module}." for package in packages)
    found = Contents([], [], [])
    types: set[str] = set()
    for one in import_apart([__name__], list(places), _Seen, patience):
        if one.found is None:
            found.broken.append(f"module {one.module} cannot be imported: {one.error}")
        else:
            _note(one.found.nodes, places[one.module], found)
            types.update(name for name, module in one.found.types if f"{module}.".startswith(roots))
    found.messages.extend(sorted(types))
    return found


def _note(nodes: Sequence[tuple[str, str]], place: _Place, found: Contents) -> None:
    inside = place.module.removeprefix(place.root).removeprefix(".")
    for class_name, description in nodes:
        several = f":{class_name}" if len(nodes) > 1 else ""
        service, node = f"{place.module}{several}", f"{inside}{several}"
        found.executables.append(Executable(place.package, node, service, class_name, description, str(place.file)))


def _places(package: Package) -> Iterator[_Place]:
    """The modules of a package that may define nodes."""
    for folder in package.folders:
        for file in python_files(folder):
            with contextlib.suppress(UnreadableFile):
                if _CLASS.search(read_bytes(file)):
                    yield _Place(package.name, package.module, module_of(file, folder, package.module), file)


def _seen(module: ModuleType, shipped: Sequence[str]) -> _Seen:
    import robo_messages
    from robo.node.loading import node_classes

    nodes = [(name, _first_line(cls)) for name, cls in node_classes(module).items()]
    new = [name for name in robo_messages.type_names() if name not in shipped]
    types = [(name, robo_messages.find_type(name).__module__) for name in new]
    return _Seen(nodes, [(name, owner) for name, owner in types if owner in sys.modules])


def _first_line(cls: type) -> str:
    return inspect.cleandoc(cls.__doc__ or "").partition("\n")[0]


if __name__ == "__main__":
    import robo_messages

    _SHIPPED = robo_messages.type_names()
    report(sys.argv[1:], lambda module: _seen(module, _SHIPPED))
