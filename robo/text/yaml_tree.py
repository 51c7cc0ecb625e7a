"""YAML as a tree that remembers where everything stands, and mistakes that point there.

Only plain data is read: no tags, no objects. Scalars follow YAML 1.2, so `no` and `1:30` stay text.
"""

import math
import re
from collections.abc import Iterator
from typing import Any

import yaml

from robo.text.brief import shown
from robo.text.terminal import visible
from robo.text.tree import Entry, Items, Map, Position, Problem, Scalar, Tree

_INT = re.compile(r"[-+]?[0-9]+\Z")
_BASED_INT = re.compile(r"0x[0-9a-fA-F]+\Z|0o[0-7]+\Z")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?\Z")
_SPECIAL = {
    "": None, "~": None, "null": None, "Null": None, "NULL": None,
    "true": True, "True": True, "TRUE": True, "false": False, "False": False, "FALSE": False,
    ".nan": math.nan, ".NaN": math.nan, ".NAN": math.nan,
    ".inf": math.inf, ".Inf": math.inf, ".INF": math.inf,
    "+.inf": math.inf, "+.Inf": math.inf, "+.INF": math.inf,
    "-.inf": -math.inf, "-.Inf": -math.inf, "-.INF": -math.inf,
}  # fmt: skip

_TAGS = (None, "!", "tag:yaml.org,2002:str", "tag:yaml.org,2002:seq", "tag:yaml.org,2002:map")

_OPEN, _CLOSE = "\ue000", "\ue001"
_PLACEHOLDER = re.compile(r"\$\{([^{}\n]*)\}")

_LINE_END = re.compile("\r\n|[\n\r\x85\u2028\u2029]")

LARGEST = 2**63 - 1
"""A larger whole number stays text: neither MessagePack nor JSON could carry it on."""

MAX_NODES = 200_000
"""A file that unfolds to more than this (aliases of aliases) is refused."""

MAX_LENGTH = 500_000
"""A file of more characters than this is refused: a mistake, and slow to read."""

MAX_DEPTH = 100
"""A file that nests lists and maps deeper than this is refused."""

_TOO_DEEP = f"nested more than {MAX_DEPTH} levels deep"
_READERS_DEPTH = "exceeded maximum nesting depth"
"""libyaml, from 0.2.6 on, of 1,000 levels: it reads ahead, and may see those before it tells of the hundredth."""


def lines_of(text: str) -> list[str]:
    r"""The lines of a text as positions count them: YAML has more line ends than `\n`."""
    return _LINE_END.split(text)


def as_yaml(value: object, **style: Any) -> str:
    """Plain data as YAML in their order, with control characters and those that turn a text's direction escaped.

    `style` is more for PyYAML.
    """
    for every in (True, False):
        text: str = yaml.safe_dump(value, sort_keys=False, width=120, allow_unicode=every, **style)
        if visible(text, keep="\n") == text:
            break
    return text


def repeated(tree: Tree) -> Iterator[Problem]:
    """The keys that stand twice in one map, anywhere in a tree."""
    if isinstance(tree, Items):
        for item in tree.items:
            yield from repeated(item)
    elif isinstance(tree, Map):
        first: dict[str, Position] = {}
        for entry in tree:
            if entry.key in first:
                yield _twice(entry.key, entry.position, first[entry.key])
            first.setdefault(entry.key, entry.position)
            yield from repeated(entry.value)


def _twice(key: str, position: Position, first: Position) -> Problem:
    return Problem(position, f"{shown(key)} stands twice; it is already in line {first.line}")


def parse(
    text: str, file: object, problems: list[Problem], *, placeholders: bool = False, keep_repeated: bool = False
) -> Tree | None:
    """Read one YAML document. Mistakes are added to `problems`.

    With `placeholders`, `${name}` is one word everywhere. In YAML itself it is not one within `[…]` and
    `{…}`, where a brace ends the word. With `keep_repeated`, a key that stands twice in a map is there
    twice; else it is a mistake.

    Returns:
        The tree; None where the text is no YAML at all. An empty document is an empty map.
    """
    name = str(file)
    if len(text) > MAX_LENGTH:
        problems.append(
            Problem(Position(name, 1, 1), f"longer than {MAX_LENGTH:,} characters; is this the right file?")
        )
        return None
    if placeholders:
        text = masked(text)
    builder = _Builder(name, problems, keep_repeated=keep_repeated)
    try:
        # Events, not PyYAML's own tree: that one descends without a limit and crashes on deep files.
        for event in yaml.parse(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader)):
            builder.take(event)
    except yaml.MarkedYAMLError as error:
        where = _place(text, name, error)
        if error.problem == _READERS_DEPTH:
            problems.append(Problem(where, _TOO_DEEP))
        else:
            problems.append(Problem(where, f"not valid YAML: {_why(text, where) or error.problem or error}"))
        return None
    except yaml.YAMLError as error:
        problems.append(Problem(Position(name, 1, 1), f"not valid YAML: {str(error).strip()}"))
        return None
    except _Unreadable as error:
        problems.append(Problem(error.position, str(error)))
        return None
    return builder.root or Map((), Position(name, 1, 1))


def masked(text: str) -> str:
    """A text in which each `${name}` is one word to YAML: other characters stand in for its braces, as many of them."""
    return _PLACEHOLDER.sub(f"${_OPEN}\\1{_CLOSE}", text)


