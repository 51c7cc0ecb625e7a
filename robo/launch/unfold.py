"""A manifest unfolded: its conditions decided, its loops unrolled, its includes followed, down to one process each.

All mistakes are collected; a part with a mistake is left out, or taken as if it were fine, so that the rest is checked
too.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path

import msgspec

from robo.errors import ManifestError, UnreadableFile
from robo.launch import arguments as args
from robo.launch.bridged import nodes_of
from robo.launch.draft import Draft, Place, draft, promise, within
from robo.launch.find import find_manifest
from robo.launch.forms import scalars
from robo.launch.language import keys_of
from robo.launch.layers import Layer, layer_of
from robo.launch.manifest import MOST_PROCESSES, Group, Include, Manifest, NodeEntry, Settings
from robo.launch.plan import TopicPlan
from robo.launch.reader import read
from robo.launch.substitution import Environment, Scope, Shared, known, told
from robo.launch.values import Files
from robo.text.brief import shown
from robo.text.files import read_text
from robo.text.suggestions import suggest
from robo.text.tree import Items, Map, Position, Problem, Scalar, Tree
from robo.wire import names

MOST_STEPS = 20_000
"""Groups, includes and nodes that a launch may unfold to, counted with their repetitions."""


class TooMuch(Exception):
    """A launch unfolds to more than any machine runs."""

    def __init__(self, position: Position, text: str) -> None:
        super().__init__(text)
        self.position = position


class _Override(msgspec.Struct, frozen=True):
    """What an include changes about the nodes of its file."""

    without: Mapping[str, Position]
    nodes: Mapping[str, NodeEntry]
    scope: Scope
    used: set[str]

    def changes(self, node: NodeEntry) -> bool:
        """Whether it says something of a node."""
        return node.key in self.nodes or node.key in self.without


class _Context(msgspec.Struct, frozen=True):
    """What groups and includes hand down."""

    place: Place
    layers: tuple[Layer, ...] = ()
    """Of the groups around, the outermost first."""
    overrides: tuple[_Override, ...] = ()
    """Inner ones first; the outermost has the last word."""


class Manifests:
    """The manifests of a launch, each read once."""

    def __init__(self, problems: list[Problem]) -> None:
        """
        Args:
            problems: takes the mistakes.
        """
        self._problems = problems
        self._manifests: dict[Path, Manifest | None] = {}

    def read(self, file: Path, asked: Position | None = None) -> Manifest | None:
        """A manifest; None where it cannot be read, which is a mistake at the place that asks for it."""
        if file not in self._manifests:
            self._manifests[file] = None
            try:
                text = read_text(file)
            except UnreadableFile as error:
                where = asked or Position(str(file), 1, 1)
                self._problems.append(Problem(where, f"manifest {file} cannot be read: {error}"))
                return None
            self._manifests[file] = read(text, file, self._problems)
        return self._manifests[file]

    def paths(self) -> list[str]:
        """All that were asked for."""
        return list(map(str, self._manifests))


class Unfolding:
    """What a manifest unfolds to, and the mistakes on the way."""

    def __init__(self, environment: Environment) -> None:
        """
        Args:
            environment: what variables of the environment are.
        """
        self.problems: list[Problem] = []
        self.drafts: list[Draft] = []
        self.topics: list[TopicPlan] = []
        self.groups: list[str] = []
        """The paths of all groups, those included that a condition leaves out."""
        self.left_out: set[str] = set()
        """The keys of nodes that do not run."""
        self.paths: list[args.PathArgument] = []
        """What the arguments of manifests name."""
        self.files = Files(self.problems)
        self.manifests = Manifests(self.problems)
        self._shared = Shared(environment)
        self._stack: list[Path] = []
        self._steps = 0

    def complain(self, position: Position, text: str) -> None:
        """Add a mistake."""
        self.problems.append(Problem(position, text))

    def arguments(self, manifest: Manifest, given: args.Given, *, stand_ins: bool = False) -> dict[str, object]:
        """The values of a manifest's arguments."""
        found = args.evaluate(manifest, given, self._scope(manifest, {}), self.complain, stand_ins=stand_ins)
        self.paths += args.paths(manifest, given, found)
        return found

    def unfold(self, manifest: Manifest, values: Mapping[str, object]) -> None:
        """All that a manifest starts with these values of its arguments."""
        try:
            self._manifest(manifest, values, _Context(Place(namespace="", group="", hosts=())))
        except TooMuch as error:
            self.complain(error.position, str(error))
        if self._shared.overflow is not None:
            self.problems.append(self._shared.overflow)

    def _scope(self, manifest: Manifest, values: Mapping[str, object]) -> Scope:
        return Scope(manifest.file, values, self._shared)

    def _step(self, position: Position) -> None:
        self._steps += 1
        if self._steps > MOST_STEPS:
            raise TooMuch(position, f"unfolds to more than {MOST_STEPS:,} groups, includes and nodes")

    # -- manifests, groups, includes ---------------------------------------------------------------

    def _manifest(self, manifest: Manifest, values: Mapping[str, object], context: _Context) -> None:
        self._stack.append(manifest.file.absolute())
        self._content(manifest, self._scope(manifest, values), context)
        self._stack.pop()

    def _content(self, part: Manifest | Group, scope: Scope, context: _Context) -> None:
        for include in part.includes:
            self._include(include, scope, context)
        for topic in part.topics:
            found = promise(topic, scope, context.place.namespace, self.complain)
            self.topics += [found] if found is not None else []
        for node in part.nodes if isinstance(part, Group) else ():
            self._node(node, scope, context)
        if part.bridges is not None:
            namespace = context.place.namespace or str(scope.values.get(args.ROBOT_NAME, args.DEFAULT_ROBOT))
            for node in nodes_of(part.bridges, namespace, scope, self.complain):
                self._node(node, scope, context)
        for group in part.groups:
            self._group(group, scope, context)

    def _group(self, group: Group, scope: Scope, context: _Context) -> None:
        path = names.join(context.place.group, group.key)
        if path not in self.groups:
            self.groups.append(path)
        inners = list(self._repeat(group, scope))
        if not inners:
            self._leave_out_group(group, scope, context)
        for inner in inners:
            self._step(group.position)
            if inner.holds(group, self.complain):
                self._content(group, inner, self._within(group, inner, context, path))
            else:
                self._check_names(group.tree, inner)
                self._leave_out_group(group, inner, context)

    def _within(self, group: Group, scope: Scope, context: _Context, path: str) -> _Context:
        layer = layer_of(group, scope, self.complain)
        hosts = self._texts(group.hosts, scope)
        place = Place(
            namespace=within(layer.namespace, context.place.namespace, self.complain),
            group=path,
            hosts=tuple(hosts) or context.place.hosts,
        )
        return msgspec.structs.replace(context, place=place, layers=(*context.layers, layer))

    def _texts(self, tree: Tree | None, scope: Scope) -> dict[str, Position]:
        """One text or several, with their places."""
        found = {}
        for one in scalars(tree) if tree is not None else ():
            text = known(scope.text(one), self.complain)
            if text is not None:
                found[text] = one.position
        return found

    def _include(self, include: Include, scope: Scope, context: _Context) -> None:
        self._step(include.position)
        holds = scope.holds(include, self.complain)
        name = known(scope.path(include.file), self.complain)
        if not name:
            return  # an argument that names no file
        position = include.file.position
        try:
            file = find_manifest(name, beside=scope.folder)
        except ManifestError as error:
            if holds:
                self.complain(position, str(error))
            return
        if not holds:
            self._leave_out_manifest(file, position, context)
            return
        if file.absolute() in self._stack:
            chain = " → ".join(path.name for path in (*self._stack, file))
            self.complain(position, f"include goes in a circle: {chain}")
            return
        manifest = self.manifests.read(file, position)
        if manifest is not None:
            self._included(include, manifest, scope, context)

    def _included(self, include: Include, manifest: Manifest, scope: Scope, context: _Context) -> None:
        found = self.arguments(manifest, self._given(include, scope))
        nodes = {node.key: node for node in include.override}
        override = _Override(self._texts(include.without, scope), nodes, scope, set())
        inner = context
        if include.namespace is not None:
            written = Scalar(scope.raw(include.namespace), include.namespace.position)
            place = context.place
            namespace = within(written, place.namespace, self.complain)
            inner = msgspec.structs.replace(context, place=msgspec.structs.replace(place, namespace=namespace))
        before = len(self.drafts)
        self._manifest(manifest, found, msgspec.structs.replace(inner, overrides=(override, *context.overrides)))
        keys = [one.key for one in self.drafts[before:]]
        changed = {**override.without, **{key: node.position for key, node in nodes.items()}}
        for key, where in changed.items():
            if key not in override.used:
                self.complain(where, f"{manifest.file.name} has no node {shown(key)}; {suggest(key, keys, 'it has')}")

    def _given(self, include: Include, scope: Scope) -> args.Given:
        given = {args.ROBOT_NAME: scope.values[args.ROBOT_NAME]}
        for name, _, value in include.args:
            if isinstance(value, Scalar):
                given[name] = told(scope.raw(value), self.complain)
        return args.Given(given, scope.folder, include.position, {e.key: e.position for e in include.args})

    def _repeat(self, settings: Settings, scope: Scope) -> Iterator[Scope]:
        """The scope of each repetition; the scope itself where there is no loop."""
        if settings.replicas is not None:
            form = keys_of(Group)["replicas"].form
            filled = form.fill(settings.replicas, "replicas", scope)
            count = form.value(filled, "replicas", self.complain)
            for index in range(1, (1 if count is None else count) + 1):
                yield scope.inner({"index": index})
        elif settings.for_each is not None:
            variable = settings.for_each.variable
            for index, item in enumerate(settings.for_each.items.items, 1):
                found = {"index": index, variable: told(scope.plain(item), self.complain)}
                for key, _, value in item if isinstance(item, Map) else ():
                    found[f"{variable}.{key}"] = told(scope.plain(value), self.complain)
                yield scope.inner(found)
        else:
            yield scope

    # -- nodes -------------------------------------------------------------------------------------

    def _node(self, node: NodeEntry, scope: Scope, context: _Context) -> None:
        if any(node.key in override.without for override in context.overrides):
            self._leave_out(node, context)
            return
        inners = list(self._repeat(node, scope))
        if not inners:
            self._leave_out(node, context)
        for inner in inners:
            self._step(node.position)
            if inner.holds(node, self.complain):
                self._draft(node, inner, context)
            else:
                self._check_names(node.tree, inner)
                self._leave_out(node, context)

    def _draft(self, node: NodeEntry, scope: Scope, context: _Context) -> None:
        index = scope.values["index"] if node.looped else None
        layers = [*context.layers, layer_of(node, scope, self.complain)]
        for override in context.overrides:
            changed = override.nodes.get(node.key)
            if changed is None:
                continue
            override.used.add(node.key)
            own = override.scope.inner({"index": index} if node.looped else {})
            if own.holds(changed, self.complain):
                layers.append(layer_of(changed, own, self.complain))
        name = f"{node.key}_{index}" if node.looped else node.key
        found = draft(node.key, name, layers, context.place, self.files, self.complain)
        if found is None:
            self.left_out.add(node.key)
            return
        self.drafts.append(found)
        if len(self.drafts) > MOST_PROCESSES:
            raise TooMuch(node.position, f"more than {MOST_PROCESSES:,} processes")

    # -- what a condition leaves out ---------------------------------------------------------------

    def _check_names(self, tree: Tree, scope: Scope) -> None:
        """A part that is not started is still refused where it uses a name that nothing defines."""
        inner = scope.inner(dict.fromkeys(["index", *_loop_names(tree)], ""))
        self.problems += inner.undefined(tree)

    def _leave_out_group(self, group: Group, scope: Scope, context: _Context) -> None:
        for include in group.includes:
            name = scope.path(include.file)
            if isinstance(name, str) and name:
                try:
                    self._leave_out_manifest(find_manifest(name, beside=scope.folder), include.position, context)
                except ManifestError:
                    continue  # it is looked for where it is needed
        for node in group.nodes:
            self._leave_out(node, context)
        for child in group.groups:
            self._leave_out_group(child, scope, context)

    def _leave_out_manifest(self, file: Path, position: Position, context: _Context) -> None:
        self._step(position)
        if file.absolute() in self._stack:
            return
        manifest = self.manifests.read(file, position)
        if manifest is None:
            return
        self._stack.append(file.absolute())
        for group in manifest.groups:
            self._leave_out_group(group, self._scope(manifest, {}), context)
        self._stack.pop()

    def _leave_out(self, node: NodeEntry, context: _Context) -> None:
        self.left_out.add(node.key)
        for override in context.overrides:
            if override.changes(node):
                override.used.add(node.key)


def _loop_names(tree: Tree) -> Iterator[str]:
    """The names that loops within a part define."""
    for child in tree if isinstance(tree, Map) else ():
        if child.key == "for_each" and isinstance(child.value, Map):
            for loop in child.value:
                yield loop.key
                for item in loop.value.items if isinstance(loop.value, Items) else ():
                    yield from (f"{loop.key}.{entry.key}" for entry in (item if isinstance(item, Map) else ()))
        yield from _loop_names(child.value)
