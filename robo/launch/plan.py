"""What a launch will start: a flat list of processes, everything resolved.

The plan is plain data: the supervisor obeys it, `robo up --dry-run` shows it, `robo check` looks for
wiring faults in it. A field with a sentence beside its type is a key of a manifest, and said nowhere else
(`launch.language`).
"""

import sys
from typing import Annotated, ClassVar, Literal, get_args

import msgspec
from msgspec import Meta

from robo.launch.forms import (
    A_COMMAND,
    A_NODE_NAME,
    A_PATH,
    A_PATTERN,
    A_PORT,
    A_PROCESS,
    A_RATE,
    A_SERVICE,
    A_SIZE,
    SOME_CPUS,
    SOME_TOPICS,
    a_signal,
)
from robo.launch.language import OF_GROUPS, Named, part_of, parts_of
from robo.text.tree import Position
from robo.wire import names
from robo.wire.qos import Quality
from robo.wire.reports import Setting

Until = Literal["started", "ready", "completed"]
"""What another process has to have reached."""

NEEDS = get_args(Until)


class RestartPlan(msgspec.Struct, frozen=True, kw_only=True):
    """When a process that has ended is started again."""

    SHORT: ClassVar = ("policy",)

    policy: Annotated[Literal["never", "on-failure", "always"], Meta(description="never, on-failure or always.")] = (
        "never"
    )
    delay: Annotated[float, Meta(ge=0, description="Before it is started again the first time, s.")] = 0.5
    backoff: Annotated[float, Meta(ge=1, description="What each further delay is multiplied with.")] = 2.0
    max_delay: Annotated[float, Meta(ge=0, description="The longest delay, s.")] = 30.0
    jitter: Annotated[float, Meta(ge=0, le=1, description="The part of a delay that is left to chance, 0 to 1.")] = 0.1
    """By up to this part a delay is shorter, so that what fell together does not rise together."""
    max: Annotated[
        int,
        Meta(
            ge=0,
            description="More restarts than these in a window make it degraded: from then on max_delay.",
        ),
    ] = 5
    window: Annotated[float, Meta(ge=0, description="The window, s.")] = 60.0
    reset_after: Annotated[
        float, Meta(ge=0, description="After being ready for so long it is healthy: delays begin anew, s.")
    ] = 10.0
    propagate: Annotated[bool, Meta(description="Whether what needs it is started again with it.")] = False


class StopPlan(msgspec.Struct, frozen=True, kw_only=True):
    """How a process is told to end."""

    SHORT: ClassVar = ("signal",)

    signal: Annotated[
        str, a_signal("INT", "TERM", "HUP", "QUIT", "USR1", "USR2", "KILL"), Meta(description="The first signal.")
    ] = "INT"
    """Without SIG; TERM and KILL follow."""
    timeout: Annotated[float, Meta(ge=0, description="How long until the next, harder one, s.")] = 1.0


class LogPlan(msgspec.Struct, frozen=True, kw_only=True):
    """Where output goes, and from which level on."""

    SHORT: ClassVar = ("level", "output")

    level: Annotated[
        Literal["debug", "info", "warn", "error", "fatal"] | None, Meta(description="The least level that is shown.")
    ] = None
    output: Annotated[Literal["screen", "file", "both"], Meta(description="Where output goes.")] = "both"


class ReadyPlan(msgspec.Struct, frozen=True, kw_only=True):
    """What tells that a process is ready; all of it, where several things are said."""

    SHORT: ClassVar = ("when",)

    when: Annotated[Literal["node", "started"], Meta(description="node: its liveliness token; started: its start.")] = (
        "node"
    )
    log: Annotated[str | None, A_PATTERN, Meta(description="A line of output in which this pattern is found.")] = None
    port: Annotated[str | None, A_PORT, Meta(description="Something listens there: 8080 or host:8080.")] = None
    """`host:port`."""
    probe: Annotated[
        tuple[str, ...], A_COMMAND, Meta(description="A command that ends with exit code 0, tried again and again.")
    ] = ()
    topics: Annotated[
        tuple[str, ...],
        SOME_TOPICS,
        Meta(description="Its topics that carry data, at the rate that is promised of them."),
    ] = ()
    """In a plan their keys."""
    timeout: Annotated[float, Meta(ge=0, description="How long it may take, s; 0 for ever. Then it has failed.")] = 60.0


