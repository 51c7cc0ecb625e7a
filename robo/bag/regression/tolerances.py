"""What may differ between two recordings, and by how much: from a YAML file, or from words. Pure, but for the reading.

time: 0.005
topics:
  r1/odom:
    fields:
      pose.pose.position: 0.001
      twist: {relative: 1.0e-6}
  "**":
    fields:
      header.stamp: ignore
"""

import math
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import msgspec

from robo.errors import UnreadableFile, UsageError
from robo.text.brief import shown
from robo.text.files import read_text
from robo.text.patterns import matcher
from robo.text.suggestions import suggest
from robo.text.tree import Map, Problem, Scalar, Tree, kind
from robo.text.yaml_tree import parse

IGNORE = "ignore"

_A_NUMBER = "a number of at least 0"


class Tolerance(msgspec.Struct, frozen=True):
    """How far numbers of a field may be apart: by the larger of the two."""

    absolute: float = 0.0
    """In the field's unit; of a time, s."""
    relative: float = 0.0
    """Of the larger of both numbers."""
    ignored: bool = False
    """Whether the field counts at all."""

    def allows(self, a: float, b: float) -> bool:
        """Whether two numbers are near enough."""
        if not (math.isfinite(a) and math.isfinite(b)):
            return False
        most = max(self.absolute, self.relative * max(abs(a), abs(b)))
        return most > 0.0 and abs(a - b) <= most


EXACT = Tolerance()


class Rule(msgspec.Struct, frozen=True):
    """What is said of some fields of some topics."""

    topics: str
    """A pattern as `bag.patterns` has them."""
    fields: str
    tolerance: Tolerance


class TimeRule(msgspec.Struct, frozen=True):
    """What is said of the times of some topics."""

    topics: str
    seconds: float


class Tolerances:
    """What may differ. Of several rules that fit the last one holds."""

    def __init__(self, rules: Sequence[Rule] = (), times: Sequence[TimeRule] = ()) -> None:
        self._said = rules
        self._rules = [(_topics(rule.topics), _fields(rule.fields), rule.tolerance) for rule in rules]
        self._times = [(_topics(rule.topics), rule.seconds) for rule in times]
        self.patterns = list(dict.fromkeys([rule.topics for rule in rules] + [rule.topics for rule in times]))
        """Of topics, as they were written."""
        self._found: dict[tuple[str, str], Tolerance] = {}

    def of(self, topic: str, field: str) -> Tolerance:
        """What holds of a field."""
        found = self._found.get((topic, field))
        if found is None:
            fitting = [tolerance for topics, fields, tolerance in self._rules if topics(topic) and fields(field)]
            found = self._found[topic, field] = fitting[-1] if fitting else EXACT
        return found

    def time_of(self, topic: str) -> float | None:
        """By how much a message may come earlier or later, s; None where nothing is said."""
        fitting = [seconds for topics, seconds in self._times if topics(topic)]
        return fitting[-1] if fitting else None

    def only_ignored(self) -> "Tolerances":
        """The same, but what counts is compared bit for bit, at its exact time."""
        exact = [msgspec.structs.replace(rule, tolerance=EXACT) for rule in self._said]
        return Tolerances([rule if rule.tolerance.ignored else exact[n] for n, rule in enumerate(self._said)])

    def idle(self, topics: Sequence[str]) -> list[str]:
        """The patterns of topics that fit none of these."""
        return [pattern for pattern in self.patterns if not any(map(_topics(pattern), topics))]


def load(path: str | Path | None, ignored: Sequence[str] = ()) -> Tolerances:
    """The tolerances of a file, and fields that do not count beside them.

    Args:
        path: of the file; None for none.
        ignored: `header.stamp`, or `r1/odom:header.stamp`.

    Raises:
        UsageError: it cannot be read, or has mistakes; tells all of them, each with its place.
    """
    rules: list[Rule] = []
    times: list[TimeRule] = []
    if path is not None:
        try:
            text = read_text(Path(path))
        except UnreadableFile as error:
            raise UsageError(f"{path}: {error}") from None
        rules, times = read_tolerances(text, str(path))
    for word in ignored:
        topic, colon, field = word.rpartition(":")
        if not field or (colon and not topic):
            raise UsageError(f"--ignore {shown(word)}: write FIELD or TOPIC:FIELD, for example header.stamp")
        try:
            matcher([topic or "**"])
        except UsageError as error:
            raise UsageError(f"--ignore {shown(word)}: {error}") from None
        rules.append(Rule(topic or "**", field, Tolerance(ignored=True)))
    return Tolerances(rules, times)


