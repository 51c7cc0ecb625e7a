"""Parameters of one node, from all that is said about them.

Least to most: declared default < files in their order (within a file, less specific < more specific)
< values of the manifest, outer before inner < `-p` of the command line.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path

import msgspec

from robo.launch.arguments import COMMAND_LINE
from robo.launch.contracts import Answer, typed
from robo.launch.find import nearby
from robo.launch.forms import text_of
from robo.launch.layers import Layer
from robo.launch.substitution import BROKEN, Complain, Word, told
from robo.parameters import files as parameter_files
from robo.parameters.files import ParameterEntry, ParameterFile, flat_entries
from robo.parameters.shape import declared_as
from robo.text.brief import shown
from robo.text.suggestions import hint, suggest
from robo.text.tree import Position, Problem, Scalar, plain
from robo.wire.reports import Setting


class Mention(msgspec.Struct, frozen=True):
    """One value, where its name and where it stands, and whether it is said of several nodes."""

    value: object
    name_at: Position
    value_at: Position
    shared: bool
    """As of a group, or by a pattern: its nodes take what they have."""


class Assignment(msgspec.Struct, frozen=True):
    """`-p NODE.NAME:=VALUE` or `-p NAME:=VALUE`."""

    left: str
    value: Word

    def name_for(self, name: str, full_name: str) -> str | None:
        """The parameter that is meant at a node; None where another node is meant."""
        for node in (full_name, full_name.strip("/"), name):
            if self.left.startswith(f"{node}."):
                return self.left.removeprefix(f"{node}.")
        return None


class Files:
    """The parameter files of a launch, each read once."""

    def __init__(self, problems: list[Problem]) -> None:
        self._problems = problems
        self._files: dict[str, ParameterFile | None] = {}
        self._matched: set[tuple[str, Position]] = set()

    def entries_for(
        self, path: str, asked: Position, namespace: str, node: str
    ) -> Iterable[tuple[ParameterEntry, bool]]:
        """The entries of a file that mean a node, from the general to the specific."""
        if path not in self._files:
            self._files[path] = parameter_files.load_into(path, asked, self._problems)
        file = self._files[path]
        for entry in file.entries if file is not None else ():
            if entry.matches(namespace, node):
                self._matched.add((path, entry.position))
                yield entry, not entry.names_one_node

    def paths(self) -> list[str]:
        """Those that are there."""
        return [path for path, file in self._files.items() if file is not None]

    def warnings(self) -> list[Problem]:
        """Where files contradict themselves."""
        return [warning for file in self._files.values() if file is not None for warning in file.warnings]

    def unmatched(self) -> list[ParameterEntry]:
        """The entries that mean no node at all."""
        return [
            entry
            for path, file in self._files.items()
            for entry in (file.entries if file is not None else ())
            if (path, entry.position) not in self._matched
        ]


def gather(
    layers: Sequence[Layer], namespace: str, node: str, files: Files, complain: Complain
) -> tuple[dict[str, list[Mention]], tuple[str, ...]]:
    """Every parameter that is said of a node: files in order, then the manifest's values over them.

    Returns:
        By name all that is said of it, the weakest first, and the files that say something of the node.
    """
    read: dict[str, None] = {}
    found: dict[str, list[Mention]] = {}
    sources = [(source, layer.of_group) for layer in layers for source in layer.params]
    for source, _ in sources:
        name = text_of(source.file, complain) if source.file is not None else None
        if not name or source.file is None:
            continue  # an argument that names no file
        path = nearby(Path(name))
        for entry, shared in files.entries_for(path, source.file.position, namespace, node):
            read[path] = None
            for key, value in entry.values.items():
                mention = Mention(value, entry.positions[key], entry.places[key], shared)
                found.setdefault(key, []).append(mention)
    for source, shared in sources:
        for key, (_, name_at, tree) in flat_entries(source.values) if source.values is not None else ():
            value = told(tree.value if isinstance(tree, Scalar) else plain(tree), complain)
            if value is not BROKEN:
                found.setdefault(key, []).append(Mention(value, name_at, tree.position, shared))
    return found, tuple(read)


class NodeFacts(msgspec.Struct, frozen=True):
    """What is to be known of a node to check its parameters."""

    full_name: str
    mentions: Mapping[str, Sequence[Mention]]
    answer: Answer | None
    """None for a command, which takes whatever it is given."""


def check(
    nodes: Sequence[NodeFacts], problems: list[Problem], loose: list[Problem]
) -> list[dict[str, tuple[Setting, ...]]]:
    """The settings of each node's parameters.

    What is said of a group, or by a pattern, is for those nodes that have such a parameter.

    Args:
        nodes: all of the launch.
        problems: takes what is said of one node that has no such parameter, or on the command line and
            nobody has it, and refused values.
        loose: takes what else is said of several nodes of which none has such a parameter.
    """
    declared: set[str] = set()
    for node in nodes:
        own = _declared(node)
        declared.update(node.mentions if own is None else own)
    settled: list[dict[str, tuple[Setting, ...]]] = []
    for node in nodes:
        own = _declared(node)
        settings: dict[str, tuple[Setting, ...]] = {}
        for name, mentions in node.mentions.items():
            last = mentions[-1]
            known = name if own is None else declared_as(name, own)
            if own is not None and known is None:
                if not last.shared:
                    problems.append(_unknown(node, name, last, own))
                elif declared_as(name, declared) is None:
                    # What is said for this start alone is meant for somebody.
                    mistakes = problems if last.name_at is COMMAND_LINE else loose
                    mistakes.append(_unknown_to_all(name, last, declared))
                continue
            kind = (own or {}).get(known or name)
            settings[name] = tuple(Setting(typed(one.value, kind), str(one.name_at)) for one in mentions)
            mistake = node.answer.mistakes.get(name) if node.answer is not None else None
            if mistake is not None:
                problems.append(Problem(last.value_at, mistake))
        settled.append(settings)
    return settled


def _declared(node: NodeFacts) -> Mapping[str, str] | None:
    """The node's parameters by name; None where they are not known."""
    contract = node.answer.contract if node.answer is not None else None
    return None if contract is None else contract.parameter_types


