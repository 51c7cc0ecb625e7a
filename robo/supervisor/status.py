"""What a supervisor tells of its run; the replies of its control keys and its events."""

from typing import Annotated, Literal, NamedTuple

import msgspec
from msgspec import Meta

from robo import names
from robo.discovery import parse_number

State = Literal["starting", "ready", "degraded", "restarting", "stopping", "stopped", "failed", "completed"]


class ProcessName(NamedTuple):
    """What a process is called."""

    robot: str
    node: str
    """Its full name."""
    group: str
    """With the groups around it: `control/arm`; empty where it is in none."""

    @property
    def label(self) -> str:
        """Its name in the output: without the robot's namespace."""
        return names.within(self.robot, self.node)

    def is_meant(self, word: str) -> bool:
        """Whether a word means it: its full name, its name with or without namespace, a group or namespace of it."""
        wanted = word.strip("/")
        own = (self.node.strip("/"), self.label, self.node.rpartition("/")[2])
        around = f"/{wanted}/" in f"/{self.group}/" or self.is_within(wanted)
        return wanted in own or (wanted != "" and around)

    def is_within(self, namespace: str) -> bool:
        """Whether it is in a namespace, or in one within that."""
        return not namespace or self.node.startswith(f"/{namespace}/")


class ProcessStatus(msgspec.Struct, frozen=True, kw_only=True):
    """One process of a run, as `robo ps` shows it."""

    robot: str
    group: str
    node: str
    """The full name."""
    state: State
    reason: str
    """Why it is in this state; empty where nothing is to be said."""
    pid: int | None
    restarts: int
    uptime: float | None
    """How long the process has been running, s."""
    cpu: float | None
    """Processor time it uses, in percent of one core."""
    memory: int | None
    """Resident, bytes."""
    published: dict[str, float]
    """Messages per second, by topic."""
    received: dict[str, float]
    run: str
    host: str
    running: str = ""
    """The callback that holds up all others of the node; empty while none does."""
    running_for: float = 0.0
    """How long it had been running when the node last said so, s."""
    log_problem: str = ""
    """Why nothing of the run comes into its log files just now; empty where it does."""

    @property
    def name(self) -> ProcessName:
        """What it is called."""
        return ProcessName(self.robot, self.node, self.group)


class Exit(msgspec.Struct, frozen=True, kw_only=True):
    """How a process of a node ended once."""

    time: int
    """ns since the epoch."""
    exit_code: int
    """Negative for a signal."""
    reason: str
    uptime: float
    """s."""
    last_lines: list[str]
    """The end of its stderr."""


class Input(msgspec.Struct, frozen=True, kw_only=True):
    """A topic that a node subscribes."""

    topic: str
    received: int
    age: float
    """How long ago the last message was seen, s; since the start where there was none."""
    malformed: int
    dropped: int


class Explanation(msgspec.Struct, frozen=True, kw_only=True):
    """Why a node is in its state, as `robo why` shows it."""

    process: ProcessStatus
    exits: list[Exit]
    """The last ones, oldest first."""
    unmet_needs: list[str]
    inputs: list[Input]
    callback_errors: int
    next_start: float | None
    """In how many seconds it is started again."""


class Event(msgspec.Struct, frozen=True, kw_only=True):
    """Something has happened in a run."""

    time: int
    """ns since the epoch."""
    robot: str
    node: str
    """The full name; empty for the run as a whole."""
    event: str
    """The state that a process has come to; for the run: `up`, `ready`, `down`."""
    reason: str
    pid: int | None
    restarts: int


class Site(msgspec.Struct, frozen=True):
    """A place that a robot was told to dial."""

    robot: str
    endpoint: str
    reached: bool
    since: int
    """Since when, ns since the epoch."""
    reason: str = ""
    """Why it is not reached; empty where that is not known yet."""


class Asked(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a control verb is to be done to. A field that is not known is refused: `{"name": "x"}` would mean all."""

    names: Annotated[list[str], Meta(max_length=1000)] = []
    """Nodes or groups; all where there is none."""
    since: int = 0
    """For `logs`: no older lines, ns since the epoch."""
    level: Annotated[str, Meta(max_length=100)] | None = None
    """For `logs`: this level and above."""
    lines: Annotated[int, Meta(ge=0)] | None = None
    """For `logs`: only so many, the newest."""


class Done(msgspec.Struct, frozen=True):
    """What a control verb has done."""

    nodes: list[str]
    """Full names."""
    unknown: list[str] = []
    """Names that mean nothing of this supervisor's: a robot on several hosts has several."""


def control_key(robot: str, verb: str) -> str:
    """Where a supervisor answers to `ps`, `why`, `events`, `logs`, `stop`, `start`, `restart` and `down`."""
    return names.join("@robo", robot, "supervisor", verb)


class SupervisorToken(msgspec.Struct, frozen=True):
    """Which process a supervisor is: a liveliness token that vanishes with it."""

    robot: str
    pid: int
    machine: str
    part: str = ""
    """The host of the manifest whose part it runs; empty for all of it."""
    zid: str = ""
    """The id of its Zenoh session."""
    user: str = ""
    """The name of the user whose process it is."""

    def key(self) -> str:
        """The token's key expression."""
        parts = (self.part, self.machine, self.zid, self.user)
        return names.join("@robo", self.robot, "run", str(self.pid), "%".join(parts))


def supervisors_key(robot: str) -> str:
    """The tokens of all supervisors of a robot."""
    return names.join("@robo", robot, "run", "*", "*")


def parse_supervisor_token(key: str) -> SupervisorToken | None:
    """The token that a key of `supervisors_key` spells; None for a key that spells none."""
    chunks, parts = key.split("/"), key.rpartition("/")[2].split("%")
    if len(chunks) < 5 or len(parts) != 4 or not all(map(names.is_word, chunks[1:-3])) or not key.isprintable():
        return None
    pid = parse_number(chunks[-2])
    token = SupervisorToken("/".join(chunks[1:-3]), pid or 0, parts[1], parts[0], parts[2], parts[3])
    return token if token.key() == key else None


def log_key(robot: str) -> str:
    """Where a supervisor publishes what its processes print."""
    return names.join("@robo", robot, "output")


def event_key(robot: str) -> str:
    """Where a supervisor publishes its events."""
    return names.join("@robo", robot, "events")
