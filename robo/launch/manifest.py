"""The manifest as written: a typed tree in which every part knows where it stands.

A field with a sentence beside its type is a key, as `launch.language` has it. What a node says of how it runs is a key
of the plan: such `plain` keys stay trees until they are filled and merged. Substitutions and conditions are still as
written; `launch.unfold` works them out.
"""

from pathlib import Path
from typing import Annotated, ClassVar, Literal, get_args

import msgspec
from msgspec import Meta

from robo.launch.forms import (
    A_BOOLEAN,
    A_FLAG,
    A_TEXT,
    ANY_VALUE,
    SCALAR,
    SOME_TEXTS,
    SOME_VALUES,
    TEXT,
    a_number,
    a_word,
)
from robo.launch.language import A_MAP, NOTHING, KeysOf, Written, named, named_values, part_of, special
from robo.launch.plan import BridgesPlan, ProcessPlan, Ros2Plan, TopicPlan, Until
from robo.text.tree import Entry, Items, Map, Position, Scalar

ArgType = Literal["str", "int", "float", "bool", "path", "choice"]

MOST_PROCESSES = 2_000
"""A launch starts no more."""


class Guarded(msgspec.Struct, frozen=True, kw_only=True):
    """What is there under a condition."""

    when: Annotated[
        Scalar | None, A_FLAG, Meta(description="Only where this expression is true: use_sim and mode == 'gazebo'.")
    ] = msgspec.field(name="if", default=None)
    unless: Annotated[Scalar | None, A_FLAG, Meta(description="Only where this expression is false.")] = None


class Arg(msgspec.Struct, frozen=True, kw_only=True):
    """A launch argument."""

    SHORT: ClassVar = ("default",)

    name: str
    default: Annotated[
        Scalar | None, ANY_VALUE, Meta(description="The value where none is given; without it one has to be.")
    ] = None
    required: Annotated[
        Scalar | None, A_BOOLEAN, Meta(description="True where there is no default, which says it as well.")
    ] = None
    type: Annotated[
        ArgType,
        a_word(get_args(ArgType), substituted=False),
        Meta(description="By default the type of the default value."),
    ]
    exists: Annotated[
        bool, A_BOOLEAN, Meta(description="False for a path that the robot itself makes: others have to be there.")
    ] = True
    choices: Annotated[tuple[Scalar, ...], SOME_VALUES, Meta(description="The only values allowed.")] = ()
    description: Annotated[str, A_TEXT, Meta(description="What it means, shown by --show-args.")] = ""
    position: Position


class ParameterSource(Guarded, frozen=True, kw_only=True):
    """A parameter file, values, or both."""

    SHORT: ClassVar = ("file",)

    file: Annotated[Scalar | None, A_TEXT, Meta(description="A parameter file.")] = None
    values: Annotated[Map | None, A_MAP, Meta(description="Values by name.")] = None


class Variable(Guarded, frozen=True, kw_only=True):
    """An environment variable."""

    SHORT: ClassVar = ("value",)

    name: str
    value: Annotated[Scalar, ANY_VALUE, Meta(description="Its value.")]
    position: Position


class Need(msgspec.Struct, frozen=True):
    """A node that comes first."""

    node: Scalar
    until: Until


class ForEach(msgspec.Struct, frozen=True):
    """Once for each item of a list."""

    variable: str
    items: Items


class Settings(Guarded, frozen=True, kw_only=True):
    """What groups and nodes have in common."""

    namespace: Annotated[
        Scalar | None,
        A_TEXT,
        Meta(description="Put before every relative name; within the outer one, unless it begins with /."),
    ] = None
    params: Annotated[
        tuple[ParameterSource, ...], special("params"), Meta(description="Parameter files and values, in order.")
    ] = ()
    remap: Annotated[
        tuple[Entry, ...], named_values(TEXT), Meta(description="Other names for topics: {cmd_vel: cmd_vel_raw}.")
    ] = ()
    env: Annotated[tuple[Variable, ...], named("variable"), Meta(description="Environment variables.")] = ()
    replicas: Annotated[
        Scalar | None,
        a_number(0, MOST_PROCESSES, whole=True),
        Meta(description="So many of it; ${index} counts from 1."),
    ] = None
    for_each: Annotated[
        ForEach | None,
        special("for_each"),
        Meta(description="One for each item of a list: {robot: [r1, r2]}; ${robot} and ${index} differ."),
    ] = None
    plain: Written = NOTHING
    tree: Map
    position: Position

    @property
    def looped(self) -> bool:
        """Whether there may be several of it."""
        return self.replicas is not None or self.for_each is not None


