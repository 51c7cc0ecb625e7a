"""The parts of one process, from all the layers in which it is written.

A layer is the node itself or what an include overrides of it; the last one that says something wins,
and maps are joined.
"""

import re
import shlex
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, TypeVar

import msgspec

from robo.errors import InvalidName
from robo.launch import language
from robo.launch.language import Key
from robo.launch.manifest import Log, Node, Restart, Settings, Topic, Variable
from robo.launch.plan import LogPlan, ReadyPlan, RestartPlan, StopPlan, TopicPlan
from robo.launch.substitution import BROKEN, Scope
from robo.text.brief import shown
from robo.text.tree import Entry, Items, Position, Problem, Scalar
from robo.wire import names

T = TypeVar("T")

WATCHDOG = 5.0
"""How long a node may give no sign of life where the manifest does not say it, s."""

_CPUS = re.compile(r"\s*(\d{1,4})\s*(?:-\s*(\d{1,4}))?\s*")
_RATE = re.compile(r"\s*(>=|<=|>|<|==?)?\s*([0-9.eE+-]+)\s*(?:Hz)?\s*")
_PLACEHOLDER = re.compile(r"\$?\$\{[^}]*\}")
_MARK = "\ue002"


class Layer(msgspec.Struct, frozen=True):
    """A node as written in one place, with the names it may use."""

    node: Node
    scope: Scope

    @property
    def settings(self) -> Settings:
        """What groups and nodes have in common."""
        return self.node.settings


class Origin(msgspec.Struct, frozen=True):
    """Where something is said of a process, and whether of its whole group."""

    position: Position
    shared: bool