def read_tolerances(text: str, file: str) -> tuple[list[Rule], list[TimeRule]]:
    """The rules of a file.

    Raises:
        UsageError: it has mistakes; tells all of them, each with its place.
    """
    problems: list[Problem] = []
    tree = parse(text, file, problems)
    reader = _Reader(problems)
    if tree is not None:
        reader.read(tree)
    if problems:
        raise UsageError("\n".join(map(str, problems)))
    return reader.rules, reader.times


class _Reader:
    def __init__(self, problems: list[Problem]) -> None:
        self.rules: list[Rule] = []
        self.times: list[TimeRule] = []
        self._problems = problems

    def read(self, tree: Tree) -> None:
        for key, value in self._map(tree, "time", "topics"):
            if key == "time":
                self._time("**", value)
            else:
                for entry in self._entries(value):
                    try:
                        matcher([entry.key])
                    except UsageError as error:
                        self._problems.append(Problem(entry.position, str(error)))
                    else:
                        self._topic(entry.key.removeprefix("/"), entry.value)

    def _topic(self, topic: str, tree: Tree) -> None:
        for key, value in self._map(tree, "time", "fields"):
            if key == "time":
                self._time(topic, value)
            else:
                for entry in self._entries(value):
                    tolerance = self._tolerance(entry.value)
                    if tolerance is not None:
                        self.rules.append(Rule(topic, entry.key, tolerance))

    def _tolerance(self, tree: Tree) -> Tolerance | None:
        if isinstance(tree, Scalar) and tree.value == IGNORE:
            return Tolerance(ignored=True)
        if isinstance(tree, Map):
            said = {key: self._number(value) for key, value in self._map(tree, "absolute", "relative")}
            return Tolerance(said.get("absolute") or 0.0, said.get("relative") or 0.0)
        number = self._number(tree, f"{_A_NUMBER}, {{absolute: …, relative: …}} or {IGNORE}")
        return Tolerance(number) if number is not None else None

    def _time(self, topic: str, tree: Tree) -> None:
        seconds = self._number(tree)
        if seconds is not None:
            self.times.append(TimeRule(topic, seconds))

    def _number(self, tree: Tree, wanted: str = _A_NUMBER) -> float | None:
        value: Any = tree.value if isinstance(tree, Scalar) else None
        if isinstance(value, (int, float)) and not isinstance(value, bool) and 0 <= value < math.inf:
            return float(value)
        self._complain(tree, f"expected {wanted}, not {kind(tree)}")
        return None

    def _map(self, tree: Tree, *known: str) -> list[tuple[str, Tree]]:
        found = []
        for entry in self._entries(tree):
            if entry.key in known:
                found.append((entry.key, entry.value))
            else:
                told = f"there is no key {shown(entry.key)} here; {suggest(entry.key, known)}"
                self._problems.append(Problem(entry.position, told))
        return found

    def _entries(self, tree: Tree) -> Sequence[Any]:
        if isinstance(tree, Map):
            return tree.entries
        self._complain(tree, f"expected a map, not {kind(tree)}")
        return ()

    def _complain(self, tree: Tree, text: str) -> None:
        self._problems.append(Problem(tree.position, text))


def _topics(pattern: str) -> Callable[[str], bool]:
    return matcher([pattern])


def _fields(pattern: str) -> Any:
    """Whether a field, or what it is in, fits: `*` stands for what is between two dots, `**` for anything."""
    words = {"**.": r"(?:.*\.)?", "**": ".*", "*": r"[^\.]*"}
    parts = (words.get(part, re.escape(part)) for part in re.split(r"(\*\*\.|\*\*|\*)", pattern))
    return re.compile("".join(parts) + r"(\..*)?").fullmatch