class LimitsPlan(msgspec.Struct, frozen=True, kw_only=True):
    """What a process may use at most; None where nothing limits it."""

    memory: Annotated[
        int | None, A_SIZE, Meta(description="Memory: 256M or 1.5G. A process that needs more is ended.")
    ] = None
    """Bytes."""
    cpu: Annotated[
        float | None,
        Meta(ge=0.0625, le=1024, description="Processor time: 0.5 is half of a core."),
    ] = None
    files: Annotated[int | None, Meta(ge=16, le=1_000_000, description="Open files and sockets.")] = None

    def __bool__(self) -> bool:
        """Whether anything is limited."""
        return (self.memory, self.cpu, self.files) != (None, None, None)


Direction = Literal["to_ros", "from_ros", "both"]


class CrossingPlan(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """How a topic, a service or an action crosses to another system."""

    SHORT: ClassVar = ("ros",)

    ros: Annotated[
        str | None, Meta(description="Its name in ROS, such as /odom; by default the same one, with the robot's.")
    ] = None
    direction: Annotated[
        Direction,
        Meta(description="to_ros: robo says or serves it; from_ros: ROS does; both: either may."),
    ] = "to_ros"
    type: Annotated[
        str | None, Meta(description="Its type in robo, such as geometry/Twist; by default as either side says.")
    ] = None
    reliability: Annotated[
        Literal["reliable", "best_effort"] | None, Meta(description="What ROS is told; by default reliable.")
    ] = None
    durability: Annotated[
        Literal["volatile", "transient_local"] | None,
        Meta(description="Whether who comes later gets the last messages; by default as its publisher says."),
    ] = None
    depth: (
        Annotated[int, Meta(ge=0, description="Messages that are kept; 0 keeps all. By default as its publisher says.")]
        | None
    ) = None


class Ros2Plan(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A bridge to a graph of ROS 2 over rmw_zenoh."""

    SHORT: ClassVar = ("domain",)

    domain: Annotated[int, Meta(ge=0, le=232, description="ROS_DOMAIN_ID of the graph.")] = 0
    connect: Annotated[str, Meta(description="Zenoh endpoint of ROS's router (rmw_zenohd).")] = "tcp/localhost:7447"
    topics: Annotated[
        dict[str, CrossingPlan] | None,
        parts_of(CrossingPlan),
        Meta(description="Which topics cross, and how: {odom: /odom}. Without, all of the robot's go to ROS."),
    ] = None
    services: Annotated[
        dict[str, CrossingPlan] | None,
        parts_of(CrossingPlan),
        Meta(description="Which services cross. Without, ROS may call all of the robot's."),
    ] = None
    actions: Annotated[
        dict[str, CrossingPlan] | None,
        parts_of(CrossingPlan),
        Meta(description="Which actions cross. Without, ROS may send goals to all of the robot's."),
    ] = None
    parameters: Annotated[
        Literal["none", "read", "write"],
        Meta(description="What ROS may do with the parameters of the robot's nodes: none, read or write."),
    ] = "write"
    rosout: Annotated[bool, Meta(description="Whether the log goes to /rosout.")] = True


class BridgesPlan(msgspec.Struct, frozen=True, kw_only=True):
    """Other systems that see the robot, each by a process of its own."""

    ros2: Annotated[Ros2Plan | None, Meta(description="ROS 2, over the wire of rmw_zenoh.")] = None


class ProcessPlan(msgspec.Struct, frozen=True, kw_only=True):
    """One process to start."""

    name: Annotated[str, A_NODE_NAME, Meta(description="The node's name; by default the key.")]
    namespace: str
    group: str
    """The names of the groups it is in, joined by `/`."""
    hosts: tuple[str, ...]
    """The hosts that it runs on; empty where the manifest does not say."""
    service: Annotated[
        str | None, A_SERVICE, Meta(description="A node class: package.module or package.module:Class.")
    ] = None
    """None for a command."""
    process: Annotated[
        str | None,
        A_PROCESS,
        OF_GROUPS,
        Meta(description="The process that it shares with the other nodes that name it; empty for one of its own."),
    ] = None
    """In a plan its full name, such as `/r1/sensing`; None for a process of its own."""
    run: Annotated[
        tuple[str, ...], A_COMMAND, Meta(description="Any command, in any language: a list of words, or a line.")
    ] = ()
    """Empty for a service."""
    prefix: Annotated[
        tuple[str, ...], A_COMMAND, Meta(description="Words before the command: gdb -ex run --args, valgrind.")
    ] = ()
    args: Annotated[tuple[str, ...], A_COMMAND, Meta(description="More words for the command.")] = ()
    cwd: Annotated[str | None, A_PATH, Meta(description="The folder it runs in; by default the current one.")] = None
    settings: dict[str, tuple[Setting, ...]]
    """By parameter, all that is said of it, from the weakest to what holds."""
    parameter_files: tuple[str, ...] = ()
    """The files that say something of its parameters, in order."""
    remap: dict[str, str]
    env: dict[str, str]
    needs: dict[str, Until]
    """By full name, what other processes must have reached before this one starts."""
    watchdog: Annotated[
        float, Meta(ge=0, description="A node that gives no sign of life for so long hangs, s; 0 for never.")
    ] = 5.0
    """Never by default for a command, and under a prefix: in a debugger it stands still on purpose."""
    required: Annotated[bool, Meta(description="Whether the launch ends with it.")] = False
    autostart: Annotated[
        bool, Meta(description="Whether a managed node comes to active by itself; else it waits in unconfigured.")
    ] = True
    restart: Annotated[RestartPlan, OF_GROUPS, Meta(description="When a process that ends is started again.")] = (
        RestartPlan()
    )
    stop: Annotated[StopPlan, Meta(description="How it is told to end.")] = StopPlan()
    ready: Annotated[ReadyPlan, part_of(ReadyPlan, whole=True), Meta(description="What tells that it is ready.")] = (
        ReadyPlan()
    )
    log: Annotated[LogPlan, OF_GROUPS, Meta(description="The least level shown, and where output goes.")] = LogPlan()
    priority: Annotated[int, Meta(ge=-20, le=19, description="The nice value; lower runs first.")] | None = None
    cpus: Annotated[tuple[int, ...], SOME_CPUS, Meta(description="The processors it may use: [0, 1] or 0-3.")] = ()
    """Sorted; empty for all."""
    limits: Annotated[
        LimitsPlan,
        part_of(LimitsPlan),
        OF_GROUPS,
        Meta(description="What it may use at most: {memory: 256M, cpu: 0.5, files: 256}."),
    ] = LimitsPlan()
    """Of the whole process, where several nodes share it."""
    qos: dict[str, Quality] = {}
    """By topic, what the manifest says of its ends."""
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
        """The words after `python -m` that run a service; the full name is for the list of processes."""
        assert self.service is not None
        if self.process is not None:
            return ("robo.process.shared", self.process)
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

    SHORT: ClassVar = ("type",)

    key: str
    type: Annotated[str | None, Meta(description="The message type: sensor/LaserScan.")] = None
    min_rate: Annotated[
        float | None, A_RATE, Named("rate"), Meta(description="Messages per second: '>= 5', '<= 50', 10.")
    ] = None
    """1/s; the key `rate` says this one and the next."""
    max_rate: float | None = None
    max_age: Annotated[float, Meta(ge=0, description="The newest message is never older, s.")] | None = None
    external: Annotated[bool, Meta(description="Whether somebody outside of this launch publishes it.")] = False
    qos: Annotated[
        Quality | None, Meta(description="How it is kept and carried, over what its nodes say: latched, {depth: 1}.")
    ] = None
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
