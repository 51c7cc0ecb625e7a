"""Running the tests of packages, and what came of them: packages, tests, failures with their places."""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Literal, NamedTuple, get_args
from xml.etree import ElementTree

import msgspec

from robo.errors import UsageError

REPORTS = "robo-test-"
"""How the folders begin in which pytest's reports are until they are read; `own_report` knows them by it."""

_SKIPPED = {"build", "dist", "node_modules", "site-packages", "venv", "__pycache__"}
"""Folders in which no packages are looked for, beside hidden ones."""

_DEEPEST = 4
"""How far below a folder packages are looked for."""

NOTHING_COLLECTED = 5
"""The exit code of pytest where there are no tests."""

Kind = Literal["failure", "error"]
_KINDS: tuple[Kind, ...] = get_args(Kind)

_PLACE = re.compile(r"^(\S+?\.py):(\d+): ", re.MULTILINE)
"""Where a traceback of pytest's says that something was raised."""


class Package(NamedTuple):
    """A package whose tests can be run."""

    name: str
    folder: Path


class Failure(msgspec.Struct, frozen=True):
    """A test that did not pass."""

    test: str
    """As pytest names it: `test_it_closes[fast]`."""
    kind: Kind
    """Whether the test failed, or what surrounds it: a fixture, an import."""
    file: str
    """Relative to the package's folder."""
    line: int
    message: str
    """The first line of it."""


class Result(msgspec.Struct, frozen=True):
    """What came of the tests of one package."""

    package: str
    folder: str
    tests: int
    failures: int
    errors: int
    skipped: int
    seconds: float
    exit_code: int
    """pytest's: 0 fine, 1 tests failed, 5 there were none; others where it could not run them."""
    failed: list[Failure] = []

    @property
    def is_fine(self) -> bool:
        """Whether nothing went wrong."""
        return self.exit_code in (0, NOTHING_COLLECTED)


def find(folder: Path) -> list[Package]:
    """The packages in a folder: itself, or those below it, sorted by folder.

    A package is a folder with a `pyproject.toml`.

    Raises:
        UsageError: there is no such folder, or no package in it.
    """
    if not folder.is_dir():
        raise UsageError(f"there is no folder {folder}")
    found = [Package(_name(one), one) for one in _folders(folder.resolve(), _DEEPEST)]
    if not found:
        raise UsageError(
            f"no package in {folder}: a package is a folder with a pyproject.toml; `robo create NAME` makes one"
        )
    return found


def run(package: Package, arguments: Sequence[str], *, beside_data: bool = False) -> tuple[Result, ElementTree.Element]:
    """Run the tests of a package with pytest, which prints as it goes.

    Args:
        package: which one.
        arguments: further ones, for pytest.
        beside_data: what it prints goes to stderr.

    Returns:
        The result, and pytest's own report of it, as JUnit has it.

    Raises:
        UsageError: the arguments ask pytest for a report of its own.
    """
    if any(word.startswith(("--junit-xml", "--junitxml")) for word in arguments):
        raise UsageError("robo test writes the report: robo test --junit FILE, before --")
    with tempfile.TemporaryDirectory(prefix=REPORTS) as folder:
        report = Path(folder) / "report.xml"
        # The family that tells each test's file and line.
        options = ["-p", "robo.packages.own_report", f"--junit-xml={report}", "-o", "junit_family=xunit1", *arguments]
        command = [sys.executable, "-m", "pytest", *options]
        with subprocess.Popen(command, cwd=package.folder, stdout=sys.stderr if beside_data else None) as pytest:
            try:
                code = pytest.wait()
            except KeyboardInterrupt:  # which pytest has got as well
                pytest.wait()
                raise
        suites = list(_suites(report))
    for suite in suites:
        suite.set("name", package.name)
    root = ElementTree.Element("testsuites")
    root.extend(suites)
    return _result(package, code, suites), root


def write_junit(reports: Sequence[ElementTree.Element], file: Path) -> None:
    """Write the reports of several packages as one.

    Raises:
        UsageError: the file cannot be written.
    """
    root = ElementTree.Element("testsuites")
    for report in reports:
        root.extend(report)
    try:
        ElementTree.ElementTree(root).write(file, encoding="utf-8", xml_declaration=True)
    except OSError as error:
        raise UsageError(f"{file} cannot be written: {error.strerror}") from None


def _folders(folder: Path, deepest: int) -> Iterator[Path]:
    if (folder / "pyproject.toml").is_file():
        yield folder
    elif deepest:
        for one in sorted(folder.iterdir()):
            if one.is_dir() and not one.name.startswith(".") and one.name not in _SKIPPED:
                yield from _folders(one, deepest - 1)


def _name(folder: Path) -> str:
    """What a package calls itself; its folder's name where it does not say."""
    try:
        project = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8")).get("project", {})
    except (OSError, ValueError):
        return folder.name
    name = project.get("name") if isinstance(project, dict) else None
    return name if isinstance(name, str) else folder.name


def _suites(report: Path) -> Iterator[ElementTree.Element]:
    """The suites of a report; none where pytest ended before it wrote one."""
    try:
        yield from ElementTree.parse(report).getroot().iter("testsuite")
    except (OSError, ElementTree.ParseError):
        return


def _result(package: Package, code: int, suites: Sequence[ElementTree.Element]) -> Result:
    def total(what: str) -> int:
        return sum(int(suite.get(what, "0")) for suite in suites)

    cases = [case for suite in suites for case in suite.iter("testcase")]
    return Result(
        package=package.name,
        folder=str(package.folder),
        # A test that fails and whose fixture fails as well stands in the report twice.
        tests=len({(case.get("classname"), case.get("name")) for case in cases}),
        failures=total("failures"),
        errors=total("errors"),
        skipped=total("skipped"),
        seconds=sum(float(suite.get("time", "0")) for suite in suites),
        exit_code=code,
        failed=[failure for case in cases for failure in _failures(case)],
    )


def _failures(case: ElementTree.Element) -> Iterator[Failure]:
    for kind in _KINDS:
        for one in case.iter(kind):
            # Where the test itself went wrong; what it called may stand in another file.
            file, line = case.get("file", ""), int(case.get("line", "-1")) + 1
            own = [int(place[2]) for place in _PLACE.finditer(one.text or "") if place[1] == file]
            message = (one.get("message") or "").partition("\n")[0]
            yield Failure(case.get("name", ""), kind, file, (own or [line])[-1], message)
