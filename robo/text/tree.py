"""Plain data that remembers where everything stands."""

import re
from collections.abc import Iterator
from typing import NamedTuple, TypeVar

import msgspec

from robo.text.brief import brief, shown
from robo.text.readable import readable

T = TypeVar("T")


class Position(NamedTuple):
    """A place in a file; lines and columns count from 1, and 0 stands for no place within it."""

    file: str
    line: int
    column: int

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}" if self.line else self.file


class Problem(NamedTuple):
    """One mistake and where it is."""

    position: Position
    text: str

    @property
    def message(self) -> str:
        """The text, cut where a file has put something very long into it."""
        return brief(self.text)

    def __str__(self) -> str:
        return f"{self.position}: {self.message}"


class Scalar(msgspec.Struct, frozen=True):
    """A single value."""

    value: object
    """None, bool, int, float or str."""
    position: Position
    inset: int | None = 0
    """Columns from `position` to its text: 1 in quotes; None where it runs over several lines."""

    def place(self, offset: int) -> Position:
        """Where the character at an offset of the text stands."""
        if self.inset is None:
            return self.position
        return self.position._replace(column=self.position.column + self.inset + offset)


class Items(msgspec.Struct, frozen=True):
    """A list."""

    items: "tuple[Tree, ...]"
    position: Position


class Entry(NamedTuple):
    """One key of a map, with its value."""

    key: str
    position: Position
    value: "Tree"


class Map(msgspec.Struct, frozen=True):
    """A map with text keys, in the file's order, each key once unless `parse` was told to keep all."""

    entries: tuple[Entry, ...]
    position: Position

    def __iter__(self) -> Iterator[Entry]:
        return iter(self.entries)

    def get(self, key: str) -> "Tree | None":
        """The value of a key; the first one, where it stands twice."""
        return next((entry.value for entry in self.entries if entry.key == key), None)


Tree = Scalar | Items | Map


def plain(tree: Tree) -> object:
    """The tree as plain data, without positions."""
    if isinstance(tree, Scalar):
        return tree.value
    if isinstance(tree, Items):
        return [plain(item) for item in tree.items]
    return {entry.key: plain(entry.value) for entry in tree.entries}


def convert(tree: Tree, type_: type[T], problems: list[Problem]) -> T | None:
    """The tree as a value of a type that msgspec understands.

    Returns:
        The value; None, with the first mistake added to `problems`, where it does not fit.
    """
    try:
        return msgspec.convert(plain(tree), readable(type_))
    except msgspec.ValidationError as error:
        text, _, path = str(error).partition(" - at `$")
        where = locate(tree, path.rstrip("`"))
        problems.append(Problem(where, f"{path.rstrip('`').lstrip('.') or 'value'}: {text.replace('`', '').lower()}"))
        return None


def locate(tree: Tree, path: str) -> Position:
    """Where the value stands that a path like `.boxes[0].size` leads to, or its nearest parent."""
    for step in re.findall(r"\w+|\[\d+\]", path):
        if step.startswith("[") and isinstance(tree, Items):
            tree = tree.items[int(step[1:-1])]
        elif isinstance(tree, Map) and (child := tree.get(step)) is not None:
            tree = child
        else:
            break
    return tree.position


def kind(tree: Tree) -> str:
    """What a tree is, in a word for a message."""
    if isinstance(tree, Map):
        return "a map"
    if isinstance(tree, Items):
        return "a list"
    return "nothing" if tree.value is None else shown(tree.value)
