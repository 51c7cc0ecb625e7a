"""From the text of a manifest to the manifest: what each key may hold, and where it stands.

All mistakes of a file are collected; what they hit is left out, so that one mistake is one message.
"""

from collections.abc import Callable, Collection
from pathlib import Path
from typing import TypeVar, get_args

import msgspec

from robo.launch import language
from robo.launch.manifest import (
    Arg,
    ArgType,
    Condition,
    Group,
    Include,
    Log,
    Loop,
    Manifest,
    Need,
    Node,
    ParameterSource,
    Ready,
    Restart,
    Settings,
    Stop,
    Topic,
    Until,
    Variable,
)
from robo.text.brief import shown
from robo.text.suggestions import closest, hint, suggest
from robo.text.tree import Entry, Items, Map, Position, Problem, Scalar, Tree, kind
from robo.text.yaml_tree import parse
from robo.wire.names import is_word

T = TypeVar("T")
Parts = dict[str, Tree]

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
    parts = reader.fields(tree, "a manifest", language.MANIFEST)
    return Manifest(
        file=file,
        description=reader.text(parts, "description"),
        args=reader.named(parts, "args", reader.arg),
        includes=reader.includes(parts, ()),
        groups=reader.named(parts, "groups", reader.group),
        topics=reader.named(parts, "topics", reader.topic),
    )


