"""Recordings of CSV, as `to_csv` has written it: of one file, or of those of a folder."""

import csv
from collections.abc import Iterator
from heapq import merge
from pathlib import Path
from typing import NamedTuple

from robo.bag.edit.output import new_file
from robo.bag.forms.columns import HEAD, columns_of, message_from
from robo.bag.forms.converted import LAST_TIME, Added, Converted, Wanted
from robo.bag.forms.lines import MOST_LINE, STANDARD, lines_of
from robo.bag.mcap.compression import Compression
from robo.bag.progress import Tell, silent
from robo.bag.types import topic_of
from robo.errors import BagError, ContractError, MessageError, RoboError
from robo.interfaces import catalogue, cdr
from robo.text.brief import brief, shown
from robo_messages import Message, UnknownType

_MOST_FILES = 500
"""That are read side by side."""


class _Row(NamedTuple):
    """A message from a file of CSV."""

    arrived: int
    published: int
    sequence: int
    topic: str
    type: type[Message]
    data: bytes


def from_csv(
    path: str | Path,
    output: str | Path,
    compression: Compression = "zstd",
    *,
    wanted: Wanted | None = None,
    force: bool = False,
    tell: Tell = silent,
) -> Converted:
    """Make a recording of CSV that `to_csv` has written: of a file, or of all of a folder.

    Each field of a message has to have its column, so that nothing is made up.

    Args:
        path: of the file or folder; `-` for standard input.
        output: of the recording.
        compression: of the recording.
        wanted: which topics; None for all.
        force: take the place of a file of this name.
        tell: is told how many bytes of a file are done.

    Raises:
        BagError: a file has other columns than its type, a type is not known, or a cell is none of its field: names
            file and line.
    """
    paths = _paths(path)
    with new_file(output, compression, force=force) as writer:
        added = Added(writer, str(path))
        numbers: dict[tuple[str, type[Message]], int] = {}
        streams = [_rows_of(one, tell) for one in paths]
        for row in merge(*streams, key=lambda row: row.arrived) if len(streams) > 1 else streams[0]:
            if wanted is None or wanted(row.topic):
                number = numbers.get((row.topic, row.type))
                if number is None:
                    number = numbers[row.topic, row.type] = added.topic(topic_of(row.topic, row.type))
                added.add(number, row.data, row.arrived, row.published, row.sequence)
        return added.done(str(output), [])


def _paths(path: str | Path) -> list[str | Path]:
    if str(path) == STANDARD or not Path(path).is_dir():
        return [path]
    try:
        found: list[str | Path] = sorted(one for one in Path(path).iterdir() if one.suffix.lower() == ".csv")
    except OSError as error:
        raise BagError(f"it cannot be read: {error.strerror}", str(path)) from None
    if not found:
        raise BagError("the folder has no file that ends in .csv", str(path))
    if len(found) > _MOST_FILES:
        raise BagError(f"the folder has {len(found):,} files, and {_MOST_FILES:,} at most are read", str(path))
    return found


def _rows_of(path: str | Path, tell: Tell) -> Iterator[_Row]:
    csv.field_size_limit(max(csv.field_size_limit(), MOST_LINE))  # of this process: a cell may hold a picture
    table = csv.reader(_decoded(path, tell), strict=True)
    file: _Table | None = None
    names: list[str] | None = None
    while True:
        try:
            row = next(table, None)
        except csv.Error as error:
            raise BagError(f"line {table.line_num:,}: {error}", str(path)) from None
        if row is None:
            return
        if names is None:
            names = _head(row, path)
        elif row:
            try:
                if file is None or file.says != row[2:4]:
                    file = _Table(row, names)
                yield file.row(row)
            except RoboError as error:
                raise BagError(f"line {table.line_num:,}: {brief(str(error))}", str(path)) from None


def _decoded(path: str | Path, tell: Tell) -> Iterator[str]:
    for number, line in enumerate(lines_of(path, tell), start=1):
        try:
            yield line.decode("utf-8-sig" if number == 1 else "utf-8")
        except UnicodeDecodeError:
            raise BagError(f"line {number:,} is no text in UTF-8", str(path)) from None


def _head(row: list[str], path: str | Path) -> list[str]:
    if tuple(row[: len(HEAD)]) != HEAD:
        wanted = ", ".join(HEAD)
        raise BagError(f"its first columns are not {wanted}, as `robo bag convert` writes them", str(path))
    return row[len(HEAD) :]


class _Table:
    """Reads the rows of one topic in a file."""

    def __init__(self, row: list[str], names: list[str]) -> None:
        """
        Raises:
            MessageError: the row's type is not known, or has other columns than the file.
        """
        self.says = row[2:4]
        if len(self.says) < 2:
            raise MessageError("the row has too few cells")
        key, name = self.says
        type_ = catalogue.find_here(name)
        if type_ is None:
            raise MessageError(f"robo has no type {shown(name)}, and CSV does not say what it is")
        try:
            topic_of(key, type_)
        except (ContractError, UnknownType) as error:
            raise MessageError(str(error)) from None
        self._topic, self._type, self._columns = key, type_, columns_of(type_)
        self._width = len(HEAD) + len(names)
        wanted = [column.name for column in self._columns]
        if wanted != names:
            self._order = _order(names, wanted, name)
        else:
            self._order = []
        self._encode = cdr.encoder(type_)

    def row(self, row: list[str]) -> _Row:
        """One more row.

        Raises:
            MessageError: a cell makes no sense.
        """
        if len(row) != self._width:
            raise MessageError(f"the row has {len(row):,} cells, and the file {self._width:,} columns")
        cells = row[len(HEAD) :]
        if self._order:
            cells = [cells[number] for number in self._order]
        message = message_from(self._type, self._columns, cells)
        published = _whole(row[0], "time")
        arrived = _whole(row[1], "arrived") if row[1] else published
        sequence = _whole(row[4], "sequence_number") if row[4] else 0
        return _Row(arrived, published, sequence, self._topic, self._type, self._encode(message))


def _order(names: list[str], wanted: list[str], type_name: str) -> list[int]:
    """Where each wanted column stands."""
    for name in wanted:
        if names.count(name) != 1:
            many = "no" if name not in names else "more than one"
            raise MessageError(f"a {type_name} has {name}, and there is {many} such column: nothing is made up")
    for name in names:
        if name not in wanted:
            raise MessageError(f"a {type_name} has no field {shown(name)}")
    return [names.index(name) for name in wanted]


def _whole(cell: str, name: str) -> int:
    if not (cell.isascii() and cell.isdecimal() and len(cell) < 20 and int(cell) <= LAST_TIME):
        raise MessageError(f"{name}: {shown(cell, 40)} is no whole number of 63 bits")
    return int(cell)
