"""The packages that are there: those that are installed, and those of the folder one works in."""

from pathlib import Path
from typing import Literal, NamedTuple

import msgspec

from robo.packages import announced
from robo.packages.announced import Announced
from robo.packages.folders import NAME, folders_of, is_module_name, share_of, spec_of
from robo.text.brief import shown
from robo.text.suggestions import hint
from robo.text.terminal import visible

Source = Literal["installed", "editable", "folder", "path"]


class Package(msgspec.Struct, frozen=True, kw_only=True):
    """A Python package, found without importing it."""

    name: str
    module: str
    folders: tuple[Path, ...]
    """More than one where several installations share its name."""
    share: Path | None
    """Holds `launch/` and `config/`; None where the package has no such folder."""
    source: Source
    """`folder`: it stands in the current folder and is not installed; `path`: Python finds it, nobody announces it."""
    distribution: str = ""
    """What is installed, as `pip list` shows it."""
    version: str = ""
    description: str = ""
    hides: str = ""
    """What is installed under the same name and is not used here."""


class Packages(NamedTuple):
    """What is announced, sorted by name."""

    there: dict[str, Package]
    broken: dict[str, str]
    """By name, a sentence that says what is wrong."""


def known() -> Packages:
    """The packages that are announced, and what is wrong with those that are not there. Imports none of them."""
    there: dict[str, Package] = {}
    broken: dict[str, str] = {}
    everybody: dict[str, Announced] = {}
    for one in announced.installed(announced.PACKAGES):
        first = everybody.setdefault(one.name, one)
        if first.value != one.value:
            broken[f"{one.name} of {one.by}"] = f"package {one.name} of {one.by}: that of {first.by} goes first"
    try:
        everybody = {one.name: one for one in announced.of_folder(Path.cwd())} | everybody
    except LookupError as error:
        broken[announced.PROJECT_FILE] = str(error)
    for name in sorted(everybody):
        try:
            there[name] = _package(everybody[name])
        except LookupError as error:
            broken[name] = str(error)
    return Packages(there, broken)


def find(name: str) -> Package:
    """A package that is announced, or one that Python finds by that name.

    Raises:
        LookupError: there is none, or it is broken; its text says so.
    """
    if NAME.fullmatch(name) is None:
        raise LookupError(f"{shown(name)} is not a valid name of a Python package; for example robo")
    there, broken = known()
    if name in there:
        return there[name]
    if name in broken:
        raise LookupError(broken[name])
    folders = folders_of(name)
    if not folders:
        raise LookupError(f"there is no package {shown(name)}{hint(name, [*there, *_importable()], _IS_IT)}")
    return Package(name=name, module=name, folders=folders, share=share_of(folders), source=_found_in(folders, name))


_IS_IT = "; is it installed here?"


def _package(one: Announced) -> Package:
    """The package that an entry point announces.

    Raises:
        LookupError: its name or its module makes no sense, or the module is not there.
    """
    what = f"package {visible(one.name)}, which {one.by} announces,"
    if NAME.fullmatch(one.name) is None:
        raise LookupError(f"{what} has no valid name: letters, digits and _, for example my_robot")
    if not is_module_name(one.value):
        raise LookupError(f'{what} names no module: {shown(one.value)}; write {one.name} = "{one.name}"')
    folders = folders_of(one.value)
    if not folders and spec_of(one.value) is not None:
        raise LookupError(f"{what} is a single module, {one.value}; make it a folder with an __init__.py")
    if not folders:
        raise LookupError(f"{what} is not there: there is no module {one.value}")
    package = Package(
        name=one.name,
        module=one.value,
        folders=folders,
        share=share_of(folders),
        source="editable" if one.editable else "installed",
        distribution=one.distribution,
        version=one.version,
        description=one.description,
    )
    if not one.distribution:
        return msgspec.structs.replace(package, source=_found_in(folders, one.value))
    if any(folder.resolve().is_relative_to(one.home.resolve()) for folder in folders):
        return package
    found_in = _found_in(folders, one.value)
    return msgspec.structs.replace(package, source=found_in, distribution="", version="", hides=one.by)


def _found_in(folders: tuple[Path, ...], module: str) -> Source:
    """Where a package is that is not installed. An environment below the current folder is not this folder."""
    return "folder" if Path.cwd().joinpath(*module.split(".")) in folders else "path"


def _importable() -> list[str]:
    import pkgutil  # only mistakes need it

    paths = [None, [str(Path.cwd())]]
    return [module.name for path in paths for module in pkgutil.iter_modules(path) if module.ispkg]
