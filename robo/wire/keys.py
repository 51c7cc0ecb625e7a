"""The key space: every key and token that robo puts on the network.

A token is a key that vanishes with its session, however that ends. Its last five chunks are fixed, so
that it can be read whatever the namespace's length; `/` within a chunk is written `%`.

`@` keeps tokens out of `**`. A node declares its node token last: whoever sees that token knows
everything else about the node, so it says "ready" as well. `<run>` is the id of the run that the node
is part of, by which a supervisor knows its own; a node that is run alone has none. `<id>` is Zenoh's id of
the publisher, which its messages carry: by it a receiver knows whose they are.

Anybody may declare any key: what does not spell a token to the letter is not one.
"""

from typing import ClassVar, Literal, get_args

import msgspec
import zenoh

from robo.text.choices import choice_of
from robo.wire import names
from robo.wire.qos import QoS, from_word

PREFIX = "@robo"
ALL_TOKENS = f"{PREFIX}/**"

EndpointKind = Literal["pub", "sub", "srv", "cli", "act", "acl"]
ENDPOINT_KINDS: tuple[EndpointKind, ...] = get_args(EndpointKind)
VERBS: dict[EndpointKind, str] = {
    "pub": "publishes",
    "sub": "subscribes",
    "srv": "serves",
    "cli": "calls",
    "act": "executes",
    "acl": "sends goals to",
}
"""What a node does at each kind of end, for sentences."""

_MOST_DIGITS = 9
"""Of a number in a key: no process id is longer."""


class _OfNode(msgspec.Struct, frozen=True):
    namespace: str
    """The node's; where the node is in none, the chunk is left out."""
    node: str
    """Its name."""

    @property
    def full_name(self) -> str:
        """The node's, for example `/r1/position_tracker`."""
        return "/" + names.join(self.namespace, self.node)


class NodeToken(_OfNode, frozen=True):
    """A node that is ready."""

    ALL: ClassVar[str] = f"{PREFIX}/**/node/*/*/*/*"

    class_name: str
    """The node's class, `module:Class`."""
    pid: int
    """Of its process."""
    host: str
    """The name of the machine."""
    run: str = ""
    """The id of its run; empty for a node that is run alone."""

    ROS: ClassVar[str] = "ros2"
    """The class, and the host, of a node of ROS 2 that a bridge shows; its process id is 0."""

    @property
    def is_of_ros(self) -> bool:
        """Whether it is a node of ROS 2, shown by a bridge: it answers nothing of what robo's nodes answer."""
        return self.class_name == self.ROS and not self.pid

    def key(self) -> str:
        """The token's key expression."""
        parts = (self.class_name, str(self.pid), names.join(self.host, self.run))
        return names.join(PREFIX, self.namespace, "node", self.node, *map(_mangle, parts))


class ClaimToken(_OfNode, frozen=True):
    """A node that a process is going to run, or runs: nobody else may."""

    ALL: ClassVar[str] = f"{PREFIX}/**/claim/*/*/*/*"

    robot: str
    """What the run is called; empty for a node that is run alone."""
    pid: int
    """Of the process that starts the node."""
    host: str
    """The name of the machine."""
    run: str
    """The id of the run."""

    def key(self) -> str:
        """The token's key expression."""
        parts = (self.robot, str(self.pid), names.join(self.host, self.run))
        return names.join(PREFIX, self.namespace, "claim", self.node, *map(_mangle, parts))


class EndpointToken(_OfNode, frozen=True):
    """A publisher, a subscription, a service or an action, or a client of one."""

    kind: EndpointKind
    type_name: str
    """The type of its messages, of the service or of the action."""
    qos: QoS
    """The depth and what differs from the default: `1,latched,data_high`; a depth of 0 keeps all, as services
    and actions do."""
    topic: str
    """The topic's key expression, the service's or the action's."""
    id: str = ""
    """Of a publisher: Zenoh's id of it, as `source_id` makes it."""

    def key(self) -> str:
        """The token's key expression."""
        parts = (self.type_name, names.join(self.qos.word, self.id), self.topic)
        return names.join(PREFIX, self.namespace, self.kind, self.node, *map(_mangle, parts))


