"""What nodes and supervisors tell of themselves, and what they are asked."""

from collections.abc import Sequence
from typing import Annotated, Literal, NamedTuple, get_args

import msgspec
from msgspec import Meta

from robo.wire import names
from robo_messages.diagnostic import DiagnosticStatus

State = Literal["starting", "ready", "standby", "degraded", "restarting", "stopping", "stopped", "failed", "completed"]


HealthLevel = Literal["ok", "warn", "error", "stale"]
"""How well a node does by its checks."""

HEALTH_LEVELS: tuple[HealthLevel, ...] = get_args(HealthLevel)
"""By the level of a `diagnostic/DiagnosticStatus`."""

EVERY_NODES = ("topics", "callbacks")
"""The checks that every node has."""


def health_of(checks: Sequence[DiagnosticStatus]) -> tuple[HealthLevel | None, str]:
    """What the checks of a node come to.

    Returns:
        The worst level, None where there is no check; and of several such checks the first with what it says,
        `battery: charge it`, empty where all is well.
    """
    if not checks:
        return None, ""
    worst = max(checks, key=lambda one: one.level)
    return HEALTH_LEVELS[worst.level], f"{check_name(worst)}: {worst.message}" if worst.level else ""


def check_name(check: DiagnosticStatus) -> str:
    """What a check is called within its node: of `/r1/base: battery` the latter."""
    return check.name.rpartition(": ")[2]


class ProcessName(NamedTuple):
    """What a process is called."""

    robot: str
    """The namespace of its robot."""
    node: str
    """Its full name."""
    group: str
    """With the groups around it: `control/arm`; empty where it is in none."""
    process: str = ""
    """The full name of the process that it shares with other nodes; empty where it has its own."""

    @property
    def label(self) -> str:
        """Its name in the output: without the robot's namespace."""
        return names.label(self.robot, self.node)

    def is_meant(self, word: str) -> bool:
        """Whether a word means it: its name or its process's, whole or in part; a group or a namespace of it."""
        wanted = word.strip("/")
        own = [self.node.strip("/"), self.label, self.node.rpartition("/")[2]]
        if self.process:
            own += [self.process.strip("/"), names.label(self.robot, self.process), self.process.rpartition("/")[2]]
        around = f"/{wanted}/" in f"/{self.group}/" or self.is_within(wanted)
        return wanted in own or (wanted != "" and around)

    def is_within(self, namespace: str) -> bool:
        """Whether it is in a namespace, or in one within that."""
        return not namespace or self.node.startswith(f"/{namespace}/")


class ProcessStatus(msgspec.Struct, frozen=True, kw_only=True):
    """One process of a run, as `robo ps` shows it."""

    robot: str
    """What the run is called: the robot's namespace."""
    group: str
    """With the groups around it: `control/arm`; empty where it is in none."""
    node: str
    """The full name."""
    state: State
    """How far it has come."""
    reason: str
    """Why it is in this state; empty where nothing is to be said."""
    pid: int | None
    """Of the process that runs; null where none does."""
    restarts: int
    """How often it has been started again."""
    uptime: float | None
    """How long the process has been running, s."""
    cpu: float | None
    """Processor time it uses, in percent of one core."""
    memory: int | None
    """Resident, bytes."""
    published: dict[str, float]
    """Messages per second, by topic."""
    received: dict[str, float]
    """Messages per second, by topic."""
    run: str
    """The id of the run."""
    host: str
    """The name of the machine."""
    running: str = ""
    """The callback that holds up all others of its turn, which is mostly the node's; empty while none does."""
    running_for: float = 0.0
    """How long it had been running when the node last said so, s."""
    log_problem: str = ""
    """Why nothing of the run comes into its log files just now; empty where it does."""
    process: str = ""
    """The full name of the process that it shares with other nodes; empty where it has its own. What is said of the
    memory is of the whole process then, and what is said of processor time of the node alone."""
    process_cpu: float | None = None
    """Processor time that such a process uses, in percent of one core."""
    health: HealthLevel | None = None
    """What its checks come to, as it said last; `stale` where it has said nothing for a while, null where never."""
    trouble: str = ""
    """The worst check, and what it says; empty where all is well."""

    @property
    def name(self) -> ProcessName:
        """What it is called."""
        return ProcessName(self.robot, self.node, self.group, self.process)


