"""Parameters of one node, from all that is said about them.

Least to most: declared default < files in their order (within a file, less specific < more specific)
< values of the manifest, outer before inner < `-p` of the command line.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence

import msgspec

from robo.launch.arguments import COMMAND_LINE
from robo.launch.contracts import Answer, typed
from robo.launch.find import nearby
from robo.launch.manifest import ParameterSource
from robo.launch.plan import ParameterValue
from robo.launch.substitution import BROKEN, Scope, Word
from robo.parameters import files as parameter_files
from robo.parameters.files import ParameterEntry, ParameterFile, flat_entries
from robo.text.brief import shown
from robo.text.suggestions import hint, suggest
from robo.text.tree import Position, Problem, Scalar


class Said(msgspec.Struct, frozen=True):
    """A source of parameters, with the names it may use."""

    source: ParameterSource
    scope: Scope
    shared: bool
    """Whether it is said of a group: its nodes take what they have."""


class Setting(msgspec.Struct, frozen=True):
    """One value, where its name and where it stands, and whether it is said of several nodes."""

    value: object
    name_at: Position
    value_at: Position
    shared: bool
    over: "Setting | None" = None
    """What was said before, and does not count."""

    @property
    def source(self) -> str:
        """Where it is said, for people."""
        return str(self.name_at)


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


def gather(said: Sequence[Said], namespace: str, node: str, files: Files) -> tuple[dict[str, Setting], tuple[str, ...]]:
    """Every parameter that is said of a node: files in order, then the manifest's values over them.

    Returns:
        The settings by name, and the files that say something of the node.
    """
    read: dict[str, None] = {}
    found: dict[str, Setting] = {}
    holding = [one for one in said if one.scope.holds(one.source.condition)]
    for one in holding:
        if one.source.file is None:
            continue
        name = one.scope.path(one.source.file)
        if not name:
            continue  # an argument that names no file
        path = nearby(one.scope.folder / name)
        for entry, shared in files.entries_for(path, one.source.file.position, namespace, node):
            read[path] = None
            for key, value in entry.values.items():
                found[key] = Setting(value, entry.positions[key], entry.places[key], shared, found.get(key))
    for one in holding:
        for key, said_value in flat_entries(one.source.values) if one.source.values is not None else ():
            tree = said_value.value
            value = one.scope.raw(tree) if isinstance(tree, Scalar) else one.scope.plain(tree)
            if value is not BROKEN:
                found[key] = Setting(value, said_value.position, tree.position, one.shared, found.get(key))
    return found, tuple(map(str, read))


class Checked(msgspec.Struct, frozen=True):
    """What is to be known of a node to check its parameters."""

    full_name: str
    settings: Mapping[str, Setting]
    answer: Answer | None
    """None for a command, which takes whatever it is given."""


def check(nodes: Sequence[Checked], problems: list[Problem], loose: list[Problem]) -> list[dict[str, ParameterValue]]:
    """The parameters of each node.

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
        declared.update(node.settings if own is None else own)
    plain: list[dict[str, ParameterValue]] = []
    for node in nodes:
        own = _declared(node)
        values: dict[str, ParameterValue] = {}
        for name, setting in node.settings.items():
            if own is not None and name not in own:
                if not setting.shared:
                    problems.append(_unknown(node, name, setting, own))
                elif name not in declared:
                    # What is said for this start alone is meant for somebody.
                    mistakes = problems if setting.name_at is COMMAND_LINE else loose
                    mistakes.append(_unknown_to_all(name, setting, declared))
                continue
            values[name] = _value(setting, (own or {}).get(name))
            mistake = node.answer.mistakes.get(name) if node.answer is not None else None
            if mistake is not None:
                problems.append(Problem(setting.value_at, mistake))
        plain.append(values)
    return plain


def _value(setting: Setting, parameter_type: str | None) -> ParameterValue:
    weaker: list[ParameterValue] = []
    other = setting.over
    while other is not None:
        weaker.append(ParameterValue(typed(other.value, parameter_type), other.source))
        other = other.over
    return ParameterValue(typed(setting.value, parameter_type), setting.source, tuple(reversed(weaker)))


def _declared(node: Checked) -> Mapping[str, str] | None:
    """The node's parameters by name; None where they are not known."""
    contract = node.answer.contract if node.answer is not None else None
    return None if contract is None else contract.parameters


def _unknown(node: Checked, name: str, setting: Setting, own: Mapping[str, str]) -> Problem:
    return Problem(setting.name_at, f"{node.full_name} has no parameter {shown(name)}; {suggest(name, own, 'it has')}")


def _unknown_to_all(name: str, setting: Setting, declared: Collection[str]) -> Problem:
    return Problem(setting.name_at, f"no node has a parameter {shown(name)}{hint(name, declared)}")


def assign(
    assignments: Sequence[Assignment],
    nodes: Sequence[tuple[str, str, dict[str, Setting]]],
    problems: list[Problem],
) -> None:
    """Put the values of the command line over those of each node, given by name, full name and settings."""
    for assignment in assignments:
        named = [
            (settings, name)
            for node, full_name, settings in nodes
            if (name := assignment.name_for(node, full_name)) is not None
        ]
        for settings, name in named or [(settings, assignment.left) for _, _, settings in nodes]:
            settings[name] = Setting(assignment.value, COMMAND_LINE, COMMAND_LINE, not named, settings.get(name))
        if not named and "." in assignment.left:
            node = assignment.left.partition(".")[0]
            if meant := hint(node, [name for name, _, _ in nodes]):
                problems.append(Problem(COMMAND_LINE, f"-p {assignment.left}: there is no node {node}{meant}"))


def as_question(settings: Mapping[str, Setting]) -> dict[str, object]:
    """The values for a node class to look at."""
    return {name: setting.value for name, setting in settings.items()}
