"""From a manifest and arguments to a plan: conditions decided, loops unrolled, includes followed.

Nothing is started and no network is touched. All mistakes are collected; a part with a mistake is
left out, or taken as if it were fine, so that the rest is checked too.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from robo.errors import InvalidName, ManifestError, UnreadableFile
from robo.launch import arguments as args
from robo.launch import contracts, needs, values
from robo.launch.contracts import Answer
from robo.launch.faults import ManifestFaults, in_order
from robo.launch.find import find_manifest, manifest_meant
from robo.launch.language import GROUP, MOST_PROCESSES
from robo.launch.manifest import Group, Include, Log, Loop, Manifest, Node, Restart, Topic
from robo.launch.parts import Layer, Origin, Parts
from robo.launch.plan import Plan, ProcessPlan, TopicPlan
from robo.launch.reader import read
from robo.launch.substitution import BROKEN, Environment, Scope, Shared, of_process
from robo.launch.values import Assignment, Checked, Files, Mention, Said
from robo.parameters.files import ParameterEntry
from robo.text.brief import shown
from robo.text.files import read_text
from robo.text.suggestions import suggest
from robo.text.tree import Entry, Items, Map, Position, Problem, Scalar, Tree
from robo.wire import names

MOST_STEPS = 20_000
"""Groups, includes and nodes that a launch may unfold to, counted with their repetitions."""


class Resolution(msgspec.Struct, frozen=True, kw_only=True):
    """What came of a manifest."""

    plan: Plan
    problems: tuple[Problem, ...]
    """Mistakes; a plan with any is not to be started."""
    loose: tuple[Problem, ...]
    """What is said and reaches nobody."""
    warnings: tuple[Problem, ...]
    """Where parameter files contradict themselves."""
    contracts: dict[str, contracts.NodeContract]
    """By full name, what a node's class promises, where that is known."""
    positions: dict[str, Position]
    """By full name, where the node is written."""
    remaps: dict[str, dict[str, Origin]]
    """By full name and left side, where a remapping is written."""
    unmatched: tuple[ParameterEntry, ...]
    """Entries of parameter files that mean no node."""
    paths: tuple[args.PathArgument, ...]
    """What paths the arguments of the manifest and of its includes name."""
    stood_in: tuple[str, ...]
    """Arguments that have to be given and were not."""


def load(
    file: Path,
    arguments: Mapping[str, object],
    *,
    robot: str | None = None,
    groups: Collection[str] = (),
    parameters: Sequence[Assignment] = (),
    host: str | None = None,
) -> Plan:
    """Read a manifest and work out what it starts.

    Args:
        file: the manifest.
        arguments: values for its args; relative paths among them count from the current folder.
        robot: the value of `robot_name`.
        groups: start only these groups; all where empty.
        parameters: values that come before all others.
        host: start only what runs on this host; all where None.

    Raises:
        ManifestFaults: the manifest, its includes or its parameter files have mistakes; has all.
    """
    found = resolve(file, arguments, robot=robot, groups=groups, parameters=parameters, host=host)
    if found.problems:
        raise ManifestFaults(found.problems)
    return found.plan


def resolve(
    file: Path,
    arguments: Mapping[str, object],
    *,
    robot: str | None = None,
    groups: Collection[str] = (),
    parameters: Sequence[Assignment] = (),
    host: str | None = None,
    stand_ins: bool = False,
    environment: Environment = of_process,
) -> Resolution:
    """Like `load`, with the mistakes beside a plan of what could be understood.

    Args:
        file, arguments, robot, groups, parameters, host: as for `load`.
        stand_ins: an argument that has to be given and is not gets a value of its type.
        environment: what variables of the environment are.
    """
    walk = _Walk(environment)
    given = dict(arguments) | ({} if robot is None else {args.ROBOT_NAME: robot})
    manifest = walk.read(file, None)
    found: dict[str, object] = {args.ROBOT_NAME: given.get(args.ROBOT_NAME, args.DEFAULT_ROBOT)}
    if manifest is not None:
        scope = walk.scope(manifest)
        said = args.Given(given, Path.cwd(), args.COMMAND_LINE)
        found = args.evaluate(manifest, said, scope, stand_ins=stand_ins)
        walk.paths += args.paths(manifest, said, found)
        try:
            walk.manifest(manifest, scope.inner(found), _Context())
        except _TooMuch as error:
            walk.complain(error.position, str(error))
    absent = args.missing(manifest, given) if manifest is not None else []
    return walk.finish(manifest, file, found, absent, groups, parameters, host)