class Exit(msgspec.Struct, frozen=True, kw_only=True):
    """How a process of a node ended once."""

    time: int
    """ns since the epoch."""
    exit_code: int
    """Negative for a signal."""
    reason: str
    """What ended it, in words."""
    uptime: float
    """s."""
    last_lines: list[str]
    """The end of its stderr."""


class Input(msgspec.Struct, frozen=True, kw_only=True):
    """A topic that a node subscribes."""

    topic: str
    """Its key."""
    received: int
    """Messages given to callbacks."""
    age: float
    """How long ago the last message was seen, s; since the start where there was none."""
    malformed: int
    """Payloads dropped because they were no message of the topic's type."""
    dropped: int
    """Messages dropped because the callback fell behind."""
    external: bool = False
    """Whether the manifest says that it comes from outside of the launch, so that nothing may come for long."""


class SnapshotFile(msgspec.Struct, frozen=True, kw_only=True):
    """A file that a flight recorder has written."""

    time: int
    """Of what it was written for, ns since the epoch."""
    file: str
    """Its whole path."""
    host: str
    """The machine that has it."""
    reason: str
    """What it was written for, in words."""


class Explanation(msgspec.Struct, frozen=True, kw_only=True):
    """Why a node is in its state, as `robo why` shows it."""

    process: ProcessStatus
    """Its state in figures."""
    exits: list[Exit]
    """The last ones, oldest first."""
    unmet_needs: list[str]
    """What it waits for, in words."""
    inputs: list[Input]
    """The topics that it subscribes."""
    callback_errors: int
    """Exceptions that callbacks raised."""
    next_start: float | None
    """In how many seconds it is started again."""
    checks: list[DiagnosticStatus] = []
    """What it said last of how well it does."""
    snapshots: list[SnapshotFile] = []
    """What the robot's flight recorder has written on its account, the newest last."""


class Event(msgspec.Struct, frozen=True, kw_only=True):
    """Something has happened in a run."""

    time: int
    """ns since the epoch."""
    robot: str
    """The namespace of the run."""
    node: str
    """The full name; empty for the run as a whole."""
    event: str
    """The state that a process has come to; for the run: `up`, `ready`, `down`."""
    reason: str
    """Why, in words; empty where nothing is to be said."""
    pid: int | None
    """Of the process; null where none runs."""
    restarts: int
    """How often it had been started again."""
    alarm: Literal["", "died", "degraded"] = ""
    """Whether it is a fault: its process has ended and nobody had asked it to, or it lives and does not keep what is
    promised of it."""


class Site(msgspec.Struct, frozen=True):
    """A place that a robot was told to dial."""

    robot: str
    """The robot's namespace."""
    endpoint: str
    """What it dials."""
    reached: bool
    """Whether its router is linked there."""
    since: int
    """Since when, ns since the epoch."""
    reason: str = ""
    """Why it is not reached; empty where that is not known yet."""


class RunReport(msgspec.Struct, frozen=True, kw_only=True):
    """Which run a supervisor runs, and of what it was made."""

    robot: str
    """What the run is called: the robot's namespace."""
    run: str
    """The id of the run."""
    host: str
    """The name of the machine, or what the manifest calls it."""
    user: str
    """The name of the user whose process the supervisor is."""
    version: str
    """Of robo, as it was when the run began: what has been installed since does not count."""
    manifest: str
    """The name of its file, without the folder."""
    digest: str
    """The beginning of a hash of the manifest and of all files of which it was made, in hexadecimal digits: runs of one
    digest were made of the same. Empty where a file could not be read again."""
    since: int
    """When it began, ns since the epoch."""


COMMAND_LIMIT = 60.0
"""How long a supervisor takes to carry out a command, s; what is not done by then gets an error for an answer."""


