"""From the text of a manifest to the manifest: what each key may hold, and where it stands.

All mistakes of a file are collected; what they hit is left out, so that one mistake is one message. What a key may
hold is said beside its field in `launch.manifest` and `launch.plan`; here stands what several keys say together, and
the few keys that are like no other.
"""

from pathlib import Path
from typing import Any, get_args

import msgspec

from robo.launch import language
from robo.launch.forms import SOME_TEXTS, is_one_of, scalars, single
from robo.launch.language import keys_of, part_of
from robo.launch.manifest import (
    Arg,
    ArgType,
    ForEach,
    Group,
    Include,
    Manifest,
    Need,
    NodeEntry,
    ParameterSource,
    TopicPromise,
    Variable,
)
from robo.launch.plan import NEEDS, TopicPlan, Until
from robo.text.brief import shown
from robo.text.readable import readable
from robo.text.suggestions import closest
from robo.text.tree import Entry, Items, Map, Position, Problem, Scalar, Tree, kind
from robo.text.yaml_tree import parse
from robo.wire.names import is_word

RESERVED = ("dir", "file", "workspace", "index")
"""Names that `${…}` knows by itself."""


def read(text: str, file: Path, problems: list[Problem]) -> Manifest | None:
    """The manifest of a text; mistakes are added to `problems`.

    Returns:
        None where the text is no YAML.
    """
    tree = parse(text, file, problems, placeholders=True)
    if tree is None:
        return None
    reader = _Reader(problems)
    if not isinstance(tree, Map):
        reader.complain(tree.position, f"a manifest is a map, not {kind(tree)}")
        tree = Map((), Position(str(file), 1, 1))
    values = reader.keys(Manifest, tree, "a manifest")
    return Manifest(file=file, **values | {"description": _text(values.get("description"))})


