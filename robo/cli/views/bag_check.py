"""`robo bag check`: what is wrong with a recording."""

import msgspec

from robo import bag
from robo.bag.look.inspection import Kind, Report
from robo.cli.printing import amount, hint, paint, print_json, print_line, print_table
from robo.cli.views.bag_progress import progress
from robo.text import colours
from robo.text.brief import brief
from robo.text.dates import date


def print_check(path: str, *, strict: bool, json: bool) -> int:
    """Print what is wrong with a recording.

    Returns:
        1 where the recording itself is damaged; with `strict` where anything was found.

    Raises:
        BagError: it cannot be read, or is no recording.
    """
    with progress(f"checking {path}") as tell:
        report = bag.check(path, tell=tell)
    if json:
        print_json({**msgspec.to_builtins(report), "whole": report.whole})
    else:
        _print(report)
    return 1 if not report.whole or (strict and report.findings) else 0


def _print(report: Report) -> None:
    looked = f"{report.path}: {amount(report.messages, 'message')}"
    if not report.findings:
        print_line(f"{looked}, nothing is wrong")
        return
    state = "the recording is whole" if report.whole else paint("the recording is damaged", colours.RED)
    print_line(f"{looked}; {state}")
    print_line("")
    rows = [("KIND", "TOPIC", "COUNT", "WHEN", "WHAT")]
    for found in report.findings:
        kind = found.kind.value
        rows.append((kind, found.topic or "-", f"{found.count:,}", _when(found.time), brief(found.text, 500)))
    print_table(rows)
    if any(found.kind in (Kind.CUT, Kind.DAMAGED, Kind.INDEX) for found in report.findings):
        hint(f"`robo bag recover {report.path} -o WHOLE` makes a whole file of what can be read")


def _when(nanoseconds: int | None) -> str:
    return "-" if nanoseconds is None else date(nanoseconds)
