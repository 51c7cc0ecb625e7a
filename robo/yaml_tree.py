"""YAML as a tree that remembers where everything stands, and mistakes that point there.

Only plain data is read: no tags, no objects. Scalars follow YAML 1.2, so `no` and `1:30` stay text.
"""

import math
import re
from collections.abc import Iterator
from typing import NamedTuple, TypeVar

import msgspec
import yaml

_INT = re.compile(r"[-+]?[0-9]+\Z")
_BASED_INT = re.compile(r"0x[0-9a-fA-F]+\Z|0o[0-7]+\Z")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?\Z")
_SPECIAL = {
    "": None, "~": None, "null": None, "Null": None, "NULL": None,
    "true": True, "True": True, "TRUE": True, "false": False, "False": False, "FALSE": False,
    ".nan": math.nan, ".NaN": math.nan, ".NAN": math.nan,
    ".inf": math.inf, ".Inf": math.inf, ".INF": math.inf, "+.inf": math.inf, "-.inf": -math.inf,
}  # fmt: skip

_OPEN, _CLOSE = "\ue000", "\ue001"
_PLACEHOLDER = re.compile(r"\$\{([^{}\n]*)\}")

T = TypeVar("T")

MAX_NODES = 200_000
"""A file that unfolds to more than this (aliases of aliases) is refused."""


class Position(NamedTuple):
    """A place in a file; lines and columns count from 1."""

    file: str
    line: int
    column: int

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}"


class Problem(NamedTuple):
    """One mistake and where it is."""

    position: Position
    text: str

    def __str__(self) -> str:
        return f"{self.position}: {self.text}"


class Scalar(msgspec.Struct, frozen=True):
    """A single value."""

    value: object
    """None, bool, int, float or str."""
    position: Position


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
    """A map with text keys, in the file's order, each key once."""

    entries: tuple[Entry, ...]
    position: Position

    def __iter__(self) -> Iterator[Entry]:
        return iter(self.entries)

    def get(self, key: str) -> "Tree | None":
        """The value of a key."""
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
        return msgspec.convert(plain(tree), type_)
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
    return "nothing" if tree.value is None else repr(tree.value)


def parse(text: str, file: object, problems: list[Problem], *, placeholders: bool = False) -> Tree | None:
    """Read one YAML document. Mistakes are added to `problems`.

    With `placeholders`, `${name}` is one word everywhere. In YAML itself it is none within `[…]` and
    `{…}`, where a brace ends the word.

    Returns:
        The tree; None where the text is no YAML at all. An empty document is an empty map.
    """
    name = str(file)
    if placeholders:
        # Characters that mean nothing to YAML stand in for the braces: positions stay what they are.
        text = _PLACEHOLDER.sub(f"${_OPEN}\\1{_CLOSE}", text)
    try:
        root = yaml.compose(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = Position(name, mark.line + 1, mark.column + 1) if mark else Position(name, 1, 1)
        problems.append(Problem(where, f"not valid YAML: {error.problem or error}"))
        return None
    except yaml.YAMLError as error:
        problems.append(Problem(Position(name, 1, 1), f"not valid YAML: {error}"))
        return None
    except RecursionError:
        problems.append(Problem(Position(name, 1, 1), "nested too deeply"))
        return None
    if root is None:
        return Map((), Position(name, 1, 1))
    try:
        return _Builder(name, problems).build(root)
    except RecursionError:
        problems.append(Problem(Position(name, 1, 1), "nested too deeply"))
    except _TooLarge:
        problems.append(Problem(Position(name, 1, 1), f"unfolds to more than {MAX_NODES:,} values; check its aliases"))
    return None


class _TooLarge(Exception):
    pass


class _Builder:
    def __init__(self, file: str, problems: list[Problem]) -> None:
        self._file = file
        self._problems = problems
        self._count = 0

    def build(self, node: yaml.Node) -> Tree:
        self._count += 1
        if self._count > MAX_NODES:
            raise _TooLarge
        position = self._position(node)
        if isinstance(node, yaml.ScalarNode):
            return Scalar(_restore(node.value) if node.style else _resolve(_restore(node.value)), position)
        if isinstance(node, yaml.SequenceNode):
            return Items(tuple(self.build(item) for item in node.value), position)
        assert isinstance(node, yaml.MappingNode)
        entries: dict[str, Entry] = {}
        for key_node, value_node in node.value:
            where = self._position(key_node)
            if not isinstance(key_node, yaml.ScalarNode):
                self._problems.append(Problem(where, "a key must be a word, not a list or map"))
                continue
            key = _restore(key_node.value)
            value = self.build(value_node)
            if key in entries:
                first = entries[key].position.line
                self._problems.append(Problem(where, f"{key!r} stands twice; it is already in line {first}"))
                continue
            entries[key] = Entry(key, where, value)
        return Map(tuple(entries.values()), position)

    def _position(self, node: yaml.Node) -> Position:
        return Position(self._file, node.start_mark.line + 1, node.start_mark.column + 1)


def _restore(text: str) -> str:
    return text.replace(_OPEN, "{").replace(_CLOSE, "}") if _OPEN in text else text


def _resolve(text: str) -> object:
    if text in _SPECIAL:
        return _SPECIAL[text]
    if _INT.match(text):
        return int(text) if len(text) < 400 else text
    if _BASED_INT.match(text):
        return int(text, 0)
    if _FLOAT.match(text):
        return float(text)
    return text
