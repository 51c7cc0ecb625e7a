"""What the process of a run is told, and what it tells. Plain data."""

from typing import Any

import msgspec

from robo.bag.regression.report import Input, NodeTopics, Trouble
from robo.wire.qos import Quality


class NodeOrder(msgspec.Struct, kw_only=True):
    """A node that is to be run."""

    service: str
    """`package.module` or `package.module:Class`."""
    name: str | None = None
    """None for the class's."""
    namespace: str = ""
    parameters: dict[str, Any] = {}
    """As its manifest says."""
    recorded: dict[str, dict[str, Any]] = {}
    """By full name without its leading slash, as the recording says, below those; what the class does not have any
    more is told and left out."""
    remappings: dict[str, str] = {}
    qos: dict[str, Quality] = {}


class RunOrder(msgspec.Struct, kw_only=True):
    """A run."""

    bag: str
    nodes: list[NodeOrder]
    output: str
    """The recording to write."""
    begin: int | None = None
    """When the nodes start, ns since the epoch; None for the first arrival."""
    others: dict[str, list[str]] | None = None
    """By topic, other nodes of the manifest that publish it too; None where there is none."""
    patience: float = 10.0
    """How long a callback may take, s of the wall clock."""
    other_clocks: bool = False
    """Whether the clocks of the wall that modules of nodes read show something else."""


class RunResult(msgspec.Struct, kw_only=True):
    """What a run has come to."""

    begin: int
    """When the nodes started, ns since the epoch."""
    seconds: float = 0.0
    nodes: list[NodeTopics] = []
    inputs: list[Input] = []
    outputs: list[str] = []
    """Topics to compare."""
    said_then: dict[str, list[str]] = {}
    """Those that the recording has of nodes, by node, as far as it says whose they are."""
    periods: dict[str, float] = {}
    """Of topics of which all messages come from one timer, its period, s."""
    first_input: int = 0
    """When the first message was fed, ns since the epoch."""
    notes: list[str] = []
    troubles: list[Trouble] = []


class Line(msgspec.Struct, kw_only=True, omit_defaults=True):
    """A line that a process tells while it works, and at its end."""

    done: float | None = None
    """How much of it, 0 to 1."""
    stage: str = ""
    result: RunResult | None = None
    mistake: str | None = None
    """What the user has done wrong."""
