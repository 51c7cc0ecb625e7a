"""The manifest as written: a typed tree in which every part knows where it stands.

Substitutions are left in place; `plan` resolves them. All mistakes of a file are collected.
"""

import difflib
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Literal, TypeVar, get_args

import msgspec

from robo.yaml_tree import Entry, Items, Map, Position, Problem, Scalar, Tree, kind, parse

ArgType = Literal["str", "int", "float", "bool", "path"]
T = TypeVar("T")


class Arg(msgspec.Struct, frozen=True):
    """A launch argument."""

    name: str
    type: ArgType
    default: Scalar | None
    """None where it has to be given."""
    description: str
    position: Position


class Include(msgspec.Struct, frozen=True):
    """Another manifest, started as part of this one."""

    file: Scalar
    args: tuple[Entry, ...]
    position: Position


class NodeEntry(msgspec.Struct, frozen=True, kw_only=True):
    """A process to start."""

    name: str
    service: Scalar
    namespace: Scalar | None
    params: tuple[Tree, ...]
    """Files (scalars) and inline values (maps), in order."""
    remap: tuple[Entry, ...]
    env: tuple[Entry, ...]
    needs: tuple[Scalar, ...]
    required: Scalar | None
    condition: "Condition"
    position: Position


class Condition(msgspec.Struct, frozen=True):
    """`if:` and `unless:`; both empty means yes."""

    when: Scalar | None
    unless: Scalar | None


class Group(msgspec.Struct, frozen=True, kw_only=True):
    """Nodes that share settings and can be started by themselves."""

    name: str
    namespace: Scalar | None
    params: tuple[Tree, ...]
    remap: tuple[Entry, ...]
    env: tuple[Entry, ...]
    include: Include | None
    nodes: tuple[NodeEntry, ...]
    condition: Condition
    position: Position


class Manifest(msgspec.Struct, frozen=True, kw_only=True):
    """A launch manifest."""

    file: Path
    description: str
    args: tuple[Arg, ...]
    includes: tuple[Include, ...]
    groups: tuple[Group, ...]


def read(text: str, file: Path, problems: list[Problem]) -> Manifest | None:
    """The manifest of a text; mistakes are added to `problems` and what they hit is left out.

    Returns:
        None where the text is no YAML.
    """
    tree = parse(text, file, problems, placeholders=True)
    if tree is None:
        return None
    reader = _Reader(problems)
    if not isinstance(tree, Map):
        reader.complain(tree.position, f"a manifest is a map, not {kind(tree)}")
    root = tree if isinstance(tree, Map) else Map((), Position(str(file), 1, 1))
    parts = reader.fields(root, "a manifest", {"description", "args", "include", "groups"})
    return Manifest(
        file=file,
        description=str(description.value) if isinstance(description := parts.get("description"), Scalar) else "",
        args=reader.named(parts.get("args"), "args", reader.arg),
        includes=reader.includes(parts.get("include")),
        groups=reader.named(parts.get("groups"), "groups", reader.group),
    )