def _place(text: str, name: str, error: yaml.MarkedYAMLError) -> Position:
    """Where a text is not valid YAML. PyYAML may name a line behind the last one."""
    mark = error.problem_mark or error.context_mark
    if error.problem == "could not find expected ':'":  # for the word at the other mark
        mark = error.context_mark or mark
    lines = lines_of(text)
    if mark is None:
        return Position(name, 1, 1)
    if mark.line >= len(lines):
        return Position(name, len(lines), len(lines[-1]) + 1)
    return Position(name, mark.line + 1, mark.column + 1)


def _why(text: str, where: Position) -> str | None:
    """What is at a place that YAML cannot read, where its own words do not say it."""
    line = "".join(lines_of(text)[where.line - 1 : where.line])
    return "a tab; indent with spaces" if line[where.column - 1 : where.column] == "\t" else None


class _Unreadable(Exception):
    def __init__(self, position: Position, text: str) -> None:
        super().__init__(text)
        self.position = position


class _Open:
    """A list or map whose end is still to come."""

    def __init__(self, position: Position, anchor: str | None, *, is_map: bool) -> None:
        self.position = position
        self.anchor = anchor
        self.is_map = is_map
        self.count = 1
        self.items: list[Tree] = []
        self.entries: list[Entry] = []
        self.first: dict[str, Position] = {}
        """Where each key stands first."""
        self.key: tuple[str | None, Position] | None = None
        """In a map, the key whose value comes next; None for its name where it is no word."""


class _Builder:
    def __init__(self, file: str, problems: list[Problem], *, keep_repeated: bool) -> None:
        self.root: Tree | None = None
        self._keep_repeated = keep_repeated
        self._file = file
        self._problems = problems
        self._stack: list[_Open] = []
        self._anchors: dict[str, tuple[Tree, int]] = {}
        self._text = ""
        """The last scalar as written: a key stays what it is, be it a number or `true`."""

    def take(self, event: yaml.Event) -> None:
        """The next event of the file."""
        tag = getattr(event, "tag", None)
        if tag not in _TAGS:
            text = f"tag {tag} is not read here; write plain values"
            raise _Unreadable(self._position(event), text)
        if isinstance(event, yaml.DocumentStartEvent) and self.root is not None:
            raise _Unreadable(self._position(event), "a second document begins here; one file holds one")
        if isinstance(event, yaml.ScalarEvent):
            text = self._text = _restore(event.value)
            is_plain = event.style in (None, "") and event.tag is None
            start: Any = event.start_mark
            end: Any = event.end_mark
            inset = None if end.line != start.line else 0 if is_plain else 1
            scalar = Scalar(resolve_scalar(text) if is_plain else text, self._position(event), inset)
            self._finish(scalar, 1, event.anchor)
        elif isinstance(event, (yaml.SequenceStartEvent, yaml.MappingStartEvent)):
            if len(self._stack) >= MAX_DEPTH:
                raise _Unreadable(self._position(event), _TOO_DEEP)
            is_map = isinstance(event, yaml.MappingStartEvent)
            self._stack.append(_Open(self._position(event), event.anchor, is_map=is_map))
        elif isinstance(event, (yaml.SequenceEndEvent, yaml.MappingEndEvent)):
            done = self._stack.pop()
            whole: Tree = (
                Map(tuple(done.entries), done.position) if done.is_map else Items(tuple(done.items), done.position)
            )
            self._finish(whole, done.count, done.anchor)
        elif isinstance(event, yaml.AliasEvent):
            if event.anchor not in self._anchors:
                raise _Unreadable(
                    self._position(event), f"alias *{event.anchor} names nothing that is complete before it"
                )
            tree, count = self._anchors[event.anchor]
            self._text = str(tree.value) if isinstance(tree, Scalar) else ""
            self._finish(tree, count, None)

    def _finish(self, tree: Tree, count: int, anchor: str | None) -> None:
        """Put a complete value where it belongs."""
        if anchor is not None:
            self._anchors[anchor] = (tree, count)
        if not self._stack:
            self.root = tree
            return
        parent = self._stack[-1]
        parent.count += count
        if parent.count > MAX_NODES:
            text = f"unfolds to more than {MAX_NODES:,} values; check its aliases"
            raise _Unreadable(Position(self._file, 1, 1), text)
        if not parent.is_map:
            parent.items.append(tree)
        elif parent.key is None:
            parent.key = self._key(tree)
        else:
            (name, where), parent.key = parent.key, None
            if name is None:
                return
            if name in parent.first and not self._keep_repeated:
                self._problems.append(_twice(name, where, parent.first[name]))
                return
            parent.first.setdefault(name, where)
            parent.entries.append(Entry(name, where, tree))

    def _key(self, tree: Tree) -> tuple[str | None, Position]:
        if not isinstance(tree, Scalar):
            self._problems.append(Problem(tree.position, "a key must be a word, not a list or map"))
            return None, tree.position
        return self._text, tree.position

    def _position(self, event: yaml.Event) -> Position:
        mark: Any = event.start_mark
        return Position(self._file, mark.line + 1, mark.column + 1)


def _restore(text: str) -> str:
    return text.replace(_OPEN, "{").replace(_CLOSE, "}") if _OPEN in text else text


def resolve_scalar(text: str) -> object:
    """What a plain word means in YAML 1.2: null, true, 3, 0.5, or itself."""
    if text in _SPECIAL:
        return _SPECIAL[text]
    if _INT.match(text) or _BASED_INT.match(text):
        number = int(text, 0 if _BASED_INT.match(text) else 10) if len(text) < 100 else LARGEST + 1
        return number if abs(number) <= LARGEST else text
    if _FLOAT.match(text):
        return float(text)
    return text