class NodeEntry(Settings, frozen=True, kw_only=True):
    """A process to start, or in an `override` what is different about one."""

    key: str
    needs: Annotated[
        tuple[Need, ...] | None,
        special("needs"),
        Meta(description="Nodes that come first: {position_tracker: ready}."),
    ] = None
    publishes: Annotated[
        tuple[Entry, ...],
        named_values(TEXT),
        Meta(description="What a command publishes, for the check: {scan: sensor/LaserScan}."),
    ] = ()
    subscribes: Annotated[
        tuple[Entry, ...], named_values(TEXT), Meta(description="What a command subscribes, for the check.")
    ] = ()
    plain: Annotated[Written, KeysOf(ProcessPlan)] = NOTHING


class Include(Guarded, frozen=True, kw_only=True):
    """Another manifest, started as part of this one."""

    SHORT: ClassVar = ("file",)

    file: Annotated[
        Scalar, A_TEXT, Meta(description="Beside this file, in the workspace's launch/, or among the shipped ones.")
    ]
    args: Annotated[tuple[Entry, ...], named_values(SCALAR), Meta(description="Values for its arguments.")] = ()
    namespace: Annotated[
        Scalar | None,
        A_TEXT,
        Meta(description="Put before every relative name; within the outer one, unless it begins with /."),
    ] = None
    without: Annotated[Scalar | Items | None, SOME_TEXTS, Meta(description="Names of its nodes that are left out.")] = (
        None
    )
    override: Annotated[
        tuple[NodeEntry, ...], named("override"), Meta(description="By the name of a node, what is different here.")
    ] = ()
    position: Position


class TopicPromise(msgspec.Struct, frozen=True, kw_only=True):
    """What is promised of a topic."""

    name: str
    promise: Written
    """Its plain keys, those of a TopicPlan."""
    position: Position


class Group(Settings, frozen=True, kw_only=True):
    """Nodes that share settings and can be started by themselves."""

    key: str
    includes: Annotated[
        tuple[Include, ...], special("includes"), Meta(description="Manifests that are part of this group.")
    ] = msgspec.field(name="include", default=())
    args: Annotated[
        tuple[Entry, ...],
        named_values(SCALAR),
        Meta(description="Values for the arguments of the included manifests."),
    ] = ()
    nodes: Annotated[tuple[NodeEntry, ...], named("node"), Meta(description="Processes to start.")] = ()
    groups: Annotated[
        "tuple[Group, ...]",
        named("group"),
        Meta(description="Groups within this one; they inherit its settings."),
    ] = ()
    hosts: Annotated[
        Scalar | Items | None,
        SOME_TEXTS,
        Meta(description="The hosts that it runs on, where a robot has several: robo up --host NAME."),
    ] = None
    topics: Annotated[tuple[TopicPromise, ...], named("topic"), Meta(description="What is promised of topics.")] = ()
    bridges: Annotated[Map | None, part_of(BridgesPlan), Meta(description="Other systems that see this robot.")] = None
    plain: Annotated[Written, KeysOf(ProcessPlan, of_groups=True)] = NOTHING


class Manifest(msgspec.Struct, frozen=True, kw_only=True):
    """A launch manifest."""

    file: Path
    description: Annotated[str, A_TEXT, Meta(description="What this starts, in a line.")] = ""
    args: Annotated[
        tuple[Arg, ...],
        named("arg"),
        Meta(description="What can be chosen at the start: robo up FILE name:=value."),
    ] = ()
    includes: Annotated[
        tuple[Include, ...], special("includes"), Meta(description="Other manifests, started as part of this one.")
    ] = msgspec.field(name="include", default=())
    groups: Annotated[
        tuple[Group, ...],
        named("group"),
        Meta(description="Nodes that share settings and can be started by themselves."),
    ] = ()
    topics: Annotated[tuple[TopicPromise, ...], named("topic"), Meta(description="What is promised of topics.")] = ()
    bridges: Annotated[Map | None, part_of(BridgesPlan), Meta(description="Other systems that see the robot.")] = None


PARTS: dict[str, type[msgspec.Struct]] = {
    "arg": Arg,
    "group": Group,
    "node": NodeEntry,
    "override": NodeEntry,
    "include": Include,
    "topic": TopicPlan,
    "params_item": ParameterSource,
    "variable": Variable,
    "bridges": BridgesPlan,
    "ros2": Ros2Plan,
}
"""The parts of the language that are maps of known keys, by the names that the schema has for them."""
