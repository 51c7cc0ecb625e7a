"""Results as rows and columns. Pure."""

import csv
import io
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import msgspec

from robo.batch.plan import Result

_OWN = frozenset({"recording", "seed", "passed", "attempts"})
"""Columns of robo's own in the table for people, whose heads are in capitals; the others are called by users."""


class Column(NamedTuple):
    """A column of the table."""

    name: str
    of: Callable[[Result], object]
    """A row's value; None for none."""


def columns(results: Sequence[Result]) -> list[Column]:
    """All columns: what was run, with which values, what came of it.

    A metric that is called as another column is `metric.NAME`.
    """
    first = [Column("recording", lambda row: row.recording)]
    parameters = list(dict.fromkeys(name for row in results for name in row.parameters))
    first += [Column(name, _getter("parameters", name)) for name in parameters]
    if any(row.seed is not None for row in results):
        first.append(Column("seed", lambda row: row.seed))
    first.append(Column("passed", lambda row: row.passed))
    last = [
        Column("seconds", lambda row: row.seconds),
        Column("attempts", lambda row: row.attempts),
        Column("reason", lambda row: row.reason),
        Column("log", lambda row: row.log),
        Column("key", lambda row: row.key),
    ]
    taken = {column.name for column in (*first, *last)}
    metrics = list(dict.fromkeys(name for row in results for name in row.metrics))
    middle = [Column(f"metric.{one}" if one in taken else one, _getter("metrics", one)) for one in metrics]
    return [*first, *middle, *last]


def as_csv(results: Sequence[Result]) -> str:
    """The table as CSV (RFC 4180), with a head."""
    text = io.StringIO()
    writer = csv.writer(text)
    chosen = columns(results)
    writer.writerow([column.name for column in chosen])
    for row in results:
        writer.writerow([_word(column.of(row)) for column in chosen])
    return text.getvalue()


def shown(results: Sequence[Result]) -> list[list[str]]:
    """The table for people, with its head: without columns in which all rows are alike, or that hold no figure."""
    hidden = {"log", "key", "seconds", "reason"}
    if all(row.attempts == 1 for row in results):
        hidden.add("attempts")
    chosen = [one for one in columns(results) if one.name not in hidden and _tells(one, results)]
    rows = [[_brief(one.of(row), one.name) for one in chosen] for row in results]
    return [[one.name.upper() if one.name in _OWN else one.name for one in chosen], *rows]


def _tells(column: Column, results: Sequence[Result]) -> bool:
    """Whether a column is worth its place: a parameter that has one value in all rows is not."""
    if not results or column.name not in results[0].parameters:
        return any(column.of(row) not in (None, "") for row in results)
    return len({repr(column.of(row)) for row in results}) > 1


def _getter(field: str, name: str) -> Callable[[Result], object]:
    def get(row: Result) -> object:
        values: dict[str, Any] = getattr(row, field)
        return values.get(name)

    return get


def _word(value: object) -> object:
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(value).lower()
    return msgspec.json.encode(value).decode() if isinstance(value, (list, dict)) else value


def _brief(value: object, column: str) -> str:
    if column == "passed":
        return "passed" if value else "FAILED"
    if isinstance(value, float):
        return f"{value:.6g}"
    return str(_word(value))


def as_lines(results: Iterable[Result]) -> list[str]:
    """What has failed, with its reason and the file of its log, a line each."""
    return [
        f"failed: {row.label}: {next(iter(row.reason.splitlines()), '')} ({row.log})"
        for row in results
        if not row.passed
    ]