class Parts:
    """Works out one process; mistakes are added to `problems`."""

    def __init__(self, layers: Sequence[Layer], problems: list[Problem]) -> None:
        self._layers = layers
        self._problems = problems

    def last(self, get: Callable[[Layer], T | None]) -> tuple[T, Scope] | None:
        """What the last layer says that says anything, and its names."""
        for layer in reversed(self._layers):
            value = get(layer)
            if value is not None:
                return value, layer.scope
        return None

    def name(self, default: str) -> str | None:
        """The node's name; None where it is none."""
        written = self.last(lambda layer: layer.node.name)
        text = written[1].text(written[0]) if written else default
        if text is None:
            return None
        try:
            return names.check_node_name(text)
        except InvalidName as error:
            self._complain(written[0].position if written else self._layers[0].node.position, str(error))
            return None

    def service(self) -> tuple[str, Position] | None:
        """The node class, and where it is named; None for a command."""
        layer = self._program()
        scalar = layer.node.service if layer is not None else None
        if layer is None or scalar is None:
            return None
        text = layer.scope.text(scalar)
        if text == "":
            self._complain(scalar.position, "service: name a node class, for example my_package.my_node")
        return (text, scalar.position) if text else None

    def _program(self) -> Layer | None:
        """The last layer that says what to run."""
        saying = [layer for layer in self._layers if layer.node.service is not None or layer.node.run is not None]
        return saying[-1] if saying else None

    def run(self) -> tuple[str, ...]:
        """The words of the command; none for a service."""
        layer = self._program()
        return tuple(self._words((layer.node.run, layer.scope) if layer and layer.node.run else None, "run"))

    def words(self, key: Literal["prefix", "args"]) -> tuple[str, ...]:
        """The words before or after what is run."""
        return tuple(self._words(self.last(lambda layer: getattr(layer.node, key)), key))

    def cwd(self) -> str | None:
        """The folder to run in."""
        written = self.last(lambda layer: layer.node.cwd)
        path = written[1].path(written[0]) if written else None
        return str(written[1].folder.absolute() / path) if written and path else None

    # -- maps --------------------------------------------------------------------------------------

    def remap(self, outer: Sequence[tuple[Entry, Scope]], namespace: str, node: str) -> dict[str, tuple[str, Origin]]:
        """By name, the other name; names that are none are mistakes."""
        said = [(entry, scope, True) for entry, scope in outer]
        said += [(entry, layer.scope, False) for layer in self._layers for entry in layer.settings.remap]
        found: dict[str, tuple[str, Origin]] = {}
        for entry, scope, shared in said:
            text = scope.text(entry.value) if isinstance(entry.value, Scalar) else None
            if text is None:
                continue
            if self._is_name(entry.key, namespace, node, entry.position) and self._is_name(
                text, namespace, node, entry.value.position
            ):
                found[entry.key] = (text, Origin(entry.position, shared))
        return found

    def env(self, outer: Sequence[tuple[Variable, Scope]]) -> dict[str, tuple[str, Position]]:
        """Environment variables, and where each is said."""
        said = [*outer, *((v, layer.scope) for layer in self._layers for v in layer.settings.env)]
        found: dict[str, tuple[str, Position]] = {}
        for variable, scope in said:
            if not scope.holds(variable.condition):
                continue
            text = scope.text(variable.value)
            if text is not None and "\0" in text:
                self._complain(variable.value.position, f"env {variable.name} holds a zero character")
            elif text is not None:
                found[variable.name] = (text, variable.position)
        return found

    def endpoints(self, key: Literal["publishes", "subscribes"]) -> dict[str, str]:
        """What a command is said to publish or to subscribe."""
        found: dict[str, str] = {}
        for layer in self._layers:
            entries: tuple[Entry, ...] = getattr(layer.node, key)
            for entry in entries:
                if self._is_name(entry.key, "", "node", entry.position):
                    found |= layer.scope.texts((entry,))
        return found

    # -- how it runs -------------------------------------------------------------------------------

    def required(self) -> bool:
        """Whether the launch ends with it."""
        written = self.last(lambda layer: layer.node.required)
        return written[1].truth(written[0], default=False) if written else False

    def restart(self, outer: Sequence[tuple[Restart, Scope]]) -> RestartPlan:
        """When it is started again: each value from the innermost place that says it."""
        said = [*outer, *((layer.settings.restart, layer.scope) for layer in self._layers)]
        return self._plan(
            RestartPlan,
            policy=self._word(said, "policy", language.RESTART_POLICIES),
            delay=self._number(said, language.RESTART, "delay"),
            backoff=self._number(said, language.RESTART, "backoff"),
            max_delay=self._number(said, language.RESTART, "max_delay"),
            jitter=self._number(said, language.RESTART, "jitter"),
            max=self._number(said, language.RESTART, "max"),
            window=self._number(said, language.RESTART, "window"),
            reset_after=self._number(said, language.RESTART, "reset_after"),
            propagate=self._flag(said, "propagate"),
        )

    def stop(self) -> StopPlan:
        """How it is told to end."""
        said = [(layer.node.stop, layer.scope) for layer in self._layers]
        signal = self._word(said, "signal", language.SIGNAL_WORDS)
        return self._plan(
            StopPlan,
            signal=signal.removeprefix("SIG") if signal is not None else None,
            timeout=self._number(said, language.STOP, "timeout"),
        )

    def log(self, outer: Sequence[tuple[Log, Scope]]) -> LogPlan:
        """Where output goes, and from which level on."""
        said = [*outer, *((layer.settings.log, layer.scope) for layer in self._layers)]
        return self._plan(
            LogPlan,
            level=self._word(said, "level", language.LOG_LEVELS),
            output=self._word(said, "output", language.LOG_OUTPUTS),
        )

    def ready(self, service: str | None, namespace: str, remap: Mapping[str, str]) -> ReadyPlan:
        """What tells that it is ready: for a service its token, for a command its start, and what is said besides."""
        default: Literal["node", "started"] = "started" if service is None else "node"
        written = self.last(lambda layer: layer.node.ready)
        if written is None:
            return ReadyPlan(when=default)
        ready, scope = written
        said = [written]
        return self._plan(
            ReadyPlan,
            when=self._word(said, "when", language.READY_WHEN) or default,
            log=self._pattern(ready.log, scope) if ready.log is not None else None,
            port=self._port(ready.port, scope) if ready.port is not None else None,
            probe=self._words((ready.probe, scope), "probe") if ready.probe is not None else None,
            topics=[
                names.resolve(topic, namespace=namespace, node="node", remappings=remap)
                for scalar in ready.topics
                if (topic := scope.text(scalar)) is not None
                and self._is_name(topic, namespace, "node", scalar.position)
            ],
            timeout=self._number(said, language.READY, "timeout"),
        )

    def _pattern(self, scalar: Scalar, scope: Scope) -> str | None:
        pattern = scope.text(scalar)
        try:
            re.compile(pattern or "")
        except (re.error, RecursionError, OverflowError) as error:
            self._complain(scalar.position, f"ready: log: {shown(pattern)} is no pattern: {error}")
            return None
        return pattern

    def _port(self, scalar: Scalar, scope: Scope) -> str | None:
        text = scope.text(scalar)
        if text is None:
            return None
        host, _, port = text.rpartition(":")
        if port.isdecimal() and port.isascii() and 0 < int(port) < 65_536:
            return f"{host or '127.0.0.1'}:{int(port)}"
        self._complain(scalar.position, f"ready: port: {shown(text)} is no port; write 8080 or host:8080")
        return None

    def watchdog(self, service: str | None) -> float:
        """How long it may give no sign of life, s; 0 for ever: under a debugger it stands still on purpose."""
        seconds: float | None = self._number(
            [(layer.node, layer.scope) for layer in self._layers], language.NODE, "watchdog"
        )
        if seconds is not None:
            return seconds
        return 0.0 if service is None or self.last(lambda layer: layer.node.prefix) else WATCHDOG

    def priority(self) -> int | None:
        """The nice value."""
        written = self.last(lambda layer: layer.node.priority)
        return self.number(*written, language.NODE, "priority") if written else None

    def cpus(self) -> tuple[int, ...]:
        """The processors it may use, sorted."""
        written = self.last(lambda layer: layer.node.cpus)
        if written is None:
            return ()
        tree, scope = written
        found: set[int] = set()
        for item in tree.items if isinstance(tree, Items) else (tree,):
            if not isinstance(item, Scalar):
                continue
            text = scope.text(item)
            for part in text.split(",") if text is not None else ():
                match = _CPUS.fullmatch(part)
                some = range(int(match[1]), int(match[2] or match[1]) + 1) if match is not None else ()
                if not some:
                    self._complain(item.position, f"cpus: {shown(text)} is no processor; write [0, 1] or 0-3")
                    break
                found |= set(some)
        return tuple(sorted(found))

    def topic(self, topic: Topic, scope: Scope, namespace: str) -> TopicPlan | None:
        """What is promised of a topic; None where its name is none."""
        if not self._is_name(topic.name, namespace, "node", topic.position):
            return None
        if topic.name.startswith("~"):
            self._complain(topic.position, f"topic {topic.name}: private names are a node's; write it whole")
            return None
        low, high = self._rate(topic.rate, scope)
        age = self.number(topic.max_age, scope, language.TOPIC, "max_age") if topic.max_age is not None else None
        return TopicPlan(
            key=names.resolve(topic.name, namespace=namespace, node="node"),
            type=scope.text(topic.type) if topic.type is not None else None,
            min_rate=low,
            max_rate=high,
            max_age=age,
            external=scope.truth(topic.external, default=False),
            source=topic.position,
        )

    # -- values ------------------------------------------------------------------------------------

    def _complain(self, position: Position, text: str) -> None:
        self._problems.append(Problem(position, text))

    def _plan(self, plan: type[T], **values: object) -> T:
        """A part of the plan from the values that are given."""
        return msgspec.convert({key: value for key, value in values.items() if value is not None}, plan)

    def _is_name(self, name: str, namespace: str, node: str, position: Position) -> bool:
        try:
            names.resolve(name, namespace=namespace, node=node)
        except InvalidName as error:
            self._complain(position, str(error))
            return False
        return True

    def _words(self, written: tuple[Scalar | Items, Scope] | None, what: str) -> list[str]:
        """A command's words: a list as it is, a line split as a shell would, before anything is put in."""
        if written is None:
            return []
        tree, scope = written
        if isinstance(tree, Items):
            scalars = [item for item in tree.items if isinstance(item, Scalar)]
        else:
            scalars = self._split(tree, what)
        words = [text for scalar in scalars if (text := scope.text(scalar)) is not None]
        if any("\0" in word for word in words):
            self._complain(tree.position, f"{what} holds a zero character")
        return words

    def _split(self, scalar: Scalar, what: str) -> list[Scalar]:
        line = str(scalar.value)
        kept = _PLACEHOLDER.findall(line)
        try:
            words = shlex.split(_PLACEHOLDER.sub(_MARK, line))
        except ValueError as error:
            self._complain(scalar.position, f"{what}: {shown(line)} cannot be split into words: {str(error).lower()}")
            return []
        if not words and what == "run":
            self._complain(scalar.position, "run: the command is empty")
        rest = iter(kept)
        return [Scalar(re.sub(_MARK, lambda _: next(rest), word), scalar.position, None) for word in words]

    def _value(self, said: Sequence[tuple[Any, Scope]], field: str) -> tuple[Scalar, Scope] | None:
        """What the last place says that says anything."""
        for struct, scope in reversed(said):
            scalar = getattr(struct, field)
            if scalar is not None:
                return scalar, scope
        return None

    def _word(self, said: Sequence[tuple[Any, Scope]], field: str, allowed: Sequence[str]) -> str | None:
        written = self._value(said, field)
        text = written[1].text(written[0]) if written else None
        if text is None or written is None:
            return None
        folded = text.upper() if field == "signal" else text
        if folded in allowed:
            return folded
        self._complain(written[0].position, f"{field}: {shown(text)} is not known; use {', '.join(allowed)}")
        return None

    def _number(self, said: Sequence[tuple[Any, Scope]], keys: Mapping[str, Key], field: str) -> Any:
        written = self._value(said, field)
        return self.number(*written, keys, field) if written else None

    def _flag(self, said: Sequence[tuple[Any, Scope]], field: str) -> bool | None:
        written = self._value(said, field)
        return written[1].truth(written[0], default=False) if written else None

    def number(self, scalar: Scalar, scope: Scope, keys: Mapping[str, Key], field: str) -> Any:
        """A number within the limits of its key; None where it is none, which is a mistake."""
        value = scope.value(scalar)
        limits = keys[field].limits
        assert limits is not None
        if value is BROKEN:
            return None
        if limits.hold(value):
            return value
        self._complain(scalar.position, f"{field}: expected {limits}, not {shown(value)}")
        return None

    def _rate(self, scalar: Scalar | None, scope: Scope) -> tuple[float | None, float | None]:
        """The least and the most messages per second: `>= 5`, `<= 50`, `10` (at least)."""
        text = scope.text(scalar) if scalar is not None else None
        if scalar is None or text is None:
            return None, None
        match = _RATE.fullmatch(text)
        try:
            number = float(match[2]) if match is not None else -1.0
        except ValueError:
            number = -1.0
        if match is None or not 0 < number < 1e9:
            self._complain(scalar.position, f"rate: {shown(text)} is no rate; write '>= 5', '<= 50' or a number")
            return None, None
        sign = match[1] or ">="
        return (number if sign[0] in ">=" else None, number if sign[0] in "<=" else None)
