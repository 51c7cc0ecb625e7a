"""From the text of a plan to the plan, with the place of each thing for what is found out later. Pure.

run: replay
recordings: bags/*.mcap
nodes: position_tracker
sweep:
  position_tracker.max_linear_velocity: [0.5, 1.0, 2.0]
"""

import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping
from typing import Any, Final, NamedTuple, TypeVar

from robo.batch.plan import KINDS, TAKES, Kind, Metric, Plan, Work
from robo.errors import UsageError
from robo.interfaces.parts import Field
from robo.text.brief import shown
from robo.text.choices import choice_of
from robo.text.suggestions import hint, suggest
from robo.text.tree import Entry, Items, Map, Position, Problem, Scalar, Tree, kind, plain
from robo.text.yaml_tree import parse

W = TypeVar("W", bound=str)

MOST_RUNS: Final = 1_000_000
"""Of a batch: more is a mistake."""

FUNCTION: Final = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*", re.ASCII)
"""How a function is named: `package.module:function`."""
_REPLAYS: Final[tuple[Kind, ...]] = ("replay", "replay-test")
_KINDS_OF: Final[dict[str, tuple[Kind, ...]]] = {
    "nodes": _REPLAYS, "manifest": _REPLAYS, "robot": _REPLAYS, "arguments": _REPLAYS, "patience": _REPLAYS,
    "keep": ("replay",), "metrics": ("replay",), "score": ("replay",),
    "tolerances": ("replay-test",), "ignore": ("replay-test",), "runs": ("replay-test",),
    "function": ("function",), "command": ("command",),
}  # fmt: skip
"""By key, the kinds of work that it says something of; the others are for all."""
_NEEDED: Final[dict[Kind, tuple[str, ...]]] = {
    "replay": ("nodes", "recordings"),
    "replay-test": ("nodes", "recordings"),
    "function": ("function",),
    "command": ("command",),
}
_FOR_ALL: Final = ("run", "recordings", "parameters", "sweep", "points", "seeds", "timeout", "attempts")


class Places(NamedTuple):
    """Where things are said."""

    of: Mapping[str, Position]
    """By key, and by `KEY.NAME` or `KEY.0` what stands within."""
    otherwise: Position

    def at(self, *path: object) -> Position:
        """Where something stands, or what it is in."""
        for length in range(len(path), 0, -1):
            found = self.of.get(".".join(map(str, path[:length])))
            if found is not None:
                return found
        return self.otherwise


def read(text: str, file: str, folder: str, problems: list[Problem]) -> tuple[Plan, Places] | None:
    """The plan of a text; mistakes are added to `problems`.

    Args:
        text: YAML.
        file: its name, for mistakes.
        folder: where the runs take place.
        problems: gets what is wrong.

    Returns:
        None where there is a mistake.
    """
    before = len(problems)
    tree = parse(text, file, problems)
    if tree is None:
        return None
    reader = _Reader(problems, folder)
    plan = reader.plan(tree)
    if plan is None or len(problems) > before:
        return None
    return plan, Places(reader.places, tree.position)