class _Reader:
    """Reads the parts of a manifest, for the forms of the keys that hold them."""

    def __init__(self, problems: list[Problem]) -> None:
        self._problems = problems
        self._parts = {
            "arg": self.arg,
            "group": self.group,
            "node": self.node,
            "override": self.override,
            "topic": self.topic,
            "variable": self.variable,
        }
        self._specials = {
            "includes": self.includes,
            "params": self.params,
            "needs": self.needs,
            "for_each": self.for_each,
        }

    def complain(self, position: Position, text: str) -> None:
        self._problems.append(Problem(position, text))

    def part(self, name: str, entry: Entry) -> Any:
        return self._parts[name](entry)

    def special(self, name: str, tree: Tree) -> Any:
        return self._specials[name](tree)

    def keys(self, part: type[msgspec.Struct], tree: Map, what: str) -> dict[str, Any]:
        """What a part says, by the fields of its Struct."""
        keys = keys_of(part)
        found = language.read(keys, language.fields(tree, what, keys, self), self)
        values: dict[str, Any] = {keys[name].field: value for name, value in found.items() if not keys[name].plain}
        plain = {name: value for name, value in found.items() if keys[name].plain}
        return values | ({"plain": plain} if plain else {})

    def map_of(self, entry: Entry, what: str) -> Map | None:
        if isinstance(entry.value, Map):
            return entry.value
        self.complain(entry.value.position, f"{what}: expected a map, not {kind(entry.value)}")
        return None

    # -- arguments -------------------------------------------------------------------------------

    def arg(self, entry: Entry) -> Arg | None:
        what = f"argument {entry.key}"
        if not is_word(entry.key):
            self.complain(entry.position, f"{shown(what)}: use letters, digits and _, not starting with a digit")
        elif entry.key in RESERVED:
            self.complain(entry.position, f"{what}: this name is taken, ${{{entry.key}}} has a meaning of its own")
        if isinstance(entry.value, Items):
            self.complain(entry.value.position, f"{what}: expected a default value or a map, not a list")
            return None
        if isinstance(entry.value, Scalar):  # `name: default` in short
            values: dict[str, Any] = {} if entry.value.value is None else {"default": entry.value}
        else:
            values = self.keys(Arg, entry.value, what)
        default, required, exists = (values.get(key) for key in ("default", "required", "exists"))
        if required is not None and required.value is not (default is None):
            said = "has a default" if default is not None else "has no default, so it has to be given"
            self.complain(required.position, f"{what} {said}: required: {kind(required).lower()} contradicts that")
        if exists is not None and not isinstance(exists.value, bool):
            self.complain(exists.position, f"{what}: exists is true or false, not {exists.value!r}")
        choices = scalars(values["choices"]) if "choices" in values else []
        given = values.get("type")
        type_ = (
            given.value
            if given is not None and given.value in get_args(ArgType)
            else "choice"
            if choices
            else _type_of(default)
        )
        if type_ == "choice" and not choices and not _has(entry.value, "choices"):
            self.complain(entry.position, f"{what} is a choice; add choices: [a, b]")
        return Arg(
            name=entry.key,
            type=type_,
            default=default,
            exists=exists is None or exists.value is not False,
            choices=tuple(choices),
            description=_text(values.get("description")),
            position=entry.position,
        )

    # -- groups and nodes ------------------------------------------------------------------------

    def group(self, entry: Entry) -> Group | None:
        what = f"group {shown(entry.key)}"
        if not is_word(entry.key.replace("-", "_")):
            self.complain(entry.position, f"{what}: use letters, digits, _ and -, not starting with a digit")
        tree = self.map_of(entry, what)
        if tree is None:
            return None
        values = self.settings(Group, tree, what)
        if _has(tree, "args") and not _has(tree, "include"):
            args = tree.get("args")
            assert args is not None
            self.complain(args.position, f"{what} has args but no include that takes them")
        if not {"include", "nodes", "groups", "topics", "bridges"} & {part.key for part in tree}:
            self.complain(entry.position, f"{what} starts nothing; give it nodes, groups or an include")
        shared = values.pop("args", ())
        includes = tuple(_with_args(include, shared) for include in values.pop("includes", ()))
        return Group(key=entry.key, tree=tree, position=entry.position, includes=includes, **values)

    def settings(self, part: type[msgspec.Struct], tree: Map, what: str) -> dict[str, Any]:
        """What a group or a node says; a loop is either by number or by items."""
        each = tree.get("for_each")
        if each is not None and _has(tree, "for_each") and _has(tree, "replicas"):
            self.complain(each.position, "replicas and for_each exclude each other; keep one")
            tree = Map(tuple(e for e in tree if e.key not in ("replicas", "for_each")), tree.position)
        return self.keys(part, tree, what)

    def node(self, entry: Entry) -> NodeEntry | None:
        what = f"node {shown(entry.key)}"
        tree = self.map_of(entry, f"{what}, which has a service or a run")
        if tree is None:  # others may need it: it is there, though nothing is known of it
            return NodeEntry(key=entry.key, tree=Map((), entry.value.position), position=entry.position)
        keys = {part.key for part in tree}
        if not keys & {"service", "run"}:
            if not any(closest(key, ("service", "run")) for key in keys):  # else the misspelt key is named already
                text = "has no service and no run; name a node class, package.module, or give a command"
                self.complain(entry.position, f"{what} {text}")
        elif {"service", "run"} <= keys:
            run = tree.get("run") if _has(tree, "run") else None
            self.complain((run or tree).position, f"{what} has both a service and a run; keep one")
        return NodeEntry(key=entry.key, tree=tree, position=entry.position, **self.settings(NodeEntry, tree, what))

    def override(self, entry: Entry) -> NodeEntry | None:
        """What is different about a node of an included manifest."""
        what = f"override of {shown(entry.key)}"
        tree = self.map_of(entry, what)
        if tree is None:
            return None
        return NodeEntry(key=entry.key, tree=tree, position=entry.position, **self.settings(NodeEntry, tree, what))

    def needs(self, tree: Tree) -> tuple[Need, ...] | None:
        """`needs: {position_tracker: ready}`, a list of names, or one name."""
        if not isinstance(tree, Map):
            several = SOME_TEXTS.read(tree, "needs", self)
            return tuple(Need(name, "ready") for name in scalars(several)) if several is not None else ()
        found = []
        for entry in tree:
            until: Until = "ready"
            scalar = single(entry.value, f"needs {entry.key}", self.complain)
            if scalar is not None and is_one_of(scalar, f"needs {entry.key}", NEEDS, self.complain):
                until = msgspec.convert(scalar.value, readable(Until)) if scalar.value in NEEDS else until
            found.append(Need(Scalar(entry.key, entry.position), until))
        return tuple(found)

    def for_each(self, tree: Tree) -> ForEach | None:
        each = language.entries(tree, "for_each", self)
        if len(each) != 1:
            if isinstance(tree, Map):
                self.complain(tree.position, "for_each: expected one name with its list: {robot: [r1, r2]}")
            return None
        variable, where, items = each[0]
        if not is_word(variable) or variable in RESERVED:
            self.complain(where, f"for_each: {shown(variable)} cannot be a name for its items")
            return None
        if not isinstance(items, Items):
            self.complain(items.position, f"for_each {variable}: expected a list, not {kind(items)}")
            return None
        return ForEach(variable, items)

    # -- includes, topics, parameters, environment -------------------------------------------------

    def includes(self, tree: Tree) -> tuple[Include, ...]:
        """`include: file`, `include: {file: …, args: …}`, or a list of these."""
        items = tree.items if isinstance(tree, Items) else (tree,)
        return tuple(found for item in items if (found := self._include(item)) is not None)

    def _include(self, tree: Tree) -> Include | None:
        if isinstance(tree, Items):
            self.complain(tree.position, f"include: expected a file or a map, not {kind(tree)}")
            return None
        values: dict[str, Any] = {"file": tree} if isinstance(tree, Scalar) else self.keys(Include, tree, "an include")
        file = values.get("file")
        if file is None or file.value is None:
            if isinstance(tree, Map) and not {part.key for part in tree} - (keys_of(Include).keys() - {"file"}):
                self.complain(tree.position, "an include names its file: {file: robot.yaml, args: {…}}")
            return None
        return Include(position=tree.position, **values)

    def topic(self, entry: Entry) -> TopicPromise:
        promise = part_of(TopicPlan).read(entry.value, "topic", self) or Map((), entry.value.position)
        return TopicPromise(name=entry.key, promise={e.key: e.value for e in promise}, position=entry.position)

    def params(self, tree: Tree) -> tuple[ParameterSource, ...]:
        """A file, a map of values, or a list of files and maps."""
        items = tree.items if isinstance(tree, Items) else (tree,)
        return tuple(source for item in items if (source := self._source(item)) is not None)

    def _source(self, tree: Tree) -> ParameterSource | None:
        if isinstance(tree, Scalar) and isinstance(tree.value, str):
            return ParameterSource(file=tree)
        if not isinstance(tree, Map):
            self.complain(tree.position, f"params: expected a file or a map of values, not {kind(tree)}")
            return None
        if tree.get("if") is None and tree.get("unless") is None:
            return ParameterSource(values=tree)
        # With a condition the values may stand beside it, or apart.
        own = Map(tuple(entry for entry in tree if entry.key in keys_of(ParameterSource)), tree.position)
        rest = tuple(entry for entry in tree if entry.key not in keys_of(ParameterSource))
        values = self.keys(ParameterSource, own, "params")
        apart = values.pop("values", ())
        return ParameterSource(values=Map((*apart, *rest), tree.position), **values)

    def variable(self, entry: Entry) -> Variable | None:
        what = f"env {entry.key}"
        if not entry.key or "=" in entry.key or "\0" in entry.key:
            self.complain(entry.position, f"{shown(what)} is no name of a variable")
            return None
        if not isinstance(entry.value, Map):
            value = single(entry.value, what, self.complain)
            return None if value is None else Variable(name=entry.key, value=value, position=entry.position)
        values = self.keys(Variable, entry.value, what)
        if "value" not in values:
            if not {part.key for part in entry.value} - {"if", "unless"}:
                self.complain(entry.value.position, f"{what}: add value: …")
            return None
        return Variable(name=entry.key, position=entry.position, **values)


def _with_args(include: Include, shared: tuple[Entry, ...]) -> Include:
    """An include that is given its group's arguments too; its own come first."""
    own = {entry.key for entry in include.args}
    args = (*(entry for entry in shared if entry.key not in own), *include.args)
    return msgspec.structs.replace(include, args=args)


def _has(tree: Tree, key: str) -> bool:
    """Whether a map holds something by this key."""
    value = tree.get(key) if isinstance(tree, Map) else None
    return value is not None and not (isinstance(value, Scalar) and value.value is None)


def _text(scalar: Scalar | None) -> str:
    return "" if scalar is None else str(scalar.value)


def _type_of(default: Scalar | None) -> ArgType:
    value = default.value if default is not None else None
    if isinstance(value, bool):
        return "bool"
    if isinstance(value, int):
        return "int"
    return "float" if isinstance(value, float) else "str"