Token = NodeToken | ClaimToken | EndpointToken


def parse_token(key: str) -> Token | None:
    """The token that a key spells; None for a key that is no token of robo's."""
    chunks = key.split("/")
    if len(chunks) < 6 or chunks[0] != PREFIX or not all(map(names.is_word, (*chunks[1:-5], chunks[-4]))):
        return None
    namespace = "/".join(chunks[1:-5])
    kind, node = chunks[-5], chunks[-4]
    a, b, c = map(_unmangle, chunks[-3:])
    if not (a + b + c).isprintable():
        return None
    found: Token | None = None
    if kind in ("node", "claim"):
        host, _, run = c.partition("/")
        if (pid := parse_number(b)) is not None:
            found = (NodeToken if kind == "node" else ClaimToken)(namespace, node, a, pid, host, run)
    elif (end := choice_of(kind, ENDPOINT_KINDS)) is not None:
        word, _, id_ = b.partition("/")
        if (quality := from_word(word)) is not None:
            found = EndpointToken(namespace, node, end, a, quality, c, id_)
    return found if found is not None and found.key() == key else None


def parse_number(text: str) -> int | None:
    """A number as robo writes it into a key; None for anything else, `³` and a number without end included."""
    return int(text) if len(text) <= _MOST_DIGITS and text.isascii() and text.isdigit() else None


def source_id(entity: zenoh.EntityGlobalId) -> str:
    """Zenoh's id of a publisher as a word: `<session>:<entity>`."""
    return f"{entity.zid}:{entity.eid}"


def tokens_of_publishers(topic: str) -> str:
    """The key expression of the tokens of all who publish on a topic."""
    return names.join(PREFIX, "**/pub/*/*/*", _mangle(topic))


def tokens_of_subscribers(topic: str) -> str:
    """The key expression of the tokens of all nodes that subscribe to a topic."""
    return names.join(PREFIX, "**/sub/*/*/*", _mangle(topic))


def latched_key(topic: str, depth: int, *, whole: bool = True) -> str:
    """Where the latched publishers of a topic answer for what they have said last, each `depth` messages, 0 for all.

    It is Zenoh's own, of its advanced publishers; their tokens are such keys too.
    """
    key = f"{topic}/@adv/**" if whole else topic
    return f"{key}?_max={depth}" if depth else key


def tokens_of_latched(topic: str) -> str:
    """The key expression of the tokens of all latched publishers of a topic: Zenoh's own."""
    return f"{topic}/@adv/pub/**"


def latched_id(key: str) -> str:
    """The id of the publisher of which such a token speaks, as `source_id` makes it; empty for another key."""
    parts = key.rpartition("/@adv/pub/")[2].split("/")
    return ":".join(parts[:2]) if len(parts) >= 2 and "/@adv/pub/" in key else ""


def status_key(namespace: str, node: str) -> str:
    """Where a node answers queries about what it has seen: a `NodeStatus`. `*` asks all nodes of a namespace."""
    return names.join(PREFIX, namespace, "status", node)


def lines_key(namespace: str, node: str) -> str:
    """Where a node that no supervisor runs tells what it has logged last, a `LastWords`: what came after `?since=`,
    in ns since the epoch, or all that it keeps.
    """
    return names.join(status_key(namespace, node), "log")


TELLS = ("about", "ps", "why", "events", "logs", "sites")
ACTS = ("stop", "start", "restart", "down")
"""What supervisors answer, and what they do: who may ask for the one need not be let to the other."""


def control_key(robot: str, verb: str) -> str:
    """Where a supervisor answers: `about`, `ps`, `why`, `events`, `logs` and `sites` tell; `stop`, `start`, `restart`
    and `down`, asked on exactly this key, act.
    """
    return names.join(PREFIX, robot, "supervisor", verb)