class Request(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a control verb is to be done to. A field that is not known is refused: `{"name": "x"}` would mean all."""

    names: Annotated[list[str], Meta(max_length=1000)] = []
    """Nodes or groups; all where there is none."""


MOST_LINES = 5000
"""Lines of output that a supervisor keeps for whoever asks over the network."""


class LogsRequest(Request, frozen=True, forbid_unknown_fields=True):
    """Which lines of output are asked for."""

    since: int = 0
    """No older lines, ns since the epoch."""
    level: Annotated[str, Meta(max_length=100)] | None = None
    """This level and above."""
    lines: Annotated[int, Meta(ge=0)] | None = None
    """Only so many, the newest."""


class Outcome(msgspec.Struct, frozen=True):
    """What a control verb has done."""

    nodes: list[str]
    """Full names."""
    unknown: list[str] = []
    """Names that mean nothing of this supervisor's: a robot on several hosts has several."""


class Result(msgspec.Struct, frozen=True):
    """What came of a `set`."""

    successful: bool
    """Whether all of it was set; else none was."""
    reason: str = ""
    """Why nothing was set."""


class Setting(msgspec.Struct, frozen=True):
    """A value that a parameter was given, and by whom.

    Of one parameter there are as many as there were settings of it, weakest first; the last one holds.
    """

    value: object
    """In the parameter's unit."""
    source: str
    """Where it stands: `file:line:column` of its name, or in words: `declared default`, `command line`."""


class Refused(msgspec.Struct, frozen=True):
    """Messages that a node has left out because another source is the one."""

    sender: str
    """A node's full name, or `a plain Zenoh client`."""
    count: int
    """How many of its messages."""
    age: float
    """How long ago the last one came, s."""


class TurnStatus(msgspec.Struct, frozen=True):
    """What a turn beside the node's own has seen: callbacks of different turns may run at the same time."""

    callbacks: list[str]
    """Who shares it."""
    busy: float
    """How long they have run, as in `NodeStatus`, s."""
    running: str
    """The one that runs just now; empty where none does."""
    running_for: float
    """How long it has been running, s."""


class NodeStatus(msgspec.Struct, frozen=True):
    """What a node has seen so far; also the reply to a query on its status key."""

    node: str
    """The full name."""
    published: dict[str, int]
    """Messages published, by topic."""
    received: dict[str, int]
    """Messages given to callbacks, by topic."""
    malformed: dict[str, int]
    """Payloads dropped because they were no message of the topic's type, by topic."""
    dropped: dict[str, int]
    """Messages dropped because the callback fell behind, by topic."""
    callback_errors: int
    """Exceptions that callbacks raised."""
    refused: dict[str, list[Refused]] = {}
    """Whose messages were left out because another source is the one, by topic."""
    missed: dict[str, int] = {}
    """Ticks that timers skipped because callbacks took too long, by the timer's callback."""
    served: dict[str, int] = {}
    """Calls answered, by service."""
    uptime: float = 0.0
    """How long the node has been running, s."""
    busy: float = 0.0
    """How long its callbacks have run, the one that runs and waiting for services included, s."""
    running: str = ""
    """The callback that runs just now, of several the one that has run for longest; empty where none does."""
    running_for: float = 0.0
    """How long it has been running, s. One that does not return holds up all others of its turn."""
    turns: dict[str, TurnStatus] = {}
    """The turns that callbacks have beside the node's own, by name."""
    zid: str = ""
    """The id of its Zenoh session; only in the reply to a query."""
    links: list[str] = []
    """The ids of the Zenoh sessions to which it is linked; only in the reply to a query."""
    time: int = 0
    """The node's wall clock, ns since the epoch; only in the reply to a query."""
    lifecycle: str = ""
    """The state of a managed node, as ROS calls it: `inactive`; empty for a plain node."""
    large_messages: str = ""
    """How they travel on its machine: `shared memory`, or `sockets: ` and why; only in the reply to a query."""
    memory: int | None = None
    """Resident, of its process, bytes; only in the reply to a query, and where the system tells it."""
    processor_time: float | None = None
    """That its process has used so far, s; only in the reply to a query."""
    checks: list[DiagnosticStatus] = []
    """How well it does by its checks, as it published last on `diagnostics`."""


class Beat(msgspec.Struct, frozen=True):
    """What a beat says."""

    status: NodeStatus
    """What the node has seen."""
    late: bool = False
    """Whether a callback holds the beat back: no sign of life, but its status says which one."""
    files: list[str] = []
    """The source files of the process, Python's own and installed ones left out; in the first beat only."""
    cpu: float | None = None
    """Processor time that the node has used so far, s; null where that is all that its process has used."""


class LogRecord(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One line of output."""

    time: int
    """ns since the epoch."""
    node: str
    """As it is called on the console."""
    message: str
    """The line, without its level."""
    level: str | None = None
    """DEBUG to FATAL where the line begins with it, as robo's nodes write it."""
    stream: str = "stderr"
    """`stdout` or `stderr`."""


class LastWords(msgspec.Struct, frozen=True):
    """What a node that no supervisor runs has logged."""

    time: int
    """The node's wall clock, ns since the epoch."""
    lines: list[LogRecord]
    """The oldest first; `node` is the full name without its leading slash."""
