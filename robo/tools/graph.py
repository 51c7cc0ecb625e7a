"""The graph of what runs."""

import zenoh

from robo.text import graph
from robo.text.graph import Edge, Graph
from robo.wire import admin
from robo.wire.discovery import tokens
from robo.wire.keys import NodeToken


def running(session: zenoh.Session, timeout: float = 1.0) -> Graph:
    """Nodes, topics, services and actions, with the ends that any Zenoh client has on topics that no node knows."""
    nodes: list[graph.GraphNode] = []
    edges: list[Edge] = []
    for token in tokens(session, timeout):
        if isinstance(token, NodeToken):
            nodes.append(graph.GraphNode(token.full_name, token.class_name))
        else:
            edges.append(Edge(token.full_name, token.kind, token.topic, token.type_name))
    known = {edge.key for edge in edges}
    edges += (
        Edge(f"zenoh:{zid}", kind, key, "")
        for kind, key, zid in admin.declared_by_others(session, ["**"], timeout)
        if key not in known
    )
    return graph.build(nodes, edges)


def of_robot(whole: Graph, namespace: str) -> Graph:
    """What of a graph belongs to one robot: its nodes, and the topics, services and actions that they have."""
    prefix = f"/{namespace}/"
    own = {node.name for node in whole.nodes if node.name.startswith(prefix)}
    return Graph(
        [node for node in whole.nodes if node.name in own],
        [t for t in whole.topics if t.key.startswith(prefix[1:]) or own.intersection((*t.publishers, *t.subscribers))],
        [s for s in whole.services if s.key.startswith(prefix[1:]) or own.intersection((*s.servers, *s.clients))],
        [a for a in whole.actions if a.key.startswith(prefix[1:]) or own.intersection((*a.servers, *a.clients))],
    )
