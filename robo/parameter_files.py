"""Parameter files: ROS 2's form and robo's plain form.

    /**:                      # every node
      ros__parameters:
        use_sim_time: false
    velocity_controller:      # the node of this name, in whatever namespace
      publish_rate: 10.0

A key names nodes: `name`, `/ns/name`, or a pattern in which `*` is one part of a name and `**` any
number. Where several entries match, the more specific one wins, whatever their order.
"""

import re
from pathlib import Path

import msgspec

from robo import names
from robo.errors import ParameterFileError
from robo.yaml_tree import Entry, Map, Position, Problem, parse, plain

ROS_KEY = "ros__parameters"


class ParameterEntry(msgspec.Struct, frozen=True):
    """The values that a file gives to the nodes that match a pattern."""

    pattern: str
    """As written, namespaces joined: `/**`, `tracker`, `/r1/tracker`."""
    values: dict[str, object]
    positions: dict[str, Position]
    """Where each value stands."""
    position: Position

    def matches(self, namespace: str, node: str) -> bool:
        """Whether the pattern means the node of this name in this namespace."""
        pattern = self.pattern.strip("/")
        if "/" not in pattern and "*" not in pattern and not self.pattern.startswith("/"):
            return pattern == node
        parts = [".*" if part == "**" else "[^/]+" if part == "*" else re.escape(part) for part in pattern.split("/")]
        expression = "/".join(parts).replace(".*/", "(?:.*/)?").replace("/.*", "(?:/.*)?")
        return re.fullmatch(expression, names.join(namespace, node)) is not None

    @property
    def specificity(self) -> tuple[int, int]:
        """Sorts entries from the general to the specific."""
        parts = self.pattern.strip("/").split("/")
        literal = [part for part in parts if "*" not in part]
        return (len(literal), -parts.count("**"))


class ParameterFile(msgspec.Struct, frozen=True):
    """A file's entries, from the general to the specific."""

    path: str
    entries: tuple[ParameterEntry, ...]

    def values_for(self, namespace: str, node: str) -> dict[str, object]:
        """The values for one node, the more specific over the less."""
        values: dict[str, object] = {}
        for entry in self.entries:
            if entry.matches(namespace, node):
                values |= entry.values
        return values


def load(path: str | Path) -> ParameterFile:
    """Read a parameter file.

    Raises:
        ParameterFileError: it is missing, unreadable, or has mistakes; names all of them.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
    except FileNotFoundError:
        raise ParameterFileError(f"parameter file {path} does not exist") from None
    except (OSError, UnicodeDecodeError) as error:
        raise ParameterFileError(f"parameter file {path} cannot be read: {error}") from None
    problems: list[Problem] = []
    entries: list[ParameterEntry] = []
    tree = parse(text, path, problems)
    if isinstance(tree, Map):
        for entry in tree:
            _collect("", entry, entries, problems)
    elif tree is not None:
        problems.append(Problem(tree.position, "expected a map from node names to their parameters"))
    if problems:
        raise ParameterFileError("\n".join(map(str, problems)))
    return ParameterFile(str(path), tuple(sorted(entries, key=lambda entry: entry.specificity)))


def _collect(prefix: str, entry: Entry, entries: list[ParameterEntry], problems: list[Problem]) -> None:
    pattern = entry.key if not prefix else f"{prefix.rstrip('/')}/{entry.key.lstrip('/')}"
    if not isinstance(entry.value, Map):
        problems.append(Problem(entry.position, f"{entry.key}: expected a map of parameters"))
        return
    ros = entry.value.get(ROS_KEY)
    if ros is not None:
        if isinstance(ros, Map):
            entries.append(_entry(pattern, ros, entry.position))
        else:
            problems.append(Problem(ros.position, f"{ROS_KEY}: expected a map of parameters"))
    elif any(_holds_ros(child) for child in entry.value):
        for child in entry.value:
            _collect(pattern, child, entries, problems)
    else:
        entries.append(_entry(pattern, entry.value, entry.position))


def _holds_ros(entry: Entry) -> bool:
    """Whether ROS's key stands somewhere below, which makes this entry a namespace or a node."""
    return isinstance(entry.value, Map) and any(child.key == ROS_KEY or _holds_ros(child) for child in entry.value)


def _entry(pattern: str, values: Map, position: Position) -> ParameterEntry:
    return ParameterEntry(
        pattern,
        {entry.key: plain(entry.value) for entry in values},
        {entry.key: entry.position for entry in values},
        position,
    )
