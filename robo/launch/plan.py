"""From a manifest and arguments to a plan: a flat list of processes, everything resolved."""

import difflib
from collections.abc import Collection, Mapping
from pathlib import Path

import msgspec

from robo import names, parameter_files
from robo.errors import InvalidName, ManifestError, ParameterFileError
from robo.launch import manifest as written
from robo.launch.find import find_manifest
from robo.launch.manifest import Arg, Group, Include, Manifest, NodeEntry
from robo.launch.substitution import substitute, substitute_entries, substitute_scalar
from robo.parameter_files import ParameterFile
from robo.yaml_tree import Entry, Map, Position, Problem, Scalar, Tree

DEFAULT_ROBOT = "my_robot"
_MOST_INCLUDES = 50


class ParameterValue(msgspec.Struct, frozen=True):
    """A parameter's value and where it was said."""

    value: object
    source: str
    """`file:line:column`."""


class ProcessPlan(msgspec.Struct, frozen=True, kw_only=True):
    """One process to start."""

    group: str
    name: str
    namespace: str
    service: str
    parameters: dict[str, ParameterValue]
    remap: dict[str, str]
    env: dict[str, str]
    needs: tuple[str, ...]
    """Full names of the processes that must be ready before this one starts."""
    required: bool
    """Whether the launch ends with this process."""

    @property
    def full_name(self) -> str:
        """For example `/r1/position_tracker`."""
        return "/" + names.join(self.namespace, self.name)


class Plan(msgspec.Struct, frozen=True, kw_only=True):
    """What a launch will start."""

    manifest: str
    description: str
    robot: str
    arguments: dict[str, object]
    processes: tuple[ProcessPlan, ...]


def load(
    file: Path, arguments: Mapping[str, object], *, robot: str | None = None, groups: Collection[str] = ()
) -> Plan:
    """Read a manifest and work out what it starts.

    Args:
        file: the manifest.
        arguments: values for its args; relative paths among them count from the current folder.
        robot: the value of `robot_name`.
        groups: start only these groups; all where empty.

    Raises:
        ManifestError: the manifest, its includes or its parameter files have mistakes; names all.
    """
    loader = _Loader()
    given = dict(arguments)
    if robot is not None:
        given["robot_name"] = robot
    root = loader.read(file)
    if root is None:
        raise ManifestError(_text(loader.problems))
    values = loader.arguments(root, given, Path.cwd(), Position("command line", 1, 1))
    loader.expand(root, values, outer=_Scope())
    loader.check(groups, root)
    if loader.problems:
        raise ManifestError(_text(loader.problems))
    chosen = [p for p in loader.processes if not groups or p.group in groups]
    kept = {p.full_name for p in chosen}
    return Plan(
        manifest=str(file),
        description=root.description,
        robot=str(values.get("robot_name")),
        arguments=values,
        # A group that is started alone does not wait for what somebody else starts.
        processes=tuple(msgspec.structs.replace(p, needs=tuple(n for n in p.needs if n in kept)) for p in chosen),
    )


def _text(problems: list[Problem]) -> str:
    return "\n".join(map(str, problems))


class _Scope(msgspec.Struct, frozen=True):
    """What a group hands down."""

    namespace: str = ""
    group: str = ""
    params: tuple[tuple[Tree, Mapping[str, object], Path], ...] = ()
    """With the values and the folder they are resolved in."""
    remap: tuple[tuple[str, str], ...] = ()
    env: tuple[tuple[str, str], ...] = ()


