"""What a batch is: what is done with each recording, with which values. Plain data."""

from collections.abc import Mapping
from typing import Any, Literal, get_args

import msgspec

Kind = Literal["replay", "replay-test", "function", "command"]
KINDS: tuple[Kind, ...] = get_args(Kind)

Take = Literal["last", "first", "min", "max", "mean", "sum", "count"]
TAKES: tuple[Take, ...] = get_args(Take)

Value = float | int | bool | str
"""A result's number or word. What is not finite is a word: `nan`, `inf`, `-inf`."""


class Metric(msgspec.Struct, frozen=True):
    """A number that is taken of a topic: of what nodes have said, or else of the recording."""

    topic: str
    """With the robot's name or without."""
    field: str
    """`pose.pose.position.x`, `ranges[0]`."""
    take: Take = "last"


class Work(msgspec.Struct, frozen=True, kw_only=True):
    """What is done in each run."""

    run: Kind
    folder: str
    """Where: modules, manifests and paths are found from there."""
    nodes: tuple[str, ...] = ()
    manifest: str | None = None
    robot: str | None = None
    arguments: dict[str, str] = {}
    """Of the manifest."""
    function: str = ""
    """`module:function`."""
    command: tuple[str, ...] = ()
    tolerances: str | None = None
    ignore: tuple[str, ...] = ()
    runs: int = 2
    """Of a `replay-test`: so many have to say the same."""
    metrics: dict[str, Metric] = {}
    score: str = ""
    """`module:function`: gives more numbers."""
    keep: bool = False
    """Whether what nodes have said is kept as a recording."""
    patience: float = 10.0
    """How long a callback may take, s of the wall clock."""
    timeout: float = 600.0
    """How long a run may take, s of the wall clock."""


class Plan(msgspec.Struct, frozen=True, kw_only=True):
    """A batch."""

    work: Work
    recordings: tuple[str, ...] = ()
    """Patterns of files, from the work's folder."""
    parameters: dict[str, Any] = {}
    """The same in all runs."""
    sweep: dict[str, tuple[Any, ...]] = {}
    """By name the values of which each combination is a run."""
    points: tuple[dict[str, Any], ...] = ()
    """Values that belong together; a run for each, and each combination of `sweep`."""
    seeds: tuple[int, ...] = ()
    attempts: int = 3
    """How often a run begins whose process dies."""


class Job(msgspec.Struct, frozen=True, kw_only=True):
    """One run: a pure function of what is in it."""

    key: str
    """A hash of all that determines its result."""
    work: Work
    recording: str = ""
    """Its path; empty where there is none."""
    parameters: dict[str, Any] = {}
    seed: int | None = None
    output: str = ""
    """Where a recording of what nodes have said is kept; empty for nowhere."""

    @property
    def label(self) -> str:
        """What people call it."""
        return label_of(self.recording, self.parameters, self.seed)


class Outcome(msgspec.Struct, kw_only=True):
    """What came of one attempt at a run."""

    passed: bool
    reason: str = ""
    """Why it has failed, a sentence."""
    metrics: dict[str, Value] = {}
    died: bool = False
    """Whether its process, or whoever ran it, was ended from outside: another attempt may do better."""
    seconds: float = 0.0
    """How long it took."""
    log: str = ""
    """What it has printed, where it has failed."""


class Result(msgspec.Struct, frozen=True, kw_only=True):
    """A line of the table."""

    key: str
    recording: str
    parameters: dict[str, Any] = {}
    seed: int | None = None
    passed: bool
    reason: str = ""
    metrics: dict[str, Value] = {}
    attempts: int = 1
    seconds: float = 0.0
    """How long the last attempt took."""
    log: str = ""
    """The file of what it has printed, within the folder of results; empty where it has passed."""

    @property
    def label(self) -> str:
        """What people call it."""
        return label_of(self.recording, self.parameters, self.seed)


def label_of(recording: str, parameters: Mapping[str, Any], seed: int | None) -> str:
    """What people call a run: its recording and its values."""
    words = [f"{name}={value}" for name, value in parameters.items()]
    words += [f"seed={seed}"] if seed is not None else []
    return " ".join(filter(None, [recording, *words])) or "the run"
