"""The manifest as written: a typed tree in which every part knows where it stands.

Substitutions and conditions are still as written; `resolve` works them out.
"""

from pathlib import Path
from typing import Literal

import msgspec

from robo.text.tree import Entry, Items, Map, Position, Scalar

ArgType = Literal["str", "int", "float", "bool", "path", "choice"]
Until = Literal["started", "ready", "completed"]


class Condition(msgspec.Struct, frozen=True):
    """`if:` and `unless:`; both empty means yes."""

    when: Scalar | None = None
    unless: Scalar | None = None


class Arg(msgspec.Struct, frozen=True, kw_only=True):
    """A launch argument."""

    name: str
    type: ArgType
    default: Scalar | None
    """None where it has to be given."""
    exists: bool
    """For a path: whether it has to be there at the start."""
    choices: tuple[Scalar, ...]
    description: str
    position: Position


class ParameterSource(msgspec.Struct, frozen=True, kw_only=True):
    """A parameter file, values, or both."""

    file: Scalar | None
    values: Map | None
    condition: Condition


class Variable(msgspec.Struct, frozen=True):
    """An environment variable."""

    name: str
    value: Scalar
    condition: Condition
    position: Position


class Restart(msgspec.Struct, frozen=True):
    """When a process is started again."""

    policy: Scalar | None = None
    delay: Scalar | None = None
    backoff: Scalar | None = None
    max_delay: Scalar | None = None
    jitter: Scalar | None = None
    max: Scalar | None = None
    window: Scalar | None = None
    reset_after: Scalar | None = None
    propagate: Scalar | None = None


class Stop(msgspec.Struct, frozen=True):
    """How a process is told to end."""

    signal: Scalar | None = None
    timeout: Scalar | None = None


class Log(msgspec.Struct, frozen=True):
    """Where output goes, and from which level on."""

    level: Scalar | None = None
    output: Scalar | None = None


class Ready(msgspec.Struct, frozen=True):
    """What tells that a process is ready."""

    when: Scalar | None = None
    """`node` or `started`."""
    log: Scalar | None = None
    """A pattern in its output."""
    port: Scalar | None = None
    probe: Scalar | Items | None = None
    topics: tuple[Scalar, ...] = ()
    timeout: Scalar | None = None


class Need(msgspec.Struct, frozen=True):
    """A node that comes first."""

    node: Scalar
    until: Until


class Loop(msgspec.Struct, frozen=True):
    """`replicas:` or `for_each:`."""

    count: Scalar | None
    variable: str
    items: Items | None


class Settings(msgspec.Struct, frozen=True, kw_only=True):
    """What groups and nodes have in common."""

    namespace: Scalar | None
    params: tuple[ParameterSource, ...]
    remap: tuple[Entry, ...]
    env: tuple[Variable, ...]
    restart: Restart
    log: Log
    loop: Loop | None
    condition: Condition


class Node(msgspec.Struct, frozen=True, kw_only=True):
    """A process to start, or in an `override` what is different about one."""

    key: str
    settings: Settings
    service: Scalar | None
    run: Scalar | Items | None
    name: Scalar | None
    args: Scalar | Items | None
    cwd: Scalar | None
    prefix: Scalar | Items | None
    needs: tuple[Need, ...] | None
    ready: Ready | None
    watchdog: Scalar | None
    required: Scalar | None
    stop: Stop
    priority: Scalar | None
    cpus: Scalar | Items | None
    publishes: tuple[Entry, ...]
    subscribes: tuple[Entry, ...]
    tree: Map
    position: Position


class Include(msgspec.Struct, frozen=True, kw_only=True):
    """Another manifest, started as part of this one."""

    file: Scalar
    args: tuple[Entry, ...]
    namespace: Scalar | None
    without: tuple[Scalar, ...]
    override: tuple[Node, ...]
    condition: Condition
    position: Position


class Topic(msgspec.Struct, frozen=True, kw_only=True):
    """What is promised of a topic."""

    name: str
    type: Scalar | None
    rate: Scalar | None
    max_age: Scalar | None
    external: Scalar | None
    position: Position


class Group(msgspec.Struct, frozen=True, kw_only=True):
    """Nodes that share settings and can be started by themselves."""

    key: str
    settings: Settings
    includes: tuple[Include, ...]
    nodes: tuple[Node, ...]
    groups: "tuple[Group, ...]"
    hosts: tuple[Scalar, ...]
    topics: tuple[Topic, ...]
    tree: Map
    position: Position


class Manifest(msgspec.Struct, frozen=True, kw_only=True):
    """A launch manifest."""

    file: Path
    description: str
    args: tuple[Arg, ...]
    includes: tuple[Include, ...]
    groups: tuple[Group, ...]
    topics: tuple[Topic, ...]
