"""Which recorded topics go into nodes, which of theirs are compared; and what of them no recording has."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import zenoh

from robo.bag.read.topics import Topic
from robo.bag.regression.report import NodeTopics
from robo.errors import UsageError
from robo.node.contract import contract_of
from robo.node.node import Node
from robo.testing.bench import Seat
from robo.testing.regression.feed import type_mistake
from robo.testing.regression.order import NodeOrder
from robo.text.suggestions import suggest
from robo.wire import names
from robo.wire.keys import PREFIX, SYSTEM_TOPICS
from robo.wire.qos import QoS

Note = Callable[[str], None]


def parameters_of(order: NodeOrder, node_class: type[Node], note: Note) -> dict[str, Any]:
    """Values for a node's parameters: those of its manifest, then those of the recording."""
    contract = contract_of(node_class)
    recorded = order.recorded.get(names.join(order.namespace, order.name or contract.name), {})
    known = {about.name for about in contract.parameters}
    gone = sorted(set(recorded) - known)
    if gone:
        note(f"{order.service} has no parameter {', '.join(gone)} any more, which the recording has")
    if set(recorded) & known - set(order.parameters):
        note(f"the parameters of {order.name or contract.name} are those of the recording, where nothing else is said")
    return {**{name: value for name, value in recorded.items() if name in known}, **order.parameters}


def tell_what_is_not_replayed(nodes: Sequence[Node], note: Note) -> None:
    """Note what no recording has; and let calls that nobody here answers fail at once, instead of waiting."""
    served = {node.resolve(one.service) for node in nodes for one in node.contract.services}
    acted = {node.resolve(one.action) for node in nodes for one in node.contract.actions}
    for node in nodes:
        contract = node.contract
        if contract.services:
            of = ", ".join(one.service for one in contract.services)
            note(f"{node.full_name}: calls of its service {of} are in no recording, and are not made")
        if contract.actions:
            of = ", ".join(one.action for one in contract.actions)
            note(f"{node.full_name}: goals of its action {of} are in no recording, and are not sent")
        lost = [client for client in node._ends.clients if client.key not in served]
        for client in lost:
            client.abandon()
        called = [client.key for client in lost]
        called += [one.action for one in contract.action_clients if node.resolve(one.action) not in acted]
        if called:
            note(f"{node.full_name}: it calls {', '.join(called)}, which nobody serves here: its calls fail")


def outputs_of(
    seats: Sequence[Seat], others: Mapping[str, list[str]], note: Note
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
        own = {names.join(node.namespace, topic) for topic in SYSTEM_TOPICS}
        compared = []
        for topic in dict.fromkeys(seat.session.topics):
            if topic in own or topic.startswith(PREFIX) or topic.endswith("/transition_event"):
                left_out.add(topic)
            elif topic in others:
                left_out.add(topic)
                note(f"{topic} is not compared: {', '.join(others[topic])} publishes it too")
            else:
                compared.append(topic)
        service = f"{type(node).__module__}:{type(node).__name__}"
        nodes.append(NodeTopics(node.full_name, service, compared))
    return nodes, left_out, qos


def inputs_of(
    seats: Sequence[Seat], recorded: Mapping[str, Topic], note: Note, complain: Callable[[str, str], None]
) -> dict[str, Topic]:
    """Recorded topics to which nodes listen, unless one of them says them.

    Raises:
        UsageError: nodes listen, and there is nothing for them.
    """
    said = {topic for seat in seats for topic in seat.session.topics}
    inputs: dict[str, Topic] = {}
    fits = False
    for seat in seats:
        keys = dict.fromkeys(key for key, _ in seat.session.inboxes)
        silent = [key for key in keys if key not in said and not _fitting(key, recorded)]
        for topic in (topic for key in keys for topic in _fitting(key, recorded)):
            if topic.name in said:
                continue
            fits = True
            wrong = type_mistake(seat.node, topic) if topic.known is not None else None
            if topic.known is None:
                note(f"{topic.name} cannot be fed: {topic.unknown}")
            elif wrong is not None:
                complain(seat.node.full_name, f"{topic.name} cannot be fed: {wrong}")
            else:
                inputs[topic.name] = topic
        if silent:
            note(f"{seat.node.full_name} listens to {', '.join(silent)}, of which nothing was recorded")
    keys_ = [key for seat in seats for key, _ in seat.session.inboxes if key not in said]
    if keys_ and not fits:
        who = ", ".join(seat.node.full_name for seat in seats)
        raise UsageError(
            f"the recording has no input of {who}, which listens to {', '.join(dict.fromkeys(keys_))}; "
            f"{suggest(keys_[0], recorded, 'it has')}"
        )
    return inputs


def _fitting(key: str, recorded: Mapping[str, Topic]) -> Collection[Topic]:
    if key in recorded:
        return (recorded[key],)
    return [topic for name, topic in recorded.items() if _intersect(key, name)]


def _intersect(key: str, topic: str) -> bool:
    try:
        return zenoh.KeyExpr(key).intersects(zenoh.KeyExpr(topic))
    except zenoh.ZError:
        return False
