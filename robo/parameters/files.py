"""Parameter files: ROS 2's form and robo's plain form.

    /**:                      # every node
      ros__parameters:
        use_sim_time: false
    velocity_controller:      # the node of this name, in whatever namespace
      publish_rate: 10.0

A key names nodes: `name`, `/ns/name`, or a pattern in which `*` is one part of a name and `**` any
number. Where several entries match, the more specific one wins, whatever their order; of those with the
same pattern the last one. A pattern may stand twice, as ROS reads it; a parameter may not.
"""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec

from robo.errors import ParameterFileError, UnreadableFile
from robo.text.brief import shown
from robo.text.files import read_text
from robo.text.suggestions import hint
from robo.text.tree import Entry, Items, Map, Position, Problem, Scalar, Tree, plain
from robo.text.yaml_tree import parse, repeated
from robo.wire import names

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

    @property
    def nodes(self) -> str:
        """The pattern in one spelling: `ns/node` and `/ns/node` mean the same, `node` and `/node` do not."""
        return self.pattern.strip("/") if set("/*") & set(self.pattern.strip("/")) else self.pattern

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
    warnings: tuple[Problem, ...] = ()
    """Where two entries with the same pattern contradict each other."""

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
    tree = parse(text, path, problems, keep_repeated=True)
    if isinstance(tree, Map):
        for entry in tree:
            if entry.key == ROS_KEY:
                text = f"{ROS_KEY} stands where no node is named; put it within the node's name, or within /**"
                problems.append(Problem(entry.position, text))
            else:
                _collect("", entry, entries, problems)
    elif tree is not None:
        problems.append(Problem(tree.position, "expected a map from node names to their parameters"))
    ordered = tuple(sorted(entries, key=lambda entry: entry.specificity))
    return ParameterFile(str(path), ordered, tuple(_contradictions(ordered)))


def flat_entries(values: Map, prefix: str = "") -> Iterator[tuple[str, Entry]]:
    """Single parameters by name; those of a map within have names with dots: `{gains: {p: 1}}` is `gains.p`."""
    for entry in values:
        name = f"{prefix}{entry.key}"
        if isinstance(entry.value, Map) and entry.value.entries:
            yield from flat_entries(entry.value, f"{name}.")
        else:
            yield name, entry


def _text_of(path: str | Path) -> str:
    try:
        return read_text(path)
    except UnreadableFile as error:
        if error.missing:
            raise ParameterFileError(f"parameter file {path} does not exist{_similar(Path(path))}") from None
        raise ParameterFileError(f"parameter file {path} cannot be read: {error}") from None


def _similar(path: Path) -> str:
    """What is there instead, for a message."""
    try:
        known = sorted(other.name for other in path.parent.iterdir() if other.suffix in (".yaml", ".yml"))
    except OSError:
        return f"; there is no folder {path.parent}" if not path.parent.is_dir() else ""
    return hint(path.name, known)


def _collect(outer: str, entry: Entry, entries: list[ParameterEntry], problems: list[Problem]) -> None:
    """The entries of one key: a node or a pattern of nodes with its parameters, a namespace of them, or both."""
    mistake = _mistake(entry.key, at_root=not outer)
    if mistake is not None:
        problems.append(Problem(entry.position, mistake))
        return
    pattern = entry.key if not outer else f"{outer.removesuffix('/')}/{entry.key}"
    children = tuple(entry.value) if isinstance(entry.value, Map) else ()
    in_ros_form = any(child.key == ROS_KEY for child in children)
    if not in_ros_form and not any(map(_holds_ros, children)):
        _add(pattern, entry, entry.value, entries, problems)
        return
    for child in children:
        if child.key == ROS_KEY:
            _add(pattern, entry, child.value, entries, problems)
        elif in_ros_form and not _holds_ros(child):
            text = f"{child.key} stands beside {ROS_KEY}, where nothing reads it; put it within {ROS_KEY}"
            problems.append(Problem(child.position, text))
        else:
            _collect(pattern, child, entries, problems)


