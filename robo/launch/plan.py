"""What a launch will start: a flat list of processes, everything resolved.

The plan is plain data: the supervisor obeys it, `robo up --dry-run` shows it, `robo check` looks for
wiring faults in it.
"""

from typing import Literal

import msgspec

from robo import names
from robo.launch.manifest import Until


class ParameterValue(msgspec.Struct, frozen=True):
    """A parameter's value and where it was said."""

    value: object
    source: str
    """`file:line:column`, or `command line`."""
    over: "tuple[ParameterValue, ...]" = ()
    """What else is said of it and does not count, from the weakest on."""


class RestartPlan(msgspec.Struct, frozen=True, kw_only=True):
    """When a process that has ended is started again."""

    policy: Literal["never", "on-failure", "always"] = "never"
    delay: float = 0.5
    """s."""
    max: int = 5
    """At most so many restarts in a window."""
    window: float = 60.0
    """s."""


class StopPlan(msgspec.Struct, frozen=True, kw_only=True):
    """How a process is told to end."""

    signal: str = "INT"
    """The first signal; TERM and KILL follow."""
    timeout: float = 1.0
    """How long until the next one, s."""


class LogPlan(msgspec.Struct, frozen=True, kw_only=True):
    """Where output goes, and from which level on."""

    level: str | None = None
    output: Literal["screen", "file", "both"] = "screen"


class ReadyPlan(msgspec.Struct, frozen=True, kw_only=True):
    """What tells that a process is ready: its liveliness token, its start, or a line of its output."""

    when: Literal["node", "started", "log"] = "node"
    pattern: str | None = None


class ProcessPlan(msgspec.Struct, frozen=True, kw_only=True):
    """One process to start."""

    name: str
    namespace: str
    group: str
    """The names of the groups it is in, joined by `/`."""
    service: str | None
    """The node class; None for a command."""
    command: tuple[str, ...]
    cwd: str | None
    parameters: dict[str, ParameterValue]
    remap: dict[str, str]
    env: dict[str, str]
    needs: dict[str, Until]
    """By full name, what other processes must have reached before this one starts."""
    required: bool
    """Whether the launch ends with this process."""
    restart: RestartPlan
    stop: StopPlan
    ready: ReadyPlan
    log: LogPlan
    priority: int | None
    """The nice value."""
    cpus: tuple[int, ...]
    """The processors it may use; empty for all."""
    publishes: dict[str, str]
    """For a command: by topic, the message type."""
    subscribes: dict[str, str]
    sources: dict[str, dict[str, str]]
    """Where each entry of `remap` and `env` was said."""
    source: str
    """Where the process was said, `file:line:column`."""

    @property
    def full_name(self) -> str:
        """For example `/r1/position_tracker`."""
        return "/" + names.join(self.namespace, self.name)


class TopicPlan(msgspec.Struct, frozen=True, kw_only=True):
    """What is promised of a topic."""

    key: str
    type: str | None
    min_rate: float | None
    """1/s."""
    max_rate: float | None
    max_age: float | None
    """s."""
    external: bool
    source: str


class Plan(msgspec.Struct, frozen=True, kw_only=True):
    """What a launch will start."""

    manifest: str
    description: str
    robot: str
    arguments: dict[str, object]
    processes: tuple[ProcessPlan, ...]
    topics: tuple[TopicPlan, ...]
