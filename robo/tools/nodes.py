"""Which nodes there are, and all that can be asked of a node."""

import time
from collections.abc import Iterable

import msgspec
import zenoh

from robo.errors import NodeNotFound, NodeUnreachable, RoboError
from robo.text.suggestions import suggest
from robo.tools import runs
from robo.tools.replies import read, samples
from robo.wire import names
from robo.wire.discovery import tokens
from robo.wire.keys import EndpointToken, NodeToken, status_key
from robo.wire.qos import QoS
from robo.wire.reports import NodeStatus, ProcessStatus
from robo_messages import DiagnosticStatus

LONG_CALLBACK = 1.0
"""A callback that runs for longer holds up its node, s."""
LOAD_WINDOW = 0.5
"""Over how long load and rates are measured, s."""


class PublisherInfo(msgspec.Struct, frozen=True):
    """A topic that a node publishes."""

    topic: str
    type: str
    qos: QoS
    published: int
    rate: float
    """Messages a second, just now."""


class SubscriptionInfo(msgspec.Struct, frozen=True):
    """A topic that a node reads."""

    topic: str
    type: str
    qos: QoS
    received: int
    rate: float
    """Messages a second, just now."""
    dropped: int
    """Messages that its callback was too slow for."""
    malformed: int
    """Payloads that were no message of the type."""


class ServedInfo(msgspec.Struct, frozen=True):
    """A service that a node serves."""

    service: str
    type: str
    served: int


class ClientInfo(msgspec.Struct, frozen=True):
    """A service that a node may call, or an action that it executes or sends goals to."""

    service: str
    type: str


class TurnInfo(msgspec.Struct, frozen=True):
    """A turn that callbacks of a node have beside the node's own."""

    turn: str
    callbacks: list[str]
    load: float
    """Part of the time that they take, 0 to 1."""


class NodeInfo(msgspec.Struct, frozen=True):
    """All that is known of a running node."""

    node: str
    class_name: str
    pid: int
    host: str
    uptime: float | None
    """s; None where the node does not answer, as everything that is counted."""
    load: float | None
    """Part of the time that its callbacks take, 0 to 1."""
    callback_errors: int | None
    missed: dict[str, int]
    """Ticks that its timers skipped because callbacks took too long, by callback; those that skipped any."""
    running: str
    """The callback that ran when it was asked; empty where none did."""
    running_for: float
    """How long it had been running, s. All others of its turn wait for it."""
    state: str | None
    """As its supervisor says it; None for a node that has none."""
    restarts: int | None
    cpu: float | None
    """% of a core."""
    memory: int | None
    """Bytes."""
    publishers: list[PublisherInfo]
    subscriptions: list[SubscriptionInfo]
    services: list[ServedInfo]
    clients: list[ClientInfo]
    actions: list[ClientInfo]
    """Those that it executes."""
    action_clients: list[ClientInfo]
    """Those to which it may send goals."""
    parameters: dict[str, object] | None
    turns: list[TurnInfo]
    large_messages: str = ""
    """How they travel to others on its machine: through shared memory, or sockets, and why."""
    problem: str = ""
    """Why it does not answer."""
    checks: list[DiagnosticStatus] = []
    """What it said last of how well it does."""

    @property
    def is_of_ros(self) -> bool:
        """Whether it is a node of ROS 2 that a bridge shows."""
        return self.class_name == NodeToken.ROS and not self.pid


STATE = "get_state"
"""The service by which a managed node is known, active or not."""


def is_managed(token: EndpointToken) -> bool:
    """Whether a managed node has said by this token that it is one."""
    is_its = token.topic == f"{token.full_name.strip('/')}/{STATE}"
    return is_its and token.kind == "srv" and token.type_name == "lifecycle/GetState"


def list_nodes(
    session: zenoh.Session, timeout: float = 1.0, *, inactive: bool = False, of_ros: bool = False
) -> list[NodeToken]:
    """Every node that is ready, sorted by full name.

    Args:
        session: whose network to ask on.
        timeout: how long to wait for routers that do not answer, s.
        inactive: whether managed nodes that are not active count too; their class, process and host are not known.
        of_ros: whether nodes of ROS 2 count too, which a bridge shows: they answer nothing that is asked of nodes.
    """
    there = tokens(session, timeout) if inactive else tokens(session, timeout, NodeToken.ALL)
    found = [token for token in there if isinstance(token, NodeToken) and (of_ros or not token.is_of_ros)]
    if inactive:
        ready = {token.full_name for token in found}
        found += [
            NodeToken(token.namespace, token.node, "", 0, "")
            for token in there
            if isinstance(token, EndpointToken) and is_managed(token) and token.full_name not in ready
        ]
    return sorted(found, key=lambda token: token.full_name)


class Twins(msgspec.Struct, frozen=True):
    """Nodes of one name: they work on one set of keys, each against the other."""

    node: str
    tokens: list[NodeToken]

    def __str__(self) -> str:
        where = ", ".join(f"process {token.pid} on {token.host}" for token in self.tokens)
        return f"{self.node} runs {'twice' if len(self.tokens) == 2 else f'{len(self.tokens)} times'}: {where}"


def twins(nodes: Iterable[NodeToken]) -> list[Twins]:
    """The names that several of some nodes have."""
    named: dict[str, list[NodeToken]] = {}
    for token in nodes:
        named.setdefault(token.full_name, []).append(token)
    return [Twins(name, same) for name, same in sorted(named.items()) if len(same) > 1]


