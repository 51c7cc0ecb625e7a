"""What a supervisor tells of its run; the replies of its control keys and its events."""

from typing import Literal

import msgspec

from robo import names

State = Literal["starting", "ready", "degraded", "restarting", "stopping", "stopped", "failed", "completed"]


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


class Asked(msgspec.Struct, frozen=True):
    """What a control verb is to be done to."""

    names: list[str] = []
    """Nodes or groups; all where there is none."""


class Done(msgspec.Struct, frozen=True):
    """What a control verb has done."""

    nodes: list[str]
    """Full names."""


def control_key(robot: str, verb: str) -> str:
    """Where a supervisor answers to `ps`, `why`, `events`, `stop`, `start`, `restart` and `down`."""
    return names.join("@robo", robot, "supervisor", verb)


def supervisor_token(robot: str, pid: int | str, host: str) -> str:
    """The liveliness token of a supervisor; `*` for what is not known."""
    return names.join("@robo", robot, "run", str(pid), host)


def event_key(robot: str) -> str:
    """Where a supervisor publishes its events."""
    return names.join("@robo", robot, "events")
