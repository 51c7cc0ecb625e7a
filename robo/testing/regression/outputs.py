"""What nodes publish: which of it is compared, who else says it, and what they have said when they were recorded."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence

from robo.bag.publishers import Publishers
from robo.bag.regression.report import NodeTopics
from robo.testing.bench import Seat
from robo.wire import names
from robo.wire.keys import PREFIX, SYSTEM_TOPICS
from robo.wire.qos import QoS


def others_of(
    recorded: Publishers, manifest: Mapping[str, list[str]] | None, nodes: Collection[str]
) -> dict[str, list[str]]:
    """By topic, who else says it: by a manifest, and when it was recorded.

    Args:
        recorded: who said what then.
        manifest: by topic, other nodes of a manifest; None where there is none.
        nodes: full names of those that are replayed.
    """
    found = {topic: set(who) for topic, who in (manifest or {}).items()}
    have_run = recorded.nodes.issuperset(nodes)
    for topic, who in recorded.of.items():
        if have_run or len(who) > 1:  # a single one may be one of these, which had another name then
            found.setdefault(topic, set()).update(who.difference(nodes))
    return {topic: sorted(who) for topic, who in found.items() if who}


def said_then(recorded: Publishers, others: Collection[str], nodes: Collection[str]) -> dict[str, list[str]]:
    """What nodes published when they were recorded, and nobody else: by node, what is to be compared."""
    return {
        node: [
            topic for topic, who in recorded.of.items()
            if node in who and topic not in others and not _is_of_every_node(topic, names.split(node)[0])
        ]
        for node in nodes
    }  # fmt: skip


def outputs_of(
    seats: Sequence[Seat], others: Mapping[str, list[str]], note: Callable[[str], None]
) -> tuple[list[NodeTopics], set[str], dict[str, QoS]]:
    """What nodes publish.

    Args:
        seats: the nodes.
        others: by topic, nodes that are not replayed and publish it too.
        note: is told what is not compared.

    Returns:
        Topics that are compared, by node; those that are not; and the quality of all.
    """
    nodes: list[NodeTopics] = []
    left_out: set[str] = set()
    qos: dict[str, QoS] = {}
    for seat in seats:
        node = seat.node
        qos |= {node.resolve(one.topic): one.qos for one in node.contract.publishers}
        compared = []
        for topic in dict.fromkeys(seat.session.topics):
            if _is_of_every_node(topic, node.namespace):
                left_out.add(topic)
            elif topic in others:
                left_out.add(topic)
                note(f"{topic} is not compared: {', '.join(others[topic])} publishes it too")
            else:
                compared.append(topic)
        service = f"{type(node).__module__}:{type(node).__name__}"
        nodes.append(NodeTopics(node.full_name, service, compared))
    return nodes, left_out, qos


def _is_of_every_node(topic: str, namespace: str) -> bool:
    """Whether it is no output of a node's own: its logs, what is told of its parameters and of its states."""
    own = {names.join(namespace, one) for one in SYSTEM_TOPICS}
    return topic in own or topic.startswith(PREFIX) or topic.endswith("/transition_event")