class _Reader:
    def __init__(self, problems: list[Problem]) -> None:
        self._problems = problems

    def complain(self, position: Position, text: str) -> None:
        self._problems.append(Problem(position, text))

    # -- maps ------------------------------------------------------------------------------------

    def fields(self, tree: Map, what: str, known: Collection[str]) -> Parts:
        """The values of a map by key; unknown keys are mistakes, and a key without a value is not there."""
        for entry in tree:
            if entry.key not in known:
                instead = suggest(entry.key, sorted(known), "it may hold")
                self.complain(entry.position, f"unknown key {shown(entry.key)} in {what}; {instead}")
        return {entry.key: entry.value for entry in tree if entry.key in known and not _empty(entry.value)}

    def named(self, parts: Parts, key: str, read: Callable[[Entry], T | None]) -> tuple[T, ...]:
        """The parts of a map from names to whatever `read` makes of each."""
        return tuple(part for entry in self.entries(parts, key) if (part := read(entry)) is not None)

    def entries(self, parts: Parts, key: str) -> tuple[Entry, ...]:
        tree = parts.get(key)
        if tree is None or isinstance(tree, Map):
            return tree.entries if tree is not None else ()
        self.complain(tree.position, f"{key}: expected a map, not {kind(tree)}")
        return ()

    def texts(self, parts: Parts, key: str) -> tuple[Entry, ...]:
        """A map from names to single values."""
        entries = self.entries(parts, key)
        return tuple(entry for entry in entries if self.single(entry.value, f"{key} {entry.key}") is not None)

    # -- values ----------------------------------------------------------------------------------

    def single(self, tree: Tree | None, what: str) -> Scalar | None:
        if tree is None or isinstance(tree, Scalar):
            return tree
        self.complain(tree.position, f"{what}: expected a single value, not {kind(tree)}")
        return None

    def scalar(self, parts: Parts, key: str) -> Scalar | None:
        return self.single(parts.get(key), key)

    def text(self, parts: Parts, key: str) -> str:
        scalar = self.scalar(parts, key)
        return "" if scalar is None else str(scalar.value)

    def words(self, parts: Parts, key: str) -> Scalar | Items | None:
        """One text, or a list of single values."""
        tree = parts.get(key)
        if isinstance(tree, Map) or (isinstance(tree, Items) and not tree.items):
            self.complain(tree.position, f"{key}: expected a text or a list of words, not {kind(tree)}")
            return None
        for item in tree.items if isinstance(tree, Items) else ():
            if self.single(item, key) is None:
                return None
        return tree

    def scalars(self, parts: Parts, key: str) -> tuple[Scalar, ...]:
        """One value or several."""
        tree = self.words(parts, key)
        items = tree.items if isinstance(tree, Items) else () if tree is None else (tree,)
        return tuple(item for item in items if isinstance(item, Scalar))

    def one_of(self, parts: Parts, key: str, values: Collection[str]) -> Scalar | None:
        """A word of a set, or a substitution that will give one."""
        scalar = self.scalar(parts, key)
        return scalar if scalar is None or self._is_one_of(scalar, key, values) else None

    def _is_one_of(self, scalar: Scalar, key: str, values: Collection[str]) -> bool:
        if scalar.value in values or _is_substituted(scalar):
            return True
        instead = hint(str(scalar.value), values, f"; use {_either(values)}")
        self.complain(scalar.position, f"{key}: {shown(scalar.value)} is not known{instead}")
        return False

    def condition(self, parts: Parts) -> Condition:
        return Condition(self.scalar(parts, "if"), self.scalar(parts, "unless"))

    # -- the parts of a manifest -----------------------------------------------------------------

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
            parts: Parts = {} if entry.value.value is None else {"default": entry.value}
        else:
            parts = self.fields(entry.value, what, language.ARG)
        default = self.scalar(parts, "default")
        required = self.scalar(parts, "required")
        if required is not None and required.value is not (default is None):
            said = "has a default" if default is not None else "has no default, so it has to be given"
            self.complain(required.position, f"{what} {said}: required: {kind(required).lower()} contradicts that")
        given = self.one_of(parts, "type", language.ARG_TYPES)
        exists = self.scalar(parts, "exists")
        if exists is not None and not isinstance(exists.value, bool):
            self.complain(exists.position, f"{what}: exists is true or false, not {exists.value!r}")
        choices = self.scalars(parts, "choices")
        if given is not None and given.value in get_args(ArgType):
            type_ = msgspec.convert(given.value, ArgType)
        else:
            type_ = "choice" if choices else _type_of(default)
        if type_ == "choice" and not choices and "choices" not in parts:
            self.complain(entry.position, f"{what} is a choice; add choices: [a, b]")
        return Arg(
            name=entry.key,
            type=type_,
            default=default,
            exists=exists is None or exists.value is not False,
            choices=choices,
            description=self.text(parts, "description"),
            position=entry.position,
        )

    def settings(self, parts: Parts) -> Settings:
        return Settings(
            namespace=self.scalar(parts, "namespace"),
            params=self.params(parts),
            remap=self.texts(parts, "remap"),
            env=self.named(parts, "env", self.variable),
            restart=self.restart(parts),
            log=self.log(parts),
            loop=self.loop(parts),
            condition=self.condition(parts),
        )

    def group(self, entry: Entry) -> Group | None:
        what = f"group {shown(entry.key)}"
        self.check_word(entry, "group")
        tree = self.map_of(entry, what)
        if tree is None:
            return None
        parts = self.fields(tree, what, language.GROUP)
        if "args" in parts and "include" not in parts:
            self.complain(parts["args"].position, f"{what} has args but no include that takes them")
        if not {"include", "nodes", "groups", "topics"} & {part.key for part in tree}:
            self.complain(entry.position, f"{what} starts nothing; give it nodes, groups or an include")
        return Group(
            key=entry.key,
            settings=self.settings(parts),
            includes=self.includes(parts, self.entries(parts, "args")),
            nodes=self.named(parts, "nodes", self.node),
            groups=self.named(parts, "groups", self.group),
            hosts=self.scalars(parts, "hosts"),
            topics=self.named(parts, "topics", self.topic),
            tree=tree,
            position=entry.position,
        )

    def node(self, entry: Entry) -> Node | None:
        what = f"node {shown(entry.key)}"
        tree = self.map_of(entry, f"{what}, which has a service or a run")
        if tree is None:  # others may need it: it is there, though nothing is known of it
            return self._node(entry, Map((), entry.value.position), {})
        parts = self.fields(tree, what, language.NODE)
        keys = {part.key for part in tree}
        if not keys & {"service", "run"}:
            close = [k for k in keys if closest(k, ("service", "run"))]
            if not close:  # else the misspelt key has been named already
                text = "has no service and no run; name a node class, package.module, or give a command"
                self.complain(entry.position, f"{what} {text}")
        elif {"service", "run"} <= keys:
            self.complain(parts.get("run", tree).position, f"{what} has both a service and a run; keep one")
        return self._node(entry, tree, parts)

    def override(self, entry: Entry) -> Node | None:
        """What is different about a node of an included manifest."""
        what = f"override of {shown(entry.key)}"
        tree = self.map_of(entry, what)
        return None if tree is None else self._node(entry, tree, self.fields(tree, what, language.NODE))

    def _node(self, entry: Entry, tree: Map, parts: Parts) -> Node:
        return Node(
            key=entry.key,
            settings=self.settings(parts),
            service=self.scalar(parts, "service"),
            run=self.words(parts, "run"),
            name=self.scalar(parts, "name"),
            args=self.words(parts, "args"),
            cwd=self.scalar(parts, "cwd"),
            prefix=self.words(parts, "prefix"),
            needs=self.needs(parts),
            ready=self.ready(parts),
            watchdog=self.scalar(parts, "watchdog"),
            required=self.scalar(parts, "required"),
            stop=self.stop(parts),
            priority=self.scalar(parts, "priority"),
            cpus=self.words(parts, "cpus"),
            publishes=self.texts(parts, "publishes"),
            subscribes=self.texts(parts, "subscribes"),
            tree=tree,
            position=entry.position,
        )

    def includes(self, parts: Parts, shared_args: tuple[Entry, ...]) -> tuple[Include, ...]:
        """`include: file`, `include: {file: …, args: …}`, or a list of these."""
        tree = parts.get("include")
        items = tree.items if isinstance(tree, Items) else () if tree is None else (tree,)
        return tuple(found for item in items if (found := self._include(item, shared_args)) is not None)

    def _include(self, tree: Tree, shared_args: tuple[Entry, ...]) -> Include | None:
        if isinstance(tree, Items):
            self.complain(tree.position, f"include: expected a file or a map, not {kind(tree)}")
            return None
        parts: Parts = {"file": tree} if isinstance(tree, Scalar) else self.fields(tree, "an include", language.INCLUDE)
        file = self.scalar(parts, "file")
        if file is None or file.value is None:
            if isinstance(tree, Map) and not {part.key for part in tree} - (language.INCLUDE.keys() - {"file"}):
                self.complain(tree.position, "an include names its file: {file: robot.yaml, args: {…}}")
            return None
        own = self.texts(parts, "args")
        return Include(
            file=file,
            args=(*(e for e in shared_args if e.key not in {o.key for o in own}), *own),
            namespace=self.scalar(parts, "namespace"),
            without=self.scalars(parts, "without"),
            override=self.named(parts, "override", self.override),
            condition=self.condition(parts),
            position=tree.position,
        )

    def topic(self, entry: Entry) -> Topic:
        parts = self._short({"topic": entry.value}, "topic", "type", language.TOPIC)
        return Topic(
            name=entry.key,
            type=self.scalar(parts, "type"),
            rate=self.scalar(parts, "rate"),
            max_age=self.scalar(parts, "max_age"),
            external=self.scalar(parts, "external"),
            position=entry.position,
        )

    def params(self, parts: Parts) -> tuple[ParameterSource, ...]:
        """A file, a map of values, or a list of files and maps."""
        tree = parts.get("params")
        items = tree.items if isinstance(tree, Items) else () if tree is None else (tree,)
        return tuple(source for item in items if (source := self._source(item)) is not None)

    def _source(self, tree: Tree) -> ParameterSource | None:
        if isinstance(tree, Scalar) and isinstance(tree.value, str):
            return ParameterSource(file=tree, values=None, condition=Condition())
        if not isinstance(tree, Map):
            self.complain(tree.position, f"params: expected a file or a map of values, not {kind(tree)}")
            return None
        if tree.get("if") is None and tree.get("unless") is None:
            return ParameterSource(file=None, values=tree, condition=Condition())
        # With a condition the values may stand beside it, or apart.
        known = {entry.key: entry.value for entry in tree if entry.key in language.PARAMS_ITEM}
        rest = tuple(entry for entry in tree if entry.key not in language.PARAMS_ITEM)
        values = self.entries(known, "values")
        return ParameterSource(
            file=self.scalar(known, "file"),
            values=Map((*values, *rest), tree.position),
            condition=self.condition(known),
        )

    def variable(self, entry: Entry) -> Variable | None:
        what = f"env {entry.key}"
        if not entry.key or "=" in entry.key or "\0" in entry.key:
            self.complain(entry.position, f"{shown(what)} is no name of a variable")
            return None
        if not isinstance(entry.value, Map):
            value = self.single(entry.value, what)
            return None if value is None else Variable(entry.key, value, Condition(), entry.position)
        parts = self.fields(entry.value, what, language.VARIABLE)
        value = self.scalar(parts, "value")
        if value is None:
            if not {part.key for part in entry.value} - {"if", "unless"}:
                self.complain(entry.value.position, f"{what}: add value: …")
            return None
        return Variable(entry.key, value, self.condition(parts), entry.position)

    def loop(self, parts: Parts) -> Loop | None:
        count = self.scalar(parts, "replicas")
        each = self.entries(parts, "for_each")
        if "for_each" not in parts:
            return None if count is None else Loop(count, "", None)
        if count is not None:
            self.complain(parts["for_each"].position, "replicas and for_each exclude each other; keep one")
            return None
        if len(each) != 1:
            if isinstance(parts["for_each"], Map):
                self.complain(
                    parts["for_each"].position, "for_each: expected one name with its list: {robot: [r1, r2]}"
                )
            return None
        variable, items = each[0].key, each[0].value
        if not is_word(variable) or variable in RESERVED:
            self.complain(each[0].position, f"for_each: {shown(variable)} cannot be a name for its items")
            return None
        if not isinstance(items, Items):
            self.complain(items.position, f"for_each {variable}: expected a list, not {kind(items)}")
            return None
        return Loop(None, variable, items)

    def needs(self, parts: Parts) -> tuple[Need, ...] | None:
        """`needs: {position_tracker: ready}`, a list of names, or one name."""
        tree = parts.get("needs")
        if tree is None:
            return None
        if not isinstance(tree, Map):
            return tuple(Need(name, "ready") for name in self.scalars(parts, "needs"))
        found = []
        for entry in tree:
            until: Until = "ready"
            scalar = self.single(entry.value, f"needs {entry.key}")
            if scalar is not None and self._is_one_of(scalar, f"needs {entry.key}", language.NEEDS):
                until = msgspec.convert(scalar.value, Until) if scalar.value in language.NEEDS else until
            found.append(Need(Scalar(entry.key, entry.position), until))
        return tuple(found)

    def ready(self, parts: Parts) -> Ready | None:
        tree = parts.get("ready")
        if isinstance(tree, Map):
            inner = self.fields(tree, "ready", language.READY)
            return Ready(
                when=self.one_of(inner, "when", language.READY_WHEN),
                log=self.scalar(inner, "log"),
                port=self.scalar(inner, "port"),
                probe=self.words(inner, "probe"),
                topics=self.scalars(inner, "topics"),
                timeout=self.scalar(inner, "timeout"),
            )
        when = self.one_of(parts, "ready", language.READY_WHEN)
        return None if when is None else Ready(when=when)

    def restart(self, parts: Parts) -> Restart:
        inner = self._short(parts, "restart", "policy", language.RESTART)
        numbers = ("delay", "backoff", "max_delay", "jitter", "max", "window", "reset_after", "propagate")
        return Restart(
            policy=self.one_of(inner, "policy", language.RESTART_POLICIES),
            **{key: self.scalar(inner, key) for key in numbers},
        )

    def stop(self, parts: Parts) -> Stop:
        inner = self._short(parts, "stop", "signal", language.STOP)
        return Stop(self.scalar(inner, "signal"), self.scalar(inner, "timeout"))

    def log(self, parts: Parts) -> Log:
        tree = parts.get("log")
        if isinstance(tree, Scalar):
            if not self._is_one_of(tree, "log", (*language.LOG_LEVELS, *language.LOG_OUTPUTS)):
                return Log()
            return Log(level=tree) if tree.value in language.LOG_LEVELS else Log(output=tree)
        inner = self._short(parts, "log", "output", language.LOG)
        return Log(
            self.one_of(inner, "level", language.LOG_LEVELS),
            self.one_of(inner, "output", language.LOG_OUTPUTS),
        )

    def _short(self, parts: Parts, key: str, main: str, known: Collection[str]) -> Parts:
        """A map, or its most important value alone."""
        tree = parts.get(key)
        if isinstance(tree, Map):
            return self.fields(tree, key, known)
        if isinstance(tree, Items):
            self.complain(tree.position, f"{key}: expected a value or a map, not a list")
            return {}
        return {} if tree is None else {main: tree}

    # -- names -----------------------------------------------------------------------------------

    def map_of(self, entry: Entry, what: str) -> Map | None:
        if isinstance(entry.value, Map):
            return entry.value
        self.complain(entry.value.position, f"{what}: expected a map, not {kind(entry.value)}")
        return None

    def check_word(self, entry: Entry, what: str) -> None:
        if not is_word(entry.key.replace("-", "_")):
            self.complain(
                entry.position, f"{what} {shown(entry.key)}: use letters, digits, _ and -, not starting with a digit"
            )


def _empty(tree: Tree) -> bool:
    return isinstance(tree, Scalar) and tree.value is None


def _is_substituted(scalar: Scalar) -> bool:
    return isinstance(scalar.value, str) and "${" in scalar.value


def _either(values: Collection[str]) -> str:
    *others, last = values
    return f"{', '.join(others)} or {last}" if others else last


def _type_of(default: Scalar | None) -> ArgType:
    value = default.value if default is not None else None
    if isinstance(value, bool):
        return "bool"
    if isinstance(value, int):
        return "int"
    return "float" if isinstance(value, float) else "str"
