"""The nodes of Python packages. Their modules are imported in a process of its own, which reports on each.

What they import stays out of this process. One that crashes, ends the process or does not come to its end is named,
and the others are looked at all the same.
"""

import contextlib
import importlib
import inspect
import os
import re
import select
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec

from robo.errors import UnreadableFile
from robo.packages.find import Package
from robo.packages.modules import module_of, python_files
from robo.text.files import read_bytes

PATIENCE = 30.0
"""How long the import of one module may take, s."""

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


class _Report(msgspec.Struct):
    """What the process that imports says: `nodes` or `error` of each module in turn, `types` at the end."""

    nodes: list[tuple[str, str]] = msgspec.field(default_factory=list)
    """Class and description."""
    error: str = ""
    types: list[tuple[str, str]] | None = None
    """Name and module."""


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
    left = list(places)
    found = Contents([], [], [])
    while left:
        done = 0
        with _importing(left) as process:
            try:
                for report in _reports(process, patience):
                    if report.types is not None:
                        found.messages.extend(name for name, module in report.types if f"{module}.".startswith(roots))
                        return found
                    _note(report, places[left[done]], found)
                    done += 1
                why = f"it ends the process with {_ended(process.wait())}"
            except TimeoutError:
                why = f"it has not come to its end within {patience:g} s"
        found.broken.append(f"module {left[done]} cannot be imported: {why}")
        left = left[done + 1 :]
    return found


def _note(report: _Report, place: _Place, found: Contents) -> None:
    if report.error:
        found.broken.append(f"module {place.module} cannot be imported: {report.error}")
    inside = place.module.removeprefix(place.root).removeprefix(".")
    for class_name, description in report.nodes:
        several = f":{class_name}" if len(report.nodes) > 1 else ""
        service, node = f"{place.module}{several}", f"{inside}{several}"
        found.executables.append(Executable(place.package, node, service, class_name, description, str(place.file)))


def _places(package: Package) -> Iterator[_Place]:
    """The modules of a package that may define nodes."""
    for folder in package.folders:
        for file in python_files(folder):
            with contextlib.suppress(UnreadableFile):
                if _CLASS.search(read_bytes(file)):
                    yield _Place(package.name, package.module, module_of(file, folder, package.module), file)


@contextlib.contextmanager
def _importing(modules: Sequence[str]) -> Iterator["subprocess.Popen[bytes]"]:
    process = subprocess.Popen(
        [sys.executable, "-m", __name__, *modules],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    with process:
        try:
            yield process
        finally:
            process.kill()


def _reports(process: "subprocess.Popen[bytes]", patience: float) -> Iterator[_Report]:
    """What the process reports until it ends.

    Raises:
        TimeoutError: it says nothing for too long.
    """
    assert process.stdout is not None
    descriptor = process.stdout.fileno()
    rest = b""
    while True:
        if not select.select([descriptor], [], [], patience)[0]:
            raise TimeoutError
        data = os.read(descriptor, 65536)
        if not data:
            return
        *lines, rest = (rest + data).split(b"\n")
        for line in lines:
            yield msgspec.json.decode(line, type=_Report)


def _ended(code: int) -> str:
    return signal.Signals(-code).name if code < 0 else f"exit code {code}"


def main(modules: Sequence[str]) -> None:
    """Import modules and report what each of them defines, a line of JSON for each, to what is stdout."""
    import robo_messages

    out = os.dup(1)  # a child of a module does not inherit it
    os.dup2(2, 1)
    shipped = set(robo_messages.type_names())
    if (here := os.getcwd()) not in sys.path:
        sys.path.insert(0, here)
    for module in modules:
        _write(out, _report_on(module))
    new = [name for name in robo_messages.type_names() if name not in shipped]
    _write(out, _Report(types=[(name, robo_messages.find_type(name).__module__) for name in new]))
    os._exit(0)  # whatever threads a module has begun


def _report_on(name: str) -> _Report:
    from robo.node.loading import node_classes
    from robo.text.import_errors import explained

    try:
        module = importlib.import_module(name)
    except (Exception, SystemExit) as error:  # a user's module may raise anything while it is imported
        return _Report(error=explained(error))
    return _Report(nodes=[(name, _first_line(cls)) for name, cls in node_classes(module).items()])


def _first_line(cls: type) -> str:
    return inspect.cleandoc(cls.__doc__ or "").partition("\n")[0]


def _write(descriptor: int, report: _Report) -> None:
    os.write(descriptor, msgspec.json.encode(report) + b"\n")


if __name__ == "__main__":
    main(sys.argv[1:])
