"""The graph that a plan will make once it runs."""

from collections.abc import Iterable, Sequence

from robo.launch.check import TopicEnd
from robo.launch.plan import ProcessPlan
from robo.launch.resolve import Resolution
from robo.text import graph
from robo.text.graph import Edge, Graph
from robo.wire import names
from robo.wire.keys import SYSTEM_TOPICS


def graph_of(resolution: Resolution, ends: Sequence[TopicEnd]) -> Graph:
    """The graph of a plan, from its processes and what their node classes declare."""
    edges = [Edge(end.node, end.kind, end.key, end.type) for end in ends]
    nodes = []
    for process in resolution.plan.processes:
        contract = resolution.contracts.get(process.full_name)
        nodes.append(graph.GraphNode(process.full_name, contract.class_name if contract is not None else None))
        if contract is not None:
            edges += _system_edges(process)
            edges += (Edge(process.full_name, "srv", _key(process, s.service), s.type) for s in contract.services)
            edges += (Edge(process.full_name, "cli", _key(process, c.service), c.type) for c in contract.clients)
            edges += (Edge(process.full_name, "act", _key(process, a.action), a.type) for a in contract.actions)
            edges += (Edge(process.full_name, "acl", _key(process, a.action), a.type) for a in contract.action_clients)
    return graph.build(nodes, edges)


def _system_edges(process: ProcessPlan) -> Iterable[Edge]:
    """What the runtime gives every node."""
    for topic, type_name in SYSTEM_TOPICS.items():
        yield Edge(process.full_name, "pub", names.join(process.namespace, topic), type_name)
    if process.parameters.get("use_sim_time") is True:
        yield Edge(process.full_name, "sub", _key(process, "/clock"), "system/Clock")


def _key(process: ProcessPlan, name: str) -> str:
    return names.resolve(name, namespace=process.namespace, node=process.name, remappings=process.remap)