class _TooMuch(Exception):
    def __init__(self, position: Position, text: str) -> None:
        super().__init__(text)
        self.position = position


class _Override(msgspec.Struct, frozen=True):
    """What an include changes about the nodes of its file."""

    without: Mapping[str, Position]
    nodes: Mapping[str, Node]
    scope: Scope
    used: set[str]


class _Context(msgspec.Struct, frozen=True):
    """What groups and includes hand down."""

    namespace: str = ""
    group: str = ""
    hosts: tuple[str, ...] = ()
    params: tuple[Said, ...] = ()
    remap: tuple[tuple[Entry, Scope], ...] = ()
    env: tuple[tuple[Any, Scope], ...] = ()
    restart: tuple[tuple[Restart, Scope], ...] = ()
    log: tuple[tuple[Log, Scope], ...] = ()
    overrides: tuple[_Override, ...] = ()
    """Inner ones first; the outermost has the last word."""


class _Draft(msgspec.Struct, frozen=True):
    """A process but for what can only be known when all are."""

    plan: ProcessPlan
    key: str
    position: Position
    service_at: Position
    remap_at: dict[str, Origin]
    mentions: dict[str, list[Mention]]
    needs: tuple[needs.Asked, ...]


class _Walk:
    def __init__(self, environment: Environment) -> None:
        self.problems: list[Problem] = []
        self.paths: list[args.PathArgument] = []
        self._manifests: dict[Path, Manifest | None] = {}
        self._shared = Shared(environment)
        self._files = Files(self.problems)
        self._drafts: list[_Draft] = []
        self._topics: list[TopicPlan] = []
        self._groups: list[str] = []
        self._left_out: set[str] = set()
        self._stack: list[Path] = []
        self._steps = 0

    def complain(self, position: Position, text: str) -> None:
        self.problems.append(Problem(position, text))

    def scope(self, manifest: Manifest) -> Scope:
        return Scope(manifest.file, {}, self.problems, self._shared)

    def read(self, file: Path, asked: Position | None) -> Manifest | None:
        if file not in self._manifests:
            self._manifests[file] = None
            try:
                text = read_text(file)
            except UnreadableFile as error:
                self.complain(asked or Position(str(file), 1, 1), f"manifest {file} cannot be read: {error}")
                return None
            self._manifests[file] = read(text, file, self.problems)
        return self._manifests[file]

    def _step(self, position: Position) -> None:
        self._steps += 1
        if self._steps > MOST_STEPS:
            raise _TooMuch(position, f"unfolds to more than {MOST_STEPS:,} groups, includes and nodes")

    # -- manifests, groups, includes ---------------------------------------------------------------

    def manifest(self, manifest: Manifest, scope: Scope, context: _Context) -> None:
        """Add what a manifest starts."""
        self._stack.append(manifest.file.absolute())
        for include in manifest.includes:
            self._include(include, scope, context)
        for topic in manifest.topics:
            self._topic(topic, scope, context)
        for group in manifest.groups:
            self._group(group, scope, context)
        self._stack.pop()

    def _group(self, group: Group, scope: Scope, context: _Context) -> None:
        path = names.join(context.group, group.key)
        if path not in self._groups:
            self._groups.append(path)
        inners = list(self._repeat(group.settings.loop, scope))
        if not inners:
            self._leave_out_group(group, scope, context)
        for inner in inners:
            self._step(group.position)
            if not inner.holds(group.settings.condition):
                self._check_names(group.tree, inner)
                self._leave_out_group(group, inner, context)
                continue
            own = self._within(group, inner, context, path)
            for include in group.includes:
                self._include(include, inner, own)
            for topic in group.topics:
                self._topic(topic, inner, own)
            for node in group.nodes:
                self._node(node, inner, own)
            for child in group.groups:
                self._group(child, inner, own)

    def _within(self, group: Group, scope: Scope, context: _Context, path: str) -> _Context:
        settings = group.settings
        return msgspec.structs.replace(
            context,
            namespace=self._namespace(settings.namespace, scope, context.namespace),
            group=path,
            hosts=tuple(str(scope.text(host)) for host in group.hosts) or context.hosts,
            params=(*context.params, *(Said(source, scope, True) for source in settings.params)),
            remap=(*context.remap, *((entry, scope) for entry in settings.remap)),
            env=(*context.env, *((variable, scope) for variable in settings.env)),
            restart=(*context.restart, (settings.restart, scope)),
            log=(*context.log, (settings.log, scope)),
        )

    def _include(self, include: Include, scope: Scope, context: _Context) -> None:
        self._step(include.position)
        holds = scope.holds(include.condition)
        name = scope.path(include.file)
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
        manifest = self.read(file, position)
        if manifest is None:
            return
        own = self.scope(manifest)
        given = self._given(include, scope)
        found = args.evaluate(manifest, given, own)
        self.paths += args.paths(manifest, given, found)
        override = _Override(
            {str(scope.text(name)): name.position for name in include.without},
            {node.key: node for node in include.override},
            scope,
            set(),
        )
        inner = msgspec.structs.replace(
            context,
            namespace=self._namespace(include.namespace, scope, context.namespace),
            overrides=(override, *context.overrides),
        )
        known = len(self._drafts)
        self.manifest(manifest, own.inner(found), inner)
        keys = [draft.key for draft in self._drafts[known:]]
        changed = {**override.without, **{key: node.position for key, node in override.nodes.items()}}
        for key, place in changed.items():
            if key not in override.used:
                self.complain(place, f"{file.name} has no node {shown(key)}; {suggest(key, keys, 'it has')}")

    def _given(self, include: Include, scope: Scope) -> args.Given:
        given = {args.ROBOT_NAME: scope.values[args.ROBOT_NAME]}
        given |= {e.key: scope.raw(e.value) for e in include.args if isinstance(e.value, Scalar)}
        return args.Given(given, scope.folder, include.position, {e.key: e.position for e in include.args})

    def _repeat(self, loop: Loop | None, scope: Scope) -> Iterator[Scope]:
        """The scope of each repetition; the scope itself where there is no loop."""
        if loop is None:
            yield scope
        elif loop.count is not None:
            count = Parts([], self.problems).number(loop.count, scope, GROUP, "replicas")
            count = 1 if count is None else count
            for index in range(1, count + 1):
                yield scope.inner({"index": index})
        else:
            for index, item in enumerate(loop.items.items if loop.items is not None else (), 1):
                found = {"index": index, loop.variable: scope.plain(item)}
                if isinstance(item, Map):
                    found |= {f"{loop.variable}.{entry.key}": scope.plain(entry.value) for entry in item}
                yield scope.inner(found)

    # -- what a condition leaves out ---------------------------------------------------------------

    def _check_names(self, tree: Tree, scope: Scope) -> None:
        """A part that is not started is still refused where it uses a name that nothing defines."""
        scope.inner(dict.fromkeys(["index", *_loop_names(tree)], "")).check_names(tree)

    def _leave_out_group(self, group: Group, scope: Scope, context: _Context) -> None:
        for include in group.includes:
            quiet = Scope(scope.file, scope.values, [], Shared(self._shared.environment))
            name = quiet.path(include.file)
            if name:
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
        manifest = self.read(file, position)
        if manifest is None:
            return
        self._stack.append(file.absolute())
        for group in manifest.groups:
            self._leave_out_group(group, self.scope(manifest), context)
        self._stack.pop()

    def _leave_out(self, node: Node, context: _Context) -> None:
        self._left_out.add(node.key)
        for override in context.overrides:
            if node.key in override.nodes or node.key in override.without:
                override.used.add(node.key)

    # -- nodes -------------------------------------------------------------------------------------

    def _node(self, node: Node, scope: Scope, context: _Context) -> None:
        for override in context.overrides:
            if node.key in override.without:
                self._leave_out(node, context)
                return
        loop = node.settings.loop
        inners = list(self._repeat(loop, scope))
        if not inners:
            self._leave_out(node, context)
        for inner in inners:
            self._step(node.position)
            if not inner.holds(node.settings.condition):
                self._check_names(node.tree, inner)
                self._leave_out(node, context)
                continue
            layers = [Layer(node, inner)]
            for override in context.overrides:
                changed = override.nodes.get(node.key)
                if changed is None:
                    continue
                override.used.add(node.key)
                own = override.scope.inner({"index": inner.values["index"]} if loop is not None else {})
                if own.holds(changed.settings.condition):
                    layers.append(Layer(changed, own))
            suffix = f"_{inner.values['index']}" if loop is not None else ""
            self._draft(node, layers, f"{node.key}{suffix}", context)

    def _draft(self, node: Node, layers: Sequence[Layer], default_name: str, context: _Context) -> None:
        parts = Parts(layers, self.problems)
        name = parts.name(default_name)
        if name is None:
            self._left_out.add(node.key)
            return
        place = parts.last(lambda layer: layer.settings.namespace)
        namespace = self._namespace(place[0], place[1], context.namespace) if place else context.namespace
        said = [*context.params, *(Said(s, layer.scope, False) for layer in layers for s in layer.node.settings.params)]
        remap = parts.remap(context.remap, namespace, name)
        env = parts.env(context.env)
        service, service_at = parts.service() or (None, node.position)
        plan = ProcessPlan(
            name=name,
            namespace=namespace,
            group=context.group,
            hosts=context.hosts,
            service=service,
            run=parts.run(),
            prefix=parts.words("prefix"),
            args=parts.words("args"),
            cwd=parts.cwd(),
            settings={},
            remap={old: new for old, (new, _) in remap.items()},
            env={variable: value for variable, (value, _) in env.items()},
            needs={},
            required=parts.required(),
            restart=parts.restart(context.restart),
            stop=parts.stop(),
            ready=parts.ready(service, namespace, {old: new for old, (new, _) in remap.items()}),
            watchdog=parts.watchdog(service),
            log=parts.log(context.log),
            priority=parts.priority(),
            cpus=parts.cpus(),
            publishes=parts.endpoints("publishes"),
            subscribes=parts.endpoints("subscribes"),
            sources={
                "remap": {old: origin.position for old, (_, origin) in remap.items()},
                "env": {variable: position for variable, (_, position) in env.items()},
            },
            source=node.position,
        )
        mentions, read = values.gather(said, namespace, name, self._files)
        plan = msgspec.structs.replace(plan, parameter_files=read)
        needed = parts.last(lambda layer: layer.node.needs)
        asked = [needs.Asked(need.node, need.until, needed[1]) for need in needed[0]] if needed else []
        remap_at = {old: origin for old, (_, origin) in remap.items()}
        self._drafts.append(_Draft(plan, node.key, node.position, service_at, remap_at, mentions, tuple(asked)))
        if len(self._drafts) > MOST_PROCESSES:
            raise _TooMuch(node.position, f"more than {MOST_PROCESSES:,} processes")

    def _topic(self, topic: Topic, scope: Scope, context: _Context) -> None:
        found = Parts([], self.problems).topic(topic, scope, context.namespace)
        if found is not None:
            self._topics.append(found)

    def _namespace(self, scalar: Scalar | None, scope: Scope, outer: str) -> str:
        """A namespace within the outer one; one that begins with / is in no other."""
        text = scope.text(scalar) if scalar is not None else None
        if text is None or scalar is None:
            return outer
        try:
            inner = names.normalize_namespace(text)
        except InvalidName as error:
            self.complain(scalar.position, str(error))
            return outer
        return inner if text.startswith("/") else names.join(outer, inner)

    # -- when all nodes are known --------------------------------------------------------------------

    def finish(
        self,
        manifest: Manifest | None,
        file: Path,
        found: Mapping[str, object],
        absent: Sequence[str],
        groups: Collection[str],
        parameters: Sequence[Assignment],
        host: str | None,
    ) -> Resolution:
        drafts = self._unique()
        self._check_groups(groups, file)
        self._check_host(host, file, drafts)
        waiting = [needs.Waiting(d.plan.full_name, d.plan.namespace, d.needs) for d in drafts]
        by_key: dict[tuple[str, str], list[str]] = {}
        for draft in drafts:
            by_key.setdefault((draft.plan.namespace, draft.key), []).append(draft.plan.full_name)
        resolved = needs.resolve(waiting, by_key, self._left_out, self.problems)
        values.assign(parameters, [(d.plan.name, d.plan.full_name, d.mentions) for d in drafts], self.problems)
        answers = self._ask(drafts)
        loose: list[Problem] = []
        pairs = list(zip(drafts, answers, strict=True))
        checked = [Checked(draft.plan.full_name, draft.mentions, answer) for draft, answer in pairs]
        found_values = values.check(checked, self.problems, loose)
        processes = [
            msgspec.structs.replace(draft.plan, settings=settings, needs=resolved[draft.plan.full_name])
            for draft, settings in zip(drafts, found_values, strict=True)
        ]
        return Resolution(
            plan=Plan(
                manifest=str(file),
                description=manifest.description if manifest is not None else "",
                robot=str(found[args.ROBOT_NAME]),
                arguments={name: value for name, value in found.items() if value is not BROKEN},
                host=host or "",
                processes=_chosen(processes, groups, host),
                topics=tuple(self._topics),
                files=tuple(dict.fromkeys([str(file), *map(str, self._manifests), *self._files.paths()])),
            ),
            problems=in_order(self.problems),
            loose=in_order(loose),
            warnings=in_order(self._files.warnings()),
            contracts={
                d.plan.full_name: answer.contract
                for d, answer in pairs
                if answer is not None and answer.contract is not None
            },
            positions={d.plan.full_name: d.position for d in drafts},
            remaps={d.plan.full_name: d.remap_at for d in drafts},
            unmatched=tuple(self._files.unmatched()),
            paths=tuple(self.paths),
            stood_in=tuple(absent),
        )

    def _unique(self) -> list[_Draft]:
        """The drafts without those whose name is taken."""
        kept: dict[str, _Draft] = {}
        for draft in self._drafts:
            first = kept.setdefault(draft.plan.full_name, draft)
            if first is not draft:
                again = first.position == draft.position
                hint = "; put ${index} into its name or namespace" if again else ""
                self.complain(draft.position, f"node {draft.plan.full_name} is already in {first.position}{hint}")
        return list(kept.values())

    def _check_host(self, host: str | None, file: Path, drafts: Sequence[_Draft]) -> None:
        """Where a robot has several hosts, every process says on which it runs."""
        known = list(dict.fromkeys(name for draft in drafts for name in draft.plan.hosts))
        if host is not None and host not in known:
            self.complain(Position(str(file), 1, 1), f"there is no host {shown(host)} in it; {suggest(host, known)}")
        for draft in drafts if known else ():
            if not draft.plan.hosts:
                text = f"{draft.plan.full_name} is on no host, and others are: say hosts: {known[0]} in its group"
                self.complain(draft.position, text)

    def _check_groups(self, groups: Collection[str], file: Path) -> None:
        for name in groups:
            if not any(_in_group(path, name) for path in self._groups):
                meant = manifest_meant(name)
                instead = f"did you mean {meant}?" if meant is not None else suggest(name, self._groups, "it has")
                self.complain(args.COMMAND_LINE, f"{file.name} has no group {shown(name)}; {instead}")

    def _ask(self, drafts: Sequence[_Draft]) -> list[Answer | None]:
        """What the node classes say; None for a command."""
        services = [draft for draft in drafts if draft.plan.service is not None]
        questions = [
            contracts.Question(str(draft.plan.service), values.as_question(draft.mentions)) for draft in services
        ]
        answers = dict(zip([d.plan.full_name for d in services], contracts.examine_apart(questions), strict=True))
        for draft in services:
            error = answers[draft.plan.full_name].error
            if error is not None:
                self.complain(draft.service_at, error)
        return [answers.get(draft.plan.full_name) for draft in drafts]


def _loop_names(tree: Tree) -> Iterator[str]:
    """The names that loops within a part define."""
    for child in tree if isinstance(tree, Map) else ():
        if child.key == "for_each" and isinstance(child.value, Map):
            for loop in child.value:
                yield loop.key
                for item in loop.value.items if isinstance(loop.value, Items) else ():
                    yield from (f"{loop.key}.{entry.key}" for entry in (item if isinstance(item, Map) else ()))
        yield from _loop_names(child.value)


def _chosen(processes: Sequence[ProcessPlan], groups: Collection[str], host: str | None) -> tuple[ProcessPlan, ...]:
    """The processes of some groups, of one host; they do not wait for what nobody of this launch starts."""
    of_groups = [p for p in processes if not groups or any(_in_group(p.group, name) for name in groups)]
    kept = {p.full_name for p in of_groups}
    chosen = [p for p in of_groups if host is None or host in p.hosts]
    return tuple(
        msgspec.structs.replace(p, needs={n: until for n, until in p.needs.items() if n in kept}) for p in chosen
    )


def _in_group(path: str, name: str) -> bool:
    """Whether a group is meant by a name: the whole path, or one or more parts of it."""
    return f"/{name.strip('/')}/" in f"/{path}/"