class _Reader:
    def __init__(self, problems: list[Problem], folder: str) -> None:
        self.places: dict[str, Position] = {}
        self._problems = problems
        self._folder = folder

    def plan(self, tree: Tree) -> Plan | None:
        if not isinstance(tree, Map):
            self._complain(tree.position, f"a plan is a map, not {kind(tree)}")
            return None
        said = {entry.key: entry for entry in tree}
        for entry in tree:
            self.places[entry.key] = entry.position
            if entry.key not in _FOR_ALL and entry.key not in _KINDS_OF:
                known = [*_FOR_ALL, *_KINDS_OF]
                self._complain(entry.position, f"there is no key {shown(entry.key)} here; {suggest(entry.key, known)}")
        if "run" not in said:
            self._complain(tree.position, f"say what is run: `run:` is one of {', '.join(KINDS)}")
            return None
        what = self._word(said["run"].value, "run", KINDS)
        if what is None:
            return None
        self._check_keys(what, said, tree)
        values = {key: self._value(key, entry.value) for key, entry in said.items() if key != "run"}
        values = {key: value for key, value in values.items() if value is not None}
        of_plan = {key: values[key] for key in Plan.__struct_fields__ if key in values}
        of_work = {key: values[key] for key in Work.__struct_fields__ if key in values}
        plan = Plan(work=Work(run=what, folder=self._folder, **of_work), **of_plan)
        self._check_values(plan)
        return plan

    def _check_keys(self, what: Kind, said: Mapping[str, Entry], tree: Map) -> None:
        for key, entry in said.items():
            if what not in _KINDS_OF.get(key, KINDS):
                meant = " or ".join(_KINDS_OF[key])
                self._complain(entry.position, f"{key} says something of a {meant}; this is a {what}")
        for key in _NEEDED[what]:
            if key not in said:
                self._complain(tree.position, f"a {what} needs {key}")

    def _check_values(self, plan: Plan) -> None:
        """What is said twice, and how many runs that makes."""
        for name in plan.sweep:
            if name in plan.parameters:
                self._complain(self.places[f"sweep.{name}"], f"{name} is in parameters, too; say it once")
            if any(name in point for point in plan.points):
                self._complain(self.places[f"sweep.{name}"], f"{name} is in points, too; say it once")
        count = math.prod(map(len, plan.sweep.values())) * max(len(plan.points), 1) * max(len(plan.seeds), 1)
        if count > MOST_RUNS:
            at = self.places.get("sweep") or self.places["seeds"]
            self._complain(at, f"{count:,} combinations for each recording; at most {MOST_RUNS:,} are run")

    def _value(self, key: str, tree: Tree) -> Any:
        """What a key says; None where it has a mistake."""
        forms: dict[str, Callable[[Tree, str], Any]] = {
            "nodes": self._texts, "recordings": self._texts, "ignore": self._texts, "command": self._words,
            "manifest": self._text, "robot": self._text, "tolerances": self._text,
            "function": self._function, "score": self._function,
            "arguments": self._arguments, "parameters": self._parameters, "sweep": self._sweep, "points": self._points,
            "seeds": self._seeds, "metrics": self._metrics, "keep": self._flag,
            "runs": self._count, "attempts": self._count, "timeout": self._seconds, "patience": self._seconds,
        }  # fmt: skip
        form = forms.get(key)
        return form(tree, key) if form is not None else None

    # -- single values -------------------------------------------------------------------------------------------------

    def _text(self, tree: Tree, key: str) -> str | None:
        if isinstance(tree, Scalar) and isinstance(tree.value, str) and tree.value:
            return tree.value
        self._expected(tree, key, "a text")
        return None

    def _word(self, tree: Tree, key: str, words: Collection[W]) -> W | None:
        value = tree.value if isinstance(tree, Scalar) else None
        found = choice_of(value, words) if isinstance(value, str) else None
        if found is None:
            close = hint(str(value), words, "") if value is not None else ""
            self._expected(tree, key, f"one of {', '.join(words)}", close)
            return None
        return found

    def _flag(self, tree: Tree, key: str) -> bool | None:
        if isinstance(tree, Scalar) and isinstance(tree.value, bool):
            return tree.value
        self._expected(tree, key, "true or false")
        return None

    def _count(self, tree: Tree, key: str) -> int | None:
        value = tree.value if isinstance(tree, Scalar) else None
        if isinstance(value, int) and not isinstance(value, bool) and 1 <= value <= 1000:
            return value
        self._expected(tree, key, "a whole number from 1 to 1000")
        return None

    def _seconds(self, tree: Tree, key: str) -> float | None:
        value = tree.value if isinstance(tree, Scalar) else None
        if isinstance(value, (int, float)) and not isinstance(value, bool) and 0 < value <= 1e6:
            return float(value)
        self._expected(tree, key, "seconds, more than 0 and at most 1000000")
        return None

    def _function(self, tree: Tree, key: str) -> str | None:
        text = tree.value if isinstance(tree, Scalar) else None
        if isinstance(text, str) and FUNCTION.fullmatch(text):
            return text
        self._expected(tree, key, "package.module:function")
        return None

    # -- several -------------------------------------------------------------------------------------------------------

    def _texts(self, tree: Tree, key: str) -> tuple[str, ...] | None:
        items = tree.items if isinstance(tree, Items) else (tree,)
        if not items:
            self._expected(tree, key, "a text, or several")
            return None
        for number, item in enumerate(items):
            self.places[f"{key}.{number}"] = item.position
        found = [self._text(item, key) for item in items]
        return tuple(one for one in found if one is not None)

    def _words(self, tree: Tree, key: str) -> tuple[str, ...] | None:
        """A command: a list of words, or a line."""
        if isinstance(tree, Items):
            return self._texts(tree, key)
        line = self._text(tree, key)
        if line is None:
            return None
        import shlex

        try:
            return tuple(shlex.split(line))
        except ValueError as error:
            self._complain(tree.position, f"{key}: {str(error).lower()}")
            return None

    def _arguments(self, tree: Tree, key: str) -> dict[str, str] | None:
        found: dict[str, str] = {}
        for entry in self._entries(tree, key):
            value = entry.value.value if isinstance(entry.value, Scalar) else None
            if value is None:
                self._expected(entry.value, entry.key, "a single value")
            else:
                found[entry.key] = str(value).lower() if isinstance(value, bool) else str(value)
        return found

    def _parameters(self, tree: Tree, key: str) -> dict[str, Any] | None:
        found: dict[str, Any] = {}
        for entry in self._entries(tree, key):
            self.places[f"{key}.{entry.key}"] = entry.value.position
            if isinstance(entry.value, Map):
                text = f"{entry.key} is a map; write each value as NODE.PARAMETER"
                self._complain(entry.value.position, text)
            elif isinstance(entry.value, Scalar) and entry.value.value is None:
                self._expected(entry.value, entry.key, "a value")
            else:
                found[entry.key] = plain(entry.value)
        return found

    def _sweep(self, tree: Tree, key: str) -> dict[str, tuple[Any, ...]] | None:
        found: dict[str, tuple[Any, ...]] = {}
        for entry in self._entries(tree, key):
            self.places[f"{key}.{entry.key}"] = entry.position
            if not isinstance(entry.value, Items) or not entry.value.items:
                self._expected(entry.value, entry.key, "a list of values")
                continue
            values = [plain(item) for item in entry.value.items]
            for number, item in enumerate(entry.value.items):
                self.places[f"{key}.{entry.key}.{number}"] = item.position
                if values[number] is None:
                    self._expected(item, entry.key, "a value")
                elif repr(values[number]) in map(repr, values[:number]):
                    self._complain(item.position, f"{entry.key}: {shown(values[number])} stands twice")
            found[entry.key] = tuple(values)
        return found

    def _points(self, tree: Tree, key: str) -> tuple[dict[str, Any], ...] | None:
        if not isinstance(tree, Items) or not tree.items:
            self._expected(tree, key, "a list of maps from parameters to values")
            return None
        found = []
        for number, item in enumerate(tree.items):
            self.places[f"{key}.{number}"] = item.position
            found.append(self._parameters(item, f"{key}.{number}"))
        return tuple(one for one in found if one is not None)

    def _seeds(self, tree: Tree, key: str) -> tuple[int, ...] | None:
        items = tree.items if isinstance(tree, Items) else (tree,)
        values = [item.value for item in items if isinstance(item, Scalar)]
        whole = [one for one in values if isinstance(one, int) and not isinstance(one, bool) and 0 <= one < 2**32]
        if not items or len(whole) < len(items) or len(set(whole)) < len(whole):
            self._expected(tree, key, "a number of seeds, or a list of different whole numbers from 0")
            return None
        if isinstance(tree, Items):
            return tuple(whole)
        if not 1 <= whole[0] <= MOST_RUNS:
            self._expected(tree, key, f"a number of seeds from 1 to {MOST_RUNS:,}")
            return None
        return tuple(range(1, whole[0] + 1))

    def _metrics(self, tree: Tree, key: str) -> dict[str, Metric] | None:
        found: dict[str, Metric] = {}
        for entry in self._entries(tree, key):
            self.places[f"{key}.{entry.key}"] = entry.position
            metric = self._metric(entry)
            if metric is not None:
                found[entry.key] = metric
        return found

    def _metric(self, entry: Entry) -> Metric | None:
        said: dict[str, Tree] = {}
        for one in self._entries(entry.value, entry.key):
            if one.key in Metric.__struct_fields__:
                said[one.key] = one.value
            else:
                known = suggest(one.key, Metric.__struct_fields__)
                self._complain(one.position, f"there is no key {shown(one.key)} here; {known}")
        if not isinstance(entry.value, Map):
            return None
        for needed in ("topic", "field"):
            if needed not in said:
                self._complain(entry.position, f"{entry.key} needs {needed}")
                return None
        topic, field = self._text(said["topic"], "topic"), self._text(said["field"], "field")
        take = self._word(said["take"], "take", TAKES) if "take" in said else "last"
        if topic is None or field is None or take is None:
            return None
        try:
            Field(field)
        except UsageError as error:
            self._complain(said["field"].position, str(error))
            return None
        return Metric(topic, field, take)

    def _entries(self, tree: Tree, key: str) -> Iterator[Entry]:
        if isinstance(tree, Map):
            yield from tree
        else:
            self._expected(tree, key, "a map")

    def _expected(self, tree: Tree, key: str, what: str, more: str = "") -> None:
        self._complain(tree.position, f"{key}: expected {what}, not {kind(tree)}{more}")

    def _complain(self, position: Position, text: str) -> None:
        self._problems.append(Problem(position, text))
