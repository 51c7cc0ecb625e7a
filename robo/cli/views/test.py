"""`robo test`: running the tests of packages, and printing what came of them."""

import os
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from robo.cli.printing import amount, paint, print_json, print_line, write_file
from robo.errors import UsageError
from robo.packages import tests
from robo.packages.tests import Result
from robo.text import colours


def run_tests(words: Sequence[str], *, junit: Path | None, json: bool) -> int:
    """Run the tests of the packages that words mean, and print a summary.

    Args:
        words: a folder, if the first one is no option; then what pytest gets.
        junit: where to write a report.
        json: print the summary as JSON; what pytest prints goes to stderr.

    Returns:
        1 where a test failed, or could not be run.

    Raises:
        UsageError: there is no such folder, no package in it, or no pytest.
    """
    named = bool(words) and not words[0].startswith("-")
    found = tests.find(Path(words[0] if named else "."))
    if find_spec("pytest") is None:
        raise UsageError("pytest is not installed here: pip install pytest")
    if junit is not None:
        write_file("", junit)  # a place that cannot be written to is told before the tests have run
    results, reports = [], []
    for package in found:
        if len(found) > 1 and not json:
            print_line(paint(f"{package.name}: {package.folder}", colours.BOLD))
        result, report = tests.run(package, words[1:] if named else words, beside_data=json)
        results.append(result)
        reports.append(report)
    if junit is not None:
        tests.write_junit(reports, junit)
    if json:
        print_json({"packages": results, "fine": all(one.is_fine for one in results)})
    else:
        _print(results)
    return 0 if all(one.is_fine for one in results) else 1


def _print(results: Sequence[Result]) -> None:
    print_line("")
    for one in results:
        mark = paint("ok", colours.GREEN) if one.is_fine else paint("!!", colours.RED)
        print_line(f"{mark}  {one.package}: {_counts([one])}, in {one.seconds:.1f} s{_trouble(one)}")
        for failure in one.failed:
            file = os.path.relpath(os.path.join(one.folder, failure.file))
            print_line(f"    {file}:{failure.line} {failure.test}: {failure.message}")
    if len(results) > 1:
        print_line(f"{amount(len(results), 'package')}: {_counts(results)}")


def _counts(results: Sequence[Result]) -> str:
    def total(what: str) -> int:
        return sum(getattr(one, what) for one in results)

    counts = [amount(total("tests"), "test"), amount(total("errors"), "error"), amount(total("failures"), "failure")]
    return ", ".join([*counts, f"{total('skipped')} skipped"])


def _trouble(result: Result) -> str:
    """What pytest said by its exit code beside which tests failed."""
    if result.is_fine or result.failed:
        return ""
    return f"; pytest ended with exit code {result.exit_code}"
