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
from collections.abc import Iterator
from pathlib import Path

import msgspec

from robo import names
from robo.errors import ParameterFileError
from robo.suggestions import hint
from robo.yaml_tree import Entry, Map, Position, Problem, parse, plain

ROS_KEY = "ros__parameters"


class ParameterEntry(msgspec.Struct, frozen=True):
    """The values that a file gives to the nodes that match a pattern."""

    pattern: str
    """As written, namespaces joined: `/**`, `tracker`, `/r1/tracker`."""
    values: dict[str, object]
    positions: dict[str, Position]
    """Where each name stands."""
    places: dict[str, Position]
    """Where each value stands."""
    position: Position

    @property
    def names_one_node(self) -> bool:
        """Whether it means a node by its name, and no pattern of nodes."""
        return "*" not in self.pattern.rpartition("/")[2]

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
    problems: list[Problem] = []
    file = read(_text_of(path), path, problems)
    if problems:
        raise ParameterFileError("\n".join(map(str, problems)))
    return file


def load_into(path: str | Path, asked: Position, problems: list[Problem]) -> ParameterFile | None:
    """Read a parameter file that a manifest asks for; mistakes are added to `problems`.

    Returns:
        None where it is missing or unreadable, which is a mistake at the place that asked.
    """
    try:
        return read(_text_of(path), path, problems)
    except ParameterFileError as error:
        problems.append(Problem(asked, str(error)))
        return None


def read(text: str, path: str | Path, problems: list[Problem]) -> ParameterFile:
    """The parameter file of a text; mistakes are added to `problems` and what they hit is left out."""
    entries: list[ParameterEntry] = []
    tree = parse(text, path, problems)
    if isinstance(tree, Map):
        for entry in tree:
            _collect("", entry, entries, problems)
    elif tree is not None:
        problems.append(Problem(tree.position, "expected a map from node names to their parameters"))
    return ParameterFile(str(path), tuple(sorted(entries, key=lambda entry: entry.specificity)))


def _text_of(path: str | Path) -> str:
    try:
        return Path(path).read_text(encoding="utf-8")
    except FileNotFoundError:
        hint = _similar(Path(path))
        raise ParameterFileError(f"parameter file {path} does not exist{hint}") from None
    except (OSError, UnicodeDecodeError, ValueError) as error:
        raise ParameterFileError(f"parameter file {path} cannot be read: {error}") from None


def _similar(path: Path) -> str:
    """What is there instead, for a message."""
    try:
        known = sorted(other.name for other in path.parent.iterdir() if other.suffix in (".yaml", ".yml"))
    except OSError:
        return f"; there is no folder {path.parent}" if not path.parent.is_dir() else ""
    return hint(path.name, known)


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


def flat_entries(values: Map, prefix: str = "") -> Iterator[tuple[str, Entry]]:
    """Single parameters by name; those of a map within have names with dots: `{gains: {p: 1}}` is `gains.p`."""
    for entry in values:
        name = f"{prefix}{entry.key}"
        if isinstance(entry.value, Map) and entry.value.entries:
            yield from flat_entries(entry.value, f"{name}.")
        else:
            yield name, entry


def _entry(pattern: str, values: Map, position: Position) -> ParameterEntry:
    named = dict(flat_entries(values))
    return ParameterEntry(
        pattern,
        {name: plain(entry.value) for name, entry in named.items()},
        {name: entry.position for name, entry in named.items()},
        {name: entry.value.position for name, entry in named.items()},
        position,
    )