def _unknown(node: NodeFacts, name: str, mention: Mention, own: Mapping[str, str]) -> Problem:
    return Problem(mention.name_at, f"{node.full_name} has no parameter {shown(name)}; {suggest(name, own, 'it has')}")


def _unknown_to_all(name: str, mention: Mention, declared: Collection[str]) -> Problem:
    return Problem(mention.name_at, f"no node has a parameter {shown(name)}{hint(name, declared)}")


def assign(
    assignments: Sequence[Assignment],
    nodes: Sequence[tuple[str, str, dict[str, list[Mention]]]],
    problems: list[Problem],
) -> None:
    """Put the values of the command line over those of each node, given by name, full name and what is said of it."""
    for assignment in assignments:
        named = [
            (mentions, name)
            for node, full_name, mentions in nodes
            if (name := assignment.name_for(node, full_name)) is not None
        ]
        for mentions, name in named or [(mentions, assignment.left) for _, _, mentions in nodes]:
            mention = Mention(assignment.value, COMMAND_LINE, COMMAND_LINE, not named)
            mentions.setdefault(name, []).append(mention)
        if not named and "." in assignment.left:
            node = assignment.left.partition(".")[0]
            if meant := hint(node, [name for name, _, _ in nodes]):
                problems.append(Problem(COMMAND_LINE, f"-p {assignment.left}: there is no node {node}{meant}"))


def as_question(mentions: Mapping[str, Sequence[Mention]]) -> dict[str, object]:
    """The values for a node class to look at."""
    return {name: of_one[-1].value for name, of_one in mentions.items()}
