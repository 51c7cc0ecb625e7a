"""What `robo test` loads into pytest: it hides the line that tells of a report which only `robo test` reads."""

from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest

from robo.packages.tests import REPORTS


@pytest.hookimpl(wrapper=True)
def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> Generator[None, object, object]:
    """Leave out the line that names the report."""
    report = config.getoption("xmlpath", None)
    if report is None or not Path(report).parent.name.startswith(REPORTS):
        return (yield)
    write_sep = terminalreporter.write_sep

    def write_others(sep: str, title: str | None = None, **rest: Any) -> None:
        if title is None or str(report) not in title:
            write_sep(sep, title, **rest)

    terminalreporter.write_sep = write_others
    try:
        return (yield)
    finally:
        del terminalreporter.write_sep
