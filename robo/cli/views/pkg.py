"""`robo pkg`: printing packages, and what they have."""

import msgspec

from robo.cli.launch.modules import check_nothing_hides_robo
from robo.cli.printing import note, paint, print_json, print_line, print_lines, print_table
from robo.errors import UsageError
from robo.launch.executables import look_into
from robo.launch.find import manifests_of
from robo.packages import find as packages
from robo.packages.find import Package
from robo.text import colours
from robo.text.columns import aligned


def print_list(*, json: bool) -> None:
    """Print the packages that are announced."""
    there, broken = packages.known()
    if json:
        for package in there.values():
            print_json(_data(package))
    else:
        rows = [(one.name, one.version or "-", _source(one), one.description) for one in there.values()]
        print_table([("PACKAGE", "VERSION", "FROM", "DESCRIPTION"), *rows], spared=("DESCRIPTION",))
    for problem in broken.values():
        note(f"left out: {problem}")


def print_executables(name: str | None, *, full_path: bool, json: bool) -> int:
    """Print the nodes of a package, or of all that are announced.

    Returns:
        The exit code.

    Raises:
        UsageError: there is no such package.
    """
    check_nothing_hides_robo()
    if name is None:
        there, broken = packages.known()
        wanted, problems = list(there.values()), list(broken.values())
    else:
        wanted, problems = [_find(name)], []
    found = look_into(wanted)
    for one in found.executables:
        if json:
            print_json(one)
        elif full_path:
            print_line(one.file)
        else:
            print_line(f"{one.package} {one.node}")
    for problem in (*problems, *found.broken):
        note(f"left out: {problem}")
    return 1 if name is not None and found.broken else 0


def print_prefix(name: str, *, share: bool) -> None:
    """Print the folder of a package, or its share folder.

    Raises:
        UsageError: there is no such package, or it has no such folder.
    """
    package = _find(name)
    if not share:
        print_lines(map(str, package.folders))
    elif package.share is None:
        raise UsageError(f"package {name} has no folder {package.folders[0] / 'share'}")
    else:
        print_line(str(package.share))


def print_package(name: str, *, json: bool) -> int:
    """Print all about a package.

    Returns:
        The exit code.

    Raises:
        UsageError: there is no such package.
    """
    check_nothing_hides_robo()
    package = _find(name)
    manifests = manifests_of(package)
    contents = look_into([package])
    if json:
        lists = {
            "manifests": [str(path) for path in manifests],
            "executables": contents.executables,
            "messages": contents.messages,
            "broken": contents.broken,
        }
        print_json(_data(package) | lists)
        return 1 if contents.broken else 0
    print_line(paint(package.name, colours.BOLD) + (f": {package.description}" if package.description else ""))
    print_lines(aligned([(f"  {what}", text) for what, text in _facts(package)]))
    _print_section("manifests", [(f"{name}:{path.name}", str(path)) for path in manifests])
    _print_section("nodes", [(one.node or "-", one.description) for one in contents.executables])
    _print_section("messages", [(one, "") for one in contents.messages])
    for problem in contents.broken:
        note(f"left out: {problem}")
    return 1 if contents.broken else 0


def _facts(package: Package) -> list[tuple[str, str]]:
    facts = [("from", _source(package))]
    if package.distribution:
        facts.append(("distribution", f"{package.distribution} {package.version}"))
    elif package.version:
        facts.append(("version", package.version))
    facts.append(("module", package.module))
    facts += [("folder", str(folder)) for folder in package.folders]
    facts.append(("share", str(package.share) if package.share is not None else "none"))
    return facts


def _print_section(title: str, rows: list[tuple[str, str]]) -> None:
    if rows:
        print_line(f"  {title}")
        print_lines(line.rstrip() for line in aligned([(f"    {left}", right) for left, right in rows]))


_SOURCES = {
    "installed": "installed",
    "editable": "installed, editable",
    "folder": "this folder, not installed",
    "path": "Python's path, announced by nobody",
}


def _source(package: Package) -> str:
    """Where a package is from, and what it hides."""
    return _SOURCES[package.source] + (f"; hides {package.hides}" if package.hides else "")


def _data(package: Package) -> dict[str, object]:
    data: dict[str, object] = msgspec.structs.asdict(package)
    share = str(package.share) if package.share is not None else None
    return data | {"folders": [str(folder) for folder in package.folders], "share": share}


def _find(name: str) -> Package:
    try:
        return packages.find(name)
    except LookupError as error:
        raise UsageError(str(error)) from None
