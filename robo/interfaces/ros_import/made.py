"""From paths to Python: one module with all types, or a folder with a module for each package."""

from collections.abc import Iterable
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import NamedTuple

import msgspec

from robo.errors import InterfaceError
from robo.interfaces.catalogue import Kind
from robo.interfaces.ros_import.definition import Definition
from robo.interfaces.ros_import.files import find_sources
from robo.interfaces.ros_import.module import class_names, module_name, module_text, package_text
from robo.interfaces.ros_import.resolve import base_of, resolve
from robo.interfaces.ros_names import full_name, robo_name


class MadeType(msgspec.Struct, frozen=True):
    """A type that was made."""

    name: str
    """In robo."""
    kind: Kind
    ros_type: str
    """In ROS: `my_interfaces/srv/Grip`."""
    source: str
    """The file that defines it."""
    file: str
    """Of the folder; empty where there is one module."""
    class_name: str


class Made(NamedTuple):
    """What is to be written."""

    files: dict[str, str]
    """Texts by the name of the file; of one module the name is empty."""
    types: list[MadeType]
    shipped: list[str]
    """Types that robo has already, as it calls them."""
    differing: list[str]
    """A sentence for each of these whose file has other fields."""


def make(paths: Iterable[Path], package: str | None, *, as_folder: bool) -> Made:
    """Message types for all definitions below some paths.

    Args:
        paths: of files and folders.
        package: of files that are in none.
        as_folder: a module for each package of ROS, rather than one for all.

    Raises:
        InterfaceError: all that is wrong with them; with file, line and column where it stands in one.
    """
    resolved = resolve(find_sources(paths, package))
    definitions = resolved.definitions
    if as_folder:
        _check_circles(definitions)
    modules = _packages(definitions) if as_folder else {"": definitions} if definitions else {}
    files = {name: module_text(own, definitions if as_folder else ()) for name, own in modules.items()}
    types = [one for name, own in modules.items() for one in _types(name, own)]
    if files and as_folder:
        files |= {"__init__.py": package_text(sorted({one.package for one in definitions})), "py.typed": ""}
    return Made(files, types, resolved.shipped, resolved.differing)


def _check_circles(definitions: Iterable[Definition]) -> None:
    """Refuse packages of which each needs the other: their modules could not import each other."""
    needed: dict[str, set[str]] = {}
    for one in definitions:
        fields = (field for section in one.sections for field in section.fields)
        parts = {(base_of(field.type, one.package) or one.package).partition("/")[0] for field in fields}
        needed.setdefault(one.package, set()).update(parts - {one.package})
    try:
        TopologicalSorter(needed).prepare()
    except CycleError as error:
        circle = ", ".join(sorted(set(error.args[1])))
        raise InterfaceError(f"packages {circle} need each other; have one module for all: -o FILE.py") from None


def _packages(definitions: Iterable[Definition]) -> dict[str, list[Definition]]:
    """The definitions of each module, by the name of its file."""
    found: dict[str, list[Definition]] = {}
    for one in definitions:
        found.setdefault(f"{module_name(one.package)}.py", []).append(one)
    return dict(sorted(found.items()))


def _types(file: str, definitions: list[Definition]) -> list[MadeType]:
    classes = class_names(definitions)
    found = []
    for one in definitions:
        name = robo_name(one.ros_name)
        class_name = classes[one.ros_name, one.kind]
        found.append(MadeType(name, one.kind, full_name(name, one.kind), one.path, file, class_name))
    return found