class _Loader:
    def __init__(self) -> None:
        self.problems: list[Problem] = []
        self.processes: list[ProcessPlan] = []
        self.groups: list[str] = []
        self._positions: dict[str, Position] = {}
        self._needs: list[tuple[str, str, Scalar]] = []
        self._files: dict[Path, ParameterFile | None] = {}
        self._stack: list[Path] = []
        self._includes = 0

    def read(self, file: Path, asked: Position | None = None) -> Manifest | None:
        try:
            text = file.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            where = asked or Position(str(file), 1, 1)
            self.problems.append(Problem(where, f"manifest {file} cannot be read: {error}"))
            return None
        return written.read(text, file, self.problems)

    # -- arguments -----------------------------------------------------------------------------

    def arguments(
        self, manifest: Manifest, given: Mapping[str, object], folder: Path, asked: Position
    ) -> dict[str, object]:
        """The values of a manifest's args, from what was given over the defaults."""
        declared = {arg.name: arg for arg in manifest.args}
        for name in given:
            if name not in declared and name != "robot_name":
                close = difflib.get_close_matches(name, declared, n=1)
                hint = f"did you mean {close[0]}?" if close else f"it has {', '.join(declared) or 'none'}"
                self.problems.append(Problem(asked, f"{manifest.file.name} has no argument {name!r}; {hint}"))
        values: dict[str, object] = {"robot_name": given.get("robot_name", DEFAULT_ROBOT)}
        for arg in manifest.args:
            if arg.name in given:
                values[arg.name] = self._typed(arg, given[arg.name], folder, asked)
            elif arg.default is None:
                about = f" ({arg.description})" if arg.description else ""
                text = f"{manifest.file.name} needs {arg.name}{about}; give it as {arg.name}:=VALUE"
                self.problems.append(Problem(arg.position, text))
                values[arg.name] = ""
            else:
                default = substitute_scalar(arg.default, values, self.problems)
                values[arg.name] = self._typed(arg, default, manifest.file.parent, arg.default.position)
        return values

    def _typed(self, arg: Arg, value: object, folder: Path, position: Position) -> object:
        if arg.type == "path":
            return str((folder / str(value)).resolve()) if value else ""
        if arg.type == "str":
            return value if isinstance(value, str) else _scalar_text(value)
        wanted: dict[str, type] = {"int": int, "float": float, "bool": bool}
        try:
            converted: object = msgspec.convert(value, wanted[arg.type])
        except msgspec.ValidationError:
            self.problems.append(Problem(position, f"argument {arg.name}: {value!r} is no {arg.type}"))
            return value
        return converted

    # -- groups, includes, nodes ---------------------------------------------------------------

    def expand(self, manifest: Manifest, values: Mapping[str, object], outer: _Scope) -> None:
        """Add the processes of a manifest."""
        self._stack.append(manifest.file.resolve())
        for include in manifest.includes:
            self._include(include, manifest, values, outer)
        for group in manifest.groups:
            name = outer.group or group.name
            if not outer.group:
                self.groups.append(group.name)
            if not self._holds(group.condition, values):
                continue
            scope = self._scope(group, name, manifest, values, outer)
            if group.include is not None:
                self._include(group.include, manifest, values, scope)
            for node in group.nodes:
                self._node(node, manifest, values, scope)
        self._stack.pop()

    def _scope(
        self, group: Group, name: str, manifest: Manifest, values: Mapping[str, object], outer: _Scope
    ) -> _Scope:
        folder = manifest.file.parent
        return _Scope(
            namespace=names.join(outer.namespace, self._namespace(group.namespace, values)),
            group=name,
            params=outer.params + tuple((part, values, folder) for part in group.params),
            remap=outer.remap + tuple(self._texts(group.remap, values).items()),
            env=outer.env + tuple(self._texts(group.env, values).items()),
        )

    def _include(self, include: Include, manifest: Manifest, values: Mapping[str, object], outer: _Scope) -> None:
        name = str(substitute_scalar(include.file, values, self.problems))
        position = include.file.position
        self._includes += 1
        if self._includes > _MOST_INCLUDES:
            self.problems.append(Problem(position, f"more than {_MOST_INCLUDES} includes"))
            return
        try:
            file = find_manifest(name, beside=manifest.file.parent)
        except ManifestError as error:
            self.problems.append(Problem(position, str(error)))
            return
        if file.resolve() in self._stack:
            chain = " → ".join(path.name for path in (*self._stack, file))
            self.problems.append(Problem(position, f"include goes in a circle: {chain}"))
            return
        included = self.read(file, position)
        if included is None:
            return
        given = {"robot_name": values["robot_name"]} | substitute_entries(include.args, values, self.problems)
        self.expand(included, self.arguments(included, given, manifest.file.parent, include.position), outer)

    def _node(self, node: NodeEntry, manifest: Manifest, values: Mapping[str, object], scope: _Scope) -> None:
        if not self._holds(node.condition, values):
            return
        namespace = names.join(scope.namespace, self._namespace(node.namespace, values))
        try:
            names.check_node_name(node.name)
        except InvalidName as error:
            self.problems.append(Problem(node.position, str(error)))
            return
        sources = scope.params + tuple((part, values, manifest.file.parent) for part in node.params)
        process = ProcessPlan(
            group=scope.group,
            name=node.name,
            namespace=namespace,
            service=str(substitute_scalar(node.service, values, self.problems)),
            parameters=self._parameters(sources, namespace, node.name),
            remap=dict(scope.remap) | self._texts(node.remap, values),
            env=dict(scope.env) | self._texts(node.env, values),
            needs=(),
            required=self._bool(node.required, values, default=False, what="required"),
        )
        first = self._positions.setdefault(process.full_name, node.position)
        if first is not node.position:
            self.problems.append(Problem(node.position, f"node {process.full_name} is already in {first}"))
        for need in node.needs:
            self._needs.append((process.full_name, namespace, need))
        self.processes.append(process)

    def _parameters(
        self, sources: tuple[tuple[Tree, Mapping[str, object], Path], ...], namespace: str, node: str
    ) -> dict[str, ParameterValue]:
        """Files in order, then inline values over them, wherever these stand."""
        values: dict[str, ParameterValue] = {}
        for part, arguments, folder in sources:
            if isinstance(part, Scalar):
                file = self._file(part, arguments, folder)
                for entry in file.entries if file is not None else ():
                    if entry.matches(namespace, node):
                        for name, value in entry.values.items():
                            values[name] = ParameterValue(value, str(entry.positions[name]))
        for part, arguments, _ in sources:
            if isinstance(part, Map):
                for said in part:
                    value = substitute(said.value, arguments, self.problems)
                    values[said.key] = ParameterValue(value, str(said.position))
        return values

    def _file(self, part: Scalar, arguments: Mapping[str, object], folder: Path) -> ParameterFile | None:
        name = substitute_scalar(part, arguments, self.problems)
        if not name:
            return None  # an argument that names no file
        path = folder / str(name)
        if path not in self._files:
            try:
                self._files[path] = parameter_files.load(path)
            except ParameterFileError as error:
                self._files[path] = None
                self.problems.append(Problem(part.position, str(error)))
        return self._files[path]

    # -- after all nodes are known ---------------------------------------------------------------

    def check(self, groups: Collection[str], manifest: Manifest) -> None:
        """Resolve `needs`, and find circles and unknown groups."""
        where = Position(str(manifest.file), 1, 1)
        for name in groups:
            if name not in self.groups:
                known = ", ".join(dict.fromkeys(self.groups)) or "none"
                self.problems.append(Problem(where, f"there is no group {name!r}; it has {known}"))
        resolved: dict[str, list[str]] = {}
        for process, namespace, need in self._needs:
            full = "/" + names.join(namespace, str(need.value))
            if full in self._positions:
                resolved.setdefault(process, []).append(full)
            else:
                close = difflib.get_close_matches(full, self._positions, n=1)
                hint = f"; did you mean {close[0].rpartition('/')[2]}?" if close else ""
                self.problems.append(Problem(need.position, f"needs {need.value!r}: there is no node {full}{hint}"))
        for circle in _circles(resolved):
            self.problems.append(Problem(self._positions[circle[0]], f"needs go in a circle: {' → '.join(circle)}"))
        self.processes = [
            msgspec.structs.replace(p, needs=tuple(resolved.get(p.full_name, ()))) for p in self.processes
        ]

    # -- small values ----------------------------------------------------------------------------

    def _namespace(self, scalar: Scalar | None, values: Mapping[str, object]) -> str:
        if scalar is None:
            return ""
        try:
            return names.normalize_namespace(str(substitute_scalar(scalar, values, self.problems)))
        except InvalidName as error:
            self.problems.append(Problem(scalar.position, str(error)))
            return ""

    def _texts(self, entries: tuple[Entry, ...], values: Mapping[str, object]) -> dict[str, str]:
        return {key: _scalar_text(v) for key, v in substitute_entries(entries, values, self.problems).items()}

    def _holds(self, condition: written.Condition, values: Mapping[str, object]) -> bool:
        when = self._bool(condition.when, values, default=True, what="if")
        return when and not self._bool(condition.unless, values, default=False, what="unless")

    def _bool(self, scalar: Scalar | None, values: Mapping[str, object], *, default: bool, what: str) -> bool:
        if scalar is None:
            return default
        value = substitute_scalar(scalar, values, self.problems)
        if not isinstance(value, bool):
            self.problems.append(Problem(scalar.position, f"{what}: expected true or false, got {value!r}"))
            return default
        return value


def _scalar_text(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return "" if value is None else str(value)


def _circles(needs: Mapping[str, list[str]]) -> list[list[str]]:
    """Each circle once, as the names along it."""
    found: list[list[str]] = []
    done: set[str] = set()

    def visit(name: str, path: list[str]) -> None:
        if name in path:
            found.append([*path[path.index(name) :], name])
        elif name not in done:
            for need in needs.get(name, ()):
                visit(need, [*path, name])
            done.add(name)

    for name in needs:
        visit(name, [])
    return found
