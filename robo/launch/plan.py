"""What a launch will start: a flat list of processes, everything resolved.

The plan is plain data: the supervisor obeys it, `robo up --dry-run` shows it, `robo check` looks for
wiring faults in it.
"""

import sys
from typing import Literal

import msgspec

from robo.launch.manifest import Until
from robo.text.tree import Position
from robo.wire import names
from robo.wire.reports import Setting


class RestartPlan(msgspec.Struct, frozen=True, kw_only=True):
    """When a process that has ended is started again."""

    policy: Literal["never", "on-failure", "always"] = "never"
    delay: float = 0.5
    """Before the first restart, s."""
    backoff: float = 2.0
    """What each further delay is multiplied with."""
    max_delay: float = 30.0
    """s."""
    jitter: float = 0.1
    """By up to this part a delay is shorter, so that what fell together does not rise together."""
    max: int = 5
    """More restarts in a window are a storm: the process is degraded and tried again every `max_delay`."""
    window: float = 60.0
    """s."""
    reset_after: float = 10.0
    """How long it must have been ready to count as healthy, s."""
    propagate: bool = False
    """Whether the processes that need it are started again with it."""


class StopPlan(msgspec.Struct, frozen=True, kw_only=True):
    """How a process is told to end."""

    signal: str = "INT"
    """The first signal; TERM and KILL follow."""
    timeout: float = 1.0
    """How long until the next one, s."""


class LogPlan(msgspec.Struct, frozen=True, kw_only=True):
    """Where output goes, and from which level on."""

    level: str | None = None
    output: Literal["screen", "file", "both"] = "both"


class ReadyPlan(msgspec.Struct, frozen=True, kw_only=True):
    """What tells that a process is ready; all of it, where several things are said."""

    when: Literal["node", "started"] = "node"
    """Its liveliness token, or its start."""
    log: str | None = None
    """A line of its output holds this pattern."""
    port: str | None = None
    """`host:port` accepts connections."""
    probe: tuple[str, ...] = ()
    """This command ends with exit code 0."""
    topics: tuple[str, ...] = ()
    """These keys carry data, at the rate that is promised of them."""
    timeout: float = 60.0
    """How long it may take, s; 0 for ever."""


class ProcessPlan(msgspec.Struct, frozen=True, kw_only=True):
    """One process to start."""

    name: str
    namespace: str
    group: str
    """The names of the groups it is in, joined by `/`."""
    hosts: tuple[str, ...]
    """The hosts that it runs on; empty where the manifest does not say."""
    service: str | None
    """The node class; None for a command."""
    run: tuple[str, ...]
    """The words of a command; empty for a service."""
    prefix: tuple[str, ...]
    """The words before what is run: a debugger, `nice`."""
    args: tuple[str, ...]
    """The words after it."""
    cwd: str | None
    settings: dict[str, tuple[Setting, ...]]
    """By parameter, all that is said of it, from the weakest to what holds."""
    parameter_files: tuple[str, ...] = ()
    """The files that say something of its parameters, in order."""
    remap: dict[str, str]
    env: dict[str, str]
    needs: dict[str, Until]
    """By full name, what other processes must have reached before this one starts."""
    watchdog: float
    """A node that gives no sign of life for so long hangs, s; 0 for never."""
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
    sources: dict[str, dict[str, Position]]
    """Where each entry of `remap` and `env` was said."""
    source: Position
    """Where the process was said."""

    @property
    def full_name(self) -> str:
        """For example `/r1/position_tracker`."""
        return "/" + names.join(self.namespace, self.name)

    @property
    def parameters(self) -> dict[str, object]:
        """The values that hold, by name."""
        return {name: settings[-1].value for name, settings in self.settings.items()}

    @property
    def module(self) -> tuple[str, ...]:
        """The words after `python -m` that run a service; its full name is for the list of processes."""
        assert self.service is not None
        return ("robo.process.node", self.service, self.full_name, *self.args)

    def command(self) -> tuple[str, ...]:
        """The words that start it here, a service with this interpreter."""
        if self.service is None:
            return (*self.prefix, *self.run, *self.args)
        return (*self.prefix, sys.executable, "-m", *self.module)

    @property
    def plain(self) -> bool:
        """Whether it is a node and nothing else: no words before or after, no folder or environment of its own."""
        return self.service is not None and not (self.prefix or self.args or self.env or self.cwd is not None)


class TopicPlan(msgspec.Struct, frozen=True, kw_only=True):
    """What is promised of a topic."""

    key: str
    type: str | None = None
    min_rate: float | None = None
    """1/s."""
    max_rate: float | None = None
    max_age: float | None = None
    """s."""
    external: bool = False
    source: Position


class Plan(msgspec.Struct, frozen=True, kw_only=True):
    """What a launch will start."""

    manifest: str
    description: str
    robot: str
    host: str = ""
    """The host whose part of the manifest this is; empty for all of it."""
    arguments: dict[str, object]
    processes: tuple[ProcessPlan, ...]
    topics: tuple[TopicPlan, ...]
    files: tuple[str, ...] = ()
    """The files that it was made of: manifests and parameter files."""