def _add(pattern: str, node: Entry, values: Tree, entries: list[ParameterEntry], problems: list[Problem]) -> None:
    """The entry of a node or a pattern of nodes."""
    if pattern.endswith("/"):
        text = f"{pattern} names a namespace and no node; write {pattern}NAME, or {pattern}* for all in it"
        problems.append(Problem(node.position, text))
    elif not isinstance(values, Map):
        what, where = (node.key, node.position) if values is node.value else (ROS_KEY, values.position)
        problems.append(Problem(where, f"{what}: expected a map of parameters"))
    else:
        entries.append(_entry(pattern, values, node.position, problems))


def _mistake(key: str, *, at_root: bool) -> str | None:
    """What is wrong with a key that names nodes; None where nothing is. Only the outermost may begin with `/`."""
    if not key:
        return "a key without a name; write the node's"
    body = (key.removeprefix("/") if at_root else key).removesuffix("/")
    for part in body.split("/") if key != "/" else ():
        if part in ("*", "**") or names.is_word(part):
            continue
        if not part:
            within = not at_root and key.startswith("/")
            fix = "within a namespace a name has no / before it" if within else "one / separates two names"
            return f"{shown(key)} has an empty name; {fix}"
        if "*" in part:
            return f"{shown(key)}: * stands for one whole name and ** for any number of them, not for part of a name"
        what = shown(key) if part == key else f"{shown(key)}: {shown(part)}"
        return f"{what} is not a valid name; use {names.RULE}, parts joined by /"
    return None


def _holds_ros(entry: Entry) -> bool:
    """Whether ROS's key stands somewhere below, which makes this entry a namespace or a node."""
    return isinstance(entry.value, Map) and any(child.key == ROS_KEY or _holds_ros(child) for child in entry.value)


def _entry(pattern: str, tree: Map, position: Position, problems: list[Problem]) -> ParameterEntry:
    twice = list(repeated(tree))
    told = {problem.position for problem in twice}
    problems += twice
    named: dict[str, Entry] = {}
    for name, entry in flat_entries(tree):
        first = named.setdefault(name, entry)
        if first is not entry and entry.position not in told:
            text = f"parameter {shown(name)} stands twice; it is already in line {first.position.line}"
            problems.append(Problem(entry.position, text))
    for name, entry in list(named.items()):
        for where in _empty(entry.value):
            at = entry.position if where is entry.value else where.position
            problems.append(Problem(at, f"{name} has no value; write one, or '' for an empty text"))
            named.pop(name, None)
    return ParameterEntry(
        pattern,
        {name: plain(entry.value) for name, entry in named.items()},
        {name: entry.position for name, entry in named.items()},
        {name: entry.value.position for name, entry in named.items()},
        position,
    )


def _empty(tree: Tree) -> Iterator[Scalar]:
    """What is null in a value, which ROS refuses as well."""
    if isinstance(tree, Scalar):
        yield from (tree,) if tree.value is None else ()
    else:
        for inner in tree.items if isinstance(tree, Items) else [entry.value for entry in tree]:
            yield from _empty(inner)


def _contradictions(entries: Sequence[ParameterEntry]) -> Iterator[Problem]:
    """What is said twice of the same nodes and not the same. The entries come in the order in which they hold."""
    known: dict[tuple[str, str], tuple[object, Position]] = {}
    for entry in entries:
        for name, value in entry.values.items():
            earlier = known.get((entry.nodes, name))
            known[entry.nodes, name] = value, entry.positions[name]
            # By their text as well: NaN equals nothing.
            if earlier is not None and earlier[0] != value and repr(earlier[0]) != repr(value):
                text = f"{entry.pattern}: {name} is {shown(value)} here and {shown(earlier[0])} in line"
                yield Problem(entry.positions[name], f"{text} {earlier[1].line}; the last one holds")
