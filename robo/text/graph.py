"""The graph of nodes, topics, services and actions, and its drawings. Pure.

A manifest's plan and a running system give the same kind of graph (`robo check --graph`, `robo graph`), so
that one can be held against the other.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import Literal

import msgspec

from robo.text.columns import aligned
from robo.text.terminal import visible

SYSTEM_TYPES = frozenset({"system/Log", "system/ParameterEvent", "system/Clock", "diagnostic/DiagnosticArray"})
"""Types of the topics that every node has; nobody needs to be at their other end."""

BROADCAST_TYPES = frozenset(
    {
        "tf2/TFMessage",
        "diagnostic/DiagnosticStatus",
        "diagnostic/DiagnosticArray",
        "visualization/Marker",
        "visualization/MarkerArray",
    }
)
"""Types of what is said for whoever wants to know: that nobody does is worth no word."""


class GraphNode(msgspec.Struct, frozen=True, order=True):
    """A node."""

    name: str
    """The full name."""
    class_name: str | None
    """`module:Class`; None for a command that is no node class."""


class GraphTopic(msgspec.Struct, frozen=True, order=True):
    """A topic and its ends."""

    key: str
    types: list[str]
    publishers: list[str]
    """Full names of nodes."""
    subscribers: list[str]
    problems: list[str]
    """A dead end, two types: what to look at."""


class GraphService(msgspec.Struct, frozen=True, order=True):
    """A service, or an action, and its ends."""

    key: str
    types: list[str]
    servers: list[str]
    """Full names of nodes."""
    clients: list[str]
    problems: list[str]


class Graph(msgspec.Struct, frozen=True):
    """Who is connected with whom; everything sorted."""

    nodes: list[GraphNode]
    topics: list[GraphTopic]
    services: list[GraphService]
    actions: list[GraphService] = []


EndpointKind = Literal["pub", "sub", "srv", "cli", "act", "acl"]
"""As `wire.keys` has it."""


class Edge(msgspec.Struct, frozen=True):
    """One end of a topic, a service or an action."""

    node: str
    kind: EndpointKind
    key: str
    type: str
    """Empty where it is not known."""


class _Ends:
    """All ends of a key of one sort: a topic, a service or an action."""

    def __init__(self) -> None:
        self._types: set[str] = set()
        self._nodes: dict[EndpointKind, set[str]] = {}

    def add(self, edge: Edge) -> None:
        self._types |= {edge.type} if edge.type else set()
        self._nodes.setdefault(edge.kind, set()).add(edge.node)

    def nodes(self, kind: EndpointKind) -> list[str]:
        return sorted(self._nodes.get(kind, ()))

    def types(self) -> list[str]:
        return sorted(self._types)

    def clash(self) -> list[str]:
        return [f"type clash: {', '.join(self.types())}"] if len(self._types) > 1 else []


def build(nodes: Iterable[GraphNode], edges: Iterable[Edge]) -> Graph:
    """The graph of nodes and the ends that they have, but for those that ROS hides: those within an action."""
    topics: dict[str, _Ends] = {}
    services: dict[str, _Ends] = {}
    actions: dict[str, _Ends] = {}
    sorts = {"pub": topics, "sub": topics, "srv": services, "cli": services, "act": actions, "acl": actions}
    for edge in edges:
        if "/_" not in f"/{edge.key}":
            sorts[edge.kind].setdefault(edge.key, _Ends()).add(edge)
    return Graph(
        sorted(set(nodes)),
        [_topic(key, ends) for key, ends in sorted(topics.items())],
        [_service(key, ends) for key, ends in sorted(services.items())],
        [_action(key, ends) for key, ends in sorted(actions.items())],
    )


def _topic(key: str, ends: _Ends) -> GraphTopic:
    types, publishers, subscribers = ends.types(), ends.nodes("pub"), ends.nodes("sub")
    problems = ends.clash()
    if not types or not SYSTEM_TYPES.issuperset(types):
        problems += ["nobody publishes it"] if not publishers else []
        problems += ["nobody subscribes it"] if not subscribers and not BROADCAST_TYPES.intersection(types) else []
    return GraphTopic(key, types, publishers, subscribers, problems)


def _service(key: str, ends: _Ends) -> GraphService:
    servers = ends.nodes("srv")
    problems = ends.clash()
    problems += ["nobody serves it"] if not servers else []
    problems += [f"served by {len(servers)} nodes"] if len(servers) > 1 else []
    return GraphService(key, ends.types(), servers, ends.nodes("cli"), problems)


def _action(key: str, ends: _Ends) -> GraphService:
    servers = ends.nodes("act")
    problems = ends.clash()
    problems += ["nobody executes it"] if not servers else []
    problems += [f"executed by {len(servers)} nodes"] if len(servers) > 1 else []
    return GraphService(key, ends.types(), servers, ends.nodes("acl"), problems)


def without_system(graph: Graph) -> Graph:
    """The graph without the topics that every node has."""
    topics = [topic for topic in graph.topics if not (topic.types and SYSTEM_TYPES.issuperset(topic.types))]
    return msgspec.structs.replace(graph, topics=topics)


def draw(graph: Graph, form: str) -> str:
    """The graph in one of `FORMATS`."""
    return _DRAWINGS[form](graph)


def _text(graph: Graph) -> str:
    lines = ["nodes", *_indented([(node.name, node.class_name or "a command") for node in graph.nodes])]
    everybody = [node.name for node in graph.nodes]

    def who(nodes: Sequence[str]) -> str:
        if len(nodes) > 2 and list(nodes) == everybody:
            return "every node"
        return ", ".join(nodes) or "(nobody)"

    if graph.topics:
        rows = [
            (t.key, " ≠ ".join(t.types) or "-", f"{who(t.publishers)} → {who(t.subscribers)}", *_marks(t.problems))
            for t in graph.topics
        ]
        lines += ["", "topics", *_indented(rows)]
    for title, served in (("services", graph.services), ("actions", graph.actions)):
        rows = [
            (s.key, " ≠ ".join(s.types) or "-", f"{who(s.clients)} → {who(s.servers)}", *_marks(s.problems))
            for s in served
        ]
        lines += ["", title, *_indented(rows)] if rows else []
    return "\n".join(lines)


def _marks(problems: Sequence[str]) -> tuple[str]:
    return (f"! {'; '.join(problems)}" if problems else "",)


def _indented(rows: Sequence[tuple[str, ...]]) -> list[str]:
    return [f"  {line}" for line in aligned(rows)]


def _mermaid(graph: Graph) -> str:
    nodes = {name: f"n{i}" for i, name in enumerate(_all_nodes(graph))}
    lines = ["flowchart LR", *(f'  {short}["{name}"]' for name, short in nodes.items())]
    bad = []
    for i, topic in enumerate(graph.topics):
        lines.append(f'  t{i}(["{"<br/>".join([topic.key, " / ".join(topic.types), *topic.problems])}"])')
        lines += [f"  {nodes[name]} --> t{i}" for name in topic.publishers]
        lines += [f"  t{i} --> {nodes[name]}" for name in topic.subscribers]
        bad += [f"t{i}"] if topic.problems else []
    for i, service in enumerate(graph.services):
        lines.append(f'  s{i}{{{{"{"<br/>".join([service.key, " / ".join(service.types), *service.problems])}"}}}}')
        lines += [f"  {nodes[name]} -.-> s{i}" for name in service.clients]
        lines += [f"  s{i} -.-> {nodes[name]}" for name in service.servers]
        bad += [f"s{i}"] if service.problems else []
    for i, action in enumerate(graph.actions):
        lines.append(f'  a{i}[["{"<br/>".join([action.key, " / ".join(action.types), *action.problems])}"]]')
        lines += [f"  {nodes[name]} ==> a{i}" for name in action.clients]
        lines += [f"  a{i} ==> {nodes[name]}" for name in action.servers]
        bad += [f"a{i}"] if action.problems else []
    if bad:
        lines += ["  classDef problem stroke:#c00,stroke-width:2px", f"  class {','.join(bad)} problem"]
    return "\n".join(map(visible, lines))


def _dot(graph: Graph) -> str:
    lines = ["digraph robot {", "  rankdir=LR;"]
    lines += [f"  {_quoted(name)} [shape=box];" for name in _all_nodes(graph)]
    for topic in graph.topics:
        lines.append(f"  {_quoted(topic.key)} [shape=ellipse, {_label(topic.key, topic.types, topic.problems)}];")
        lines += [f"  {_quoted(name)} -> {_quoted(topic.key)};" for name in topic.publishers]
        lines += [f"  {_quoted(topic.key)} -> {_quoted(name)};" for name in topic.subscribers]
    for served, shape, style in ((graph.services, "hexagon", "dashed"), (graph.actions, "octagon", "bold")):
        for one in served:
            lines.append(f"  {_quoted(one.key)} [shape={shape}, {_label(one.key, one.types, one.problems)}];")
            lines += [f"  {_quoted(name)} -> {_quoted(one.key)} [style={style}];" for name in one.clients]
            lines += [f"  {_quoted(one.key)} -> {_quoted(name)} [style={style}];" for name in one.servers]
    return "\n".join([*map(visible, lines), "}"])


def _label(key: str, types: Sequence[str], problems: Sequence[str]) -> str:
    label = "\\n".join([key, " / ".join(types), *problems])
    return f'label="{label}"{", color=red" if problems else ""}'


def _quoted(name: str) -> str:
    return f'"{name}"'


def _json(graph: Graph) -> str:
    return msgspec.json.format(msgspec.json.encode(graph)).decode()


def _all_nodes(graph: Graph) -> list[str]:
    """Every name at an end of an edge, those without a node of their own included."""
    ends = [name for topic in graph.topics for name in (*topic.publishers, *topic.subscribers)]
    ends += [name for served in (*graph.services, *graph.actions) for name in (*served.servers, *served.clients)]
    return sorted({*(node.name for node in graph.nodes), *ends})


_DRAWINGS: dict[str, Callable[[Graph], str]] = {"text": _text, "mermaid": _mermaid, "dot": _dot, "json": _json}

FORMATS = tuple(_DRAWINGS)