def refusals_key(name: str) -> str:
    """Where a router tells whom it has refused, and how often: as JSON, a list of kind, who, sentence, count, and the
    last time in ns since the epoch. Only a secured one does.
    """
    return names.join(PREFIX, name, "router", "refusals")


class SupervisorToken(msgspec.Struct, frozen=True):
    """Which process a supervisor is: a liveliness token that vanishes with it."""

    robot: str
    """What the run is called: the robot's namespace."""
    pid: int
    """Of the supervisor."""
    machine: str
    """The name of the machine."""
    part: str = ""
    """The host of the manifest whose part it runs; empty for all of it."""
    zid: str = ""
    """The id of its Zenoh session."""
    user: str = ""
    """The name of the user whose process it is."""

    def key(self) -> str:
        """The token's key expression."""
        parts = (self.part, self.machine, self.zid, self.user)
        return names.join(PREFIX, self.robot, "run", str(self.pid), "%".join(parts))


def supervisors_key(robot: str) -> str:
    """The liveliness tokens of all supervisors of a robot."""
    return names.join(PREFIX, robot, "run", "*", "*")


def parse_supervisor_token(key: str) -> SupervisorToken | None:
    """The token that a key of `supervisors_key` spells; None for a key that spells none."""
    chunks, parts = key.split("/"), key.rpartition("/")[2].split("%")
    if len(chunks) < 5 or len(parts) != 4 or not all(map(names.is_word, chunks[1:-3])) or not key.isprintable():
        return None
    pid = parse_number(chunks[-2])
    token = SupervisorToken("/".join(chunks[1:-3]), pid or 0, parts[1], parts[0], parts[2], parts[3])
    return token if token.key() == key else None


def log_key(robot: str) -> str:
    """Where a supervisor publishes what its processes print, each line a `LogRecord`."""
    return names.join(PREFIX, robot, "output")


def event_key(robot: str) -> str:
    """Where a supervisor publishes what happens in its run, each time an `Event`."""
    return names.join(PREFIX, robot, "events")


LOG_TOPIC = "log"
PARAMETER_EVENTS_TOPIC = "parameter_events"
DIAGNOSTICS_TOPIC = "diagnostics"
SNAPSHOTS_TOPIC = "flight_snapshots"
"""On which a flight recorder tells of the files that it has written, latched, within the namespace of its robot."""
SYSTEM_TOPICS = {
    LOG_TOPIC: "system/Log",
    PARAMETER_EVENTS_TOPIC: "system/ParameterEvent",
    DIAGNOSTICS_TOPIC: "diagnostic/DiagnosticArray",
}
"""What every node publishes beside its contract, by topic of its namespace: log records, changed parameters, and once
a second how well it does.
"""


def parameters_key(namespace: str, node: str, verb: str) -> str:
    """Where a node answers queries about its parameters: `list`, `get`, `describe` and `explain` tell; `set`, asked on
    exactly this key, acts. `*` asks for all verbs, or all nodes of a namespace.
    """
    return names.join(namespace, node, "parameters", verb)


ActionPart = Literal["send_goal", "cancel_goal", "get_result", "feedback", "status"]


def action_key(action: str, part: ActionPart | Literal["*"]) -> str:
    """Where an action is spoken to. `send_goal`, `cancel_goal` and `get_result`, asked on exactly this key, act; on
    `feedback` and `status` its server publishes.
    """
    return names.join(action, _ACTION, part)


_ACTION = "_action"


def is_hidden(key: str) -> bool:
    """Whether a key is one of those that ROS hides: a part of it begins with `_`."""
    return "/_" in f"/{key}"


def _mangle(chunk: str) -> str:
    return chunk.replace("/", "%") or "%"


def _unmangle(chunk: str) -> str:
    return "" if chunk == "%" else chunk.replace("%", "/")