class _Reader:
    def __init__(self, problems: list[Problem]) -> None:
        self._problems = problems

    def complain(self, position: Position, text: str) -> None:
        self._problems.append(Problem(position, text))

    def fields(self, tree: Map, what: str, known: Collection[str]) -> dict[str, Tree]:
        """The values of a map by key; unknown keys are mistakes."""
        for entry in tree:
            if entry.key not in known:
                close = difflib.get_close_matches(entry.key, known, n=1)
                hint = f"did you mean {close[0]!r}?" if close else f"it may hold {', '.join(sorted(known))}"
                self.complain(entry.position, f"unknown key {entry.key!r} in {what}; {hint}")
        return {entry.key: entry.value for entry in tree if entry.key in known}

    def named(self, tree: Tree | None, what: str, read: Callable[[Entry], T | None]) -> tuple[T, ...]:
        """The parts of a map from names to maps."""
        if tree is None:
            return ()
        if not isinstance(tree, Map):
            if not (isinstance(tree, Scalar) and tree.value is None):
                self.complain(tree.position, f"{what}: expected a map of names, not {kind(tree)}")
            return ()
        return tuple(part for entry in tree if (part := read(entry)) is not None)

    def arg(self, entry: Entry) -> Arg | None:
        if isinstance(entry.value, Scalar):  # `name: default` in short
            return Arg(entry.key, _type_of(entry.value), entry.value, "", entry.position)
        if not isinstance(entry.value, Map):
            self.complain(entry.value.position, f"argument {entry.key}: expected a default or a map")
            return None
        parts = self.fields(entry.value, f"argument {entry.key!r}", {"type", "default", "description"})
        default = self.scalar(parts.get("default"), "default")
        type_ = _type_of(default)
        given = self.scalar(parts.get("type"), "type")
        if given is not None:
            if given.value in get_args(ArgType):
                type_ = msgspec.convert(given.value, ArgType)
            else:
                self.complain(given.position, f"type {given.value!r}: use one of {', '.join(get_args(ArgType))}")
        description = self.scalar(parts.get("description"), "description")
        return Arg(entry.key, type_, default, str(description.value) if description else "", entry.position)

    def group(self, entry: Entry) -> Group | None:
        what = f"group {entry.key!r}"
        if not isinstance(entry.value, Map):
            self.complain(entry.value.position, f"{what}: expected a map, not {kind(entry.value)}")
            return None
        parts = self.fields(
            entry.value, what, {"namespace", "params", "remap", "env", "include", "args", "nodes", "if", "unless"}
        )
        include = self.scalar(parts.get("include"), "include")
        if "args" in parts and include is None:
            self.complain(parts["args"].position, f"{what} has args but no include that takes them")
        if include is None and "nodes" not in parts:
            self.complain(entry.position, f"{what} starts nothing; give it nodes or an include")
        return Group(
            name=entry.key,
            namespace=self.scalar(parts.get("namespace"), "namespace"),
            params=self.params(parts.get("params")),
            remap=self.entries(parts.get("remap"), "remap"),
            env=self.entries(parts.get("env"), "env"),
            include=Include(include, self.entries(parts.get("args"), "args"), entry.position) if include else None,
            nodes=self.named(parts.get("nodes"), "nodes", self.node),
            condition=self.condition(parts),
            position=entry.position,
        )

    def node(self, entry: Entry) -> NodeEntry | None:
        what = f"node {entry.key!r}"
        if not isinstance(entry.value, Map):
            self.complain(entry.value.position, f"{what}: expected a map with service, not {kind(entry.value)}")
            return None
        parts = self.fields(
            entry.value, what, {"service", "namespace", "params", "remap", "env", "needs", "required", "if", "unless"}
        )
        service = self.scalar(parts.get("service"), "service")
        if service is None:
            self.complain(entry.position, f"{what} has no service; name a node class, for example my_package.my_node")
            return None
        return NodeEntry(
            name=entry.key,
            service=service,
            namespace=self.scalar(parts.get("namespace"), "namespace"),
            params=self.params(parts.get("params")),
            remap=self.entries(parts.get("remap"), "remap"),
            env=self.entries(parts.get("env"), "env"),
            needs=self.needs(parts.get("needs")),
            required=self.scalar(parts.get("required"), "required"),
            condition=self.condition(parts),
            position=entry.position,
        )

    def includes(self, tree: Tree | None) -> tuple[Include, ...]:
        """`include: file`, `include: {file: …, args: …}`, or a list of these."""
        parts = tree.items if isinstance(tree, Items) else () if tree is None else (tree,)
        found = []
        for part in parts:
            if isinstance(part, Scalar):
                found.append(Include(part, (), part.position))
            elif isinstance(part, Map):
                values = self.fields(part, "an include", {"file", "args"})
                file = self.scalar(values.get("file"), "file")
                if file is None:
                    self.complain(part.position, "an include names its file: {file: robot.yaml, args: {…}}")
                else:
                    found.append(Include(file, self.entries(values.get("args"), "args"), part.position))
            else:
                self.complain(part.position, f"include: expected a file, not {kind(part)}")
        return tuple(found)

    def condition(self, parts: dict[str, Tree]) -> Condition:
        return Condition(self.scalar(parts.get("if"), "if"), self.scalar(parts.get("unless"), "unless"))

    def scalar(self, tree: Tree | None, what: str) -> Scalar | None:
        if tree is None or isinstance(tree, Scalar):
            return tree
        self.complain(tree.position, f"{what}: expected a single value, not {kind(tree)}")
        return None

    def entries(self, tree: Tree | None, what: str) -> tuple[Entry, ...]:
        if tree is None:
            return ()
        if not isinstance(tree, Map):
            self.complain(tree.position, f"{what}: expected a map, not {kind(tree)}")
            return ()
        for entry in tree:
            if what != "args":
                self.scalar(entry.value, f"{what} {entry.key}")
        return tree.entries

    def params(self, tree: Tree | None) -> tuple[Tree, ...]:
        """A file, a map of values, or a list of files and maps."""
        if tree is None:
            return ()
        parts = tree.items if isinstance(tree, Items) else (tree,)
        for part in parts:
            if isinstance(part, Items) or (isinstance(part, Scalar) and not isinstance(part.value, str)):
                self.complain(part.position, f"params: expected a file or a map of values, not {kind(part)}")
        return tuple(p for p in parts if isinstance(p, Map) or (isinstance(p, Scalar) and isinstance(p.value, str)))

    def needs(self, tree: Tree | None) -> tuple[Scalar, ...]:
        """`needs: {position_tracker: ready}` or a list of names."""
        if tree is None:
            return ()
        if isinstance(tree, Items):
            return tuple(name for item in tree.items if (name := self.scalar(item, "needs")) is not None)
        if isinstance(tree, Map):
            for entry in tree:
                if not (isinstance(entry.value, Scalar) and entry.value.value == "ready"):
                    self.complain(entry.value.position, f"needs {entry.key}: the condition to wait for is 'ready'")
            return tuple(Scalar(entry.key, entry.position) for entry in tree)
        return (tree,)


def _type_of(default: Scalar | None) -> ArgType:
    value = default.value if default is not None else None
    if isinstance(value, bool):
        return "bool"
    if isinstance(value, int):
        return "int"
    return "float" if isinstance(value, float) else "str"