def find_node(nodes: Iterable[NodeToken], name: str) -> NodeToken:
    """The node that somebody means: its full name, or its name where only one has it.

    Raises:
        NodeNotFound: there is none, or several; says what there is.
    """
    there = list(nodes)
    wanted = name.strip("/")
    whole = [node for node in there if node.full_name == f"/{wanted}"]
    if whole:
        return whole[0]
    same = [node for node in there if node.node == wanted]
    if len(same) == 1:
        return same[0]
    if same:
        raise NodeNotFound(f"several nodes are named {name}: {', '.join(node.full_name for node in same)}")
    known = [node.node if "/" not in wanted else node.full_name.strip("/") for node in there]
    raise NodeNotFound(f"there is no node {name}; {suggest(wanted, known)}")


def node_status(session: zenoh.Session, node: NodeToken, timeout: float) -> NodeStatus:
    """The counters of a node.

    Raises:
        NodeUnreachable: it does not answer.
    """
    for sample in samples(session.get(status_key(node.namespace, node.node), timeout=timeout)):
        status = read(sample, NodeStatus)
        if status is not None:
            return status
    raise NodeUnreachable(f"{node.full_name} did not answer within {timeout:g} s")


def all_status(session: zenoh.Session, timeout: float) -> dict[str, NodeStatus]:
    """The counters of every node that answers in time, by full name."""
    found = {}
    key = status_key("**", "*")
    for sample in samples(session.get(key, timeout=timeout, consolidation=zenoh.ConsolidationMode.NONE)):
        status = read(sample, NodeStatus)
        if status is not None and str(sample.key_expr) == status_key(*names.split(status.node)):
            found[status.node] = status
    return found


def node_info(session: zenoh.Session, node: NodeToken, timeout: float = 1.0) -> NodeInfo:
    """All about one node. It takes `LOAD_WINDOW`, over which load and rates are measured.

    Of a node of ROS 2 that a bridge shows there is what it publishes, hears, serves and calls, and no more.
    """
    from robo.tools import parameters  # which reads YAML; lists of nodes do without

    ends = [token for token in tokens(session, timeout) if isinstance(token, EndpointToken)]
    own = sorted((t for t in ends if t.full_name == node.full_name), key=lambda token: token.topic)
    if node.is_of_ros:
        return _info(node, own, None, None, None, None, "")
    before, problem = None, ""
    values: dict[str, object] | None = None
    supervised: ProcessStatus | None = None
    begin = time.monotonic()
    try:
        before = node_status(session, node, timeout)
        values = parameters.get(session, node, timeout=timeout)
    except RoboError as error:
        problem = str(error)
    for status in runs.processes(session, timeout=timeout):
        if status.node == node.full_name:
            supervised = status
    after = None
    if before is not None:
        time.sleep(max(0.0, LOAD_WINDOW - (time.monotonic() - begin)))
        try:
            after = node_status(session, node, timeout)
        except NodeUnreachable as error:
            problem = str(error)
    return _info(node, own, before, after or before, supervised, values, problem)


def _info(
    node: NodeToken,
    ends: list[EndpointToken],
    before: NodeStatus | None,
    after: NodeStatus | None,
    supervised: ProcessStatus | None,
    values: dict[str, object] | None,
    problem: str,
) -> NodeInfo:
    span = max(after.uptime - before.uptime, 1e-9) if before is not None and after is not None else 1.0

    def count(counters: str, key: str) -> int:
        return int(getattr(after, counters).get(key, 0)) if after is not None else 0

    def rate(counters: str, key: str) -> float:
        return max(0.0, (count(counters, key) - int(getattr(before, counters, {}).get(key, 0))) / span)

    return NodeInfo(
        node=node.full_name,
        class_name=node.class_name,
        pid=node.pid,
        host=node.host,
        uptime=after.uptime if after is not None else None,
        load=min(1.0, (after.busy - before.busy) / span) if before is not None and after is not None else None,
        callback_errors=after.callback_errors if after is not None else None,
        missed={name: n for name, n in after.missed.items() if n} if after is not None else {},
        running=after.running if after is not None else "",
        running_for=after.running_for if after is not None else 0.0,
        state=supervised.state if supervised is not None else None,
        restarts=supervised.restarts if supervised is not None else None,
        cpu=supervised.cpu if supervised is not None else None,
        memory=supervised.memory if supervised is not None else None,
        publishers=[
            PublisherInfo(t.topic, t.type_name, t.qos, count("published", t.topic), rate("published", t.topic))
            for t in ends
            if t.kind == "pub"
        ],
        subscriptions=[
            SubscriptionInfo(
                t.topic,
                t.type_name,
                t.qos,
                count("received", t.topic),
                rate("received", t.topic),
                count("dropped", t.topic),
                count("malformed", t.topic),
            )
            for t in ends
            if t.kind == "sub"
        ],
        services=[ServedInfo(t.topic, t.type_name, count("served", t.topic)) for t in ends if t.kind == "srv"],
        clients=[ClientInfo(t.topic, t.type_name) for t in ends if t.kind == "cli"],
        actions=[ClientInfo(t.topic, t.type_name) for t in ends if t.kind == "act"],
        action_clients=[ClientInfo(t.topic, t.type_name) for t in ends if t.kind == "acl"],
        parameters=values,
        turns=_turns(before, after, span),
        large_messages=after.large_messages if after is not None else "",
        checks=after.checks if after is not None else [],
        problem=problem,
    )


def _turns(before: NodeStatus | None, after: NodeStatus | None, span: float) -> list[TurnInfo]:
    earlier = before.turns if before is not None else {}
    later = after.turns if after is not None else {}
    return [
        TurnInfo(name, turn.callbacks, min(1.0, (turn.busy - earlier[name].busy) / span))
        for name, turn in sorted(later.items())
        if name in earlier
    ]
