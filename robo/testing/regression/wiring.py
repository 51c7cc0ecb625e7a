"""Which recorded topics and parameters go into nodes, and what of them no recording has."""

from __future__ import annotations

from collections.abc import Callable, Collection, Container, Mapping, Sequence
from typing import Any

import zenoh

from robo.bag.read.reader import Bag
from robo.bag.read.topics import Topic
from robo.errors import BagError, UsageError
from robo.node.contract import contract_of
from robo.node.node import Node
from robo.parameters.shape import declared_as
from robo.testing.bench import Seat
from robo.testing.regression.feed import type_mistake
from robo.testing.regression.order import NodeOrder
from robo.text.suggestions import suggest
from robo.wire import names
from robo.wire.keys import PARAMETER_EVENTS_TOPIC, SYSTEM_TOPICS

Note = Callable[[str], None]


def parameters_of(order: NodeOrder, node_class: type[Node], note: Note) -> dict[str, Any]:
    """Values for a node's parameters: those of its manifest, then those of the recording."""
    contract = contract_of(node_class)
    recorded = order.recorded.get(names.join(order.namespace, order.name or contract.name), {})
    declared = {about.name for about in contract.parameters}
    known = {name for name in recorded if declared_as(name, declared) is not None}
    gone = sorted(set(recorded) - known)
    if gone:
        note(f"{order.service} has no parameter {', '.join(gone)} any more, which the recording has")
    if known - set(order.parameters):
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


def tell_changed_parameters(recording: Bag, nodes: Collection[str], note: Note) -> None:
    """Note which parameters of nodes were changed while they were recorded: here each keeps one value.

    Args:
        recording: what is replayed.
        nodes: their full names.
        note: is told.
    """
    kind = SYSTEM_TOPICS[PARAMETER_EVENTS_TOPIC]
    topics = [name for name, topic in recording.topics.items() if topic.known is not None and topic.type == kind]
    changed: dict[str, list[str]] = {}
    first: dict[str, int] = {}
    for message in recording.messages(topics) if topics else ():
        try:
            event: Any = message.value
        except BagError:
            continue  # `robo bag check` names it
        if event.node in nodes:
            first.setdefault(event.node, message.arrived)
            told = [one.name for one in (*event.new_parameters, *event.changed_parameters, *event.deleted_parameters)]
            changed.setdefault(event.node, []).extend(told)
    for node, told in changed.items():
        after = (first[node] - recording.begin) * 1e-9
        note(
            f"{node}: {', '.join(dict.fromkeys(told))} was changed while it was recorded, first after {after:.3f} s, "
            "and stays as it is here"
        )


def inputs_of(
    seats: Sequence[Seat],
    recorded: Mapping[str, Topic],
    others: Container[str],
    said_alone: Callable[[str], bool],
    note: Note,
    complain: Callable[[str, str], None],
) -> dict[str, Topic]:
    """Recorded topics to which nodes listen, unless they alone say them.

    What others say too is heard as it was recorded, all of it, for no recording says whose a message is.

    Args:
        seats: the nodes.
        recorded: what the recording has, by name.
        others: topics that nodes say which are not replayed.
        said_alone: whether it is known of a topic that the nodes alone say it.
        note: is told what is not fed, and what is fed otherwise than one may think.
        complain: is told of a node what it cannot take.

    Raises:
        UsageError: nodes listen, and there is nothing for them.
    """
    said = {topic: seat.node.full_name for seat in seats for topic in seat.session.topics}
    inputs: dict[str, Topic] = {}
    fits = False
    for seat in seats:
        keys = dict.fromkeys(key for key, _ in seat.session.inboxes)
        silent = [key for key in keys if key not in said and not _fitting(key, recorded)]
        for topic in (topic for key in keys for topic in _fitting(key, recorded)):
            name = topic.name
            if name in said and name not in others:
                if not said_alone(name):
                    note(f"{name} is not fed: {said[name]} says it, and nothing tells whether others said it too")
                continue
            fits = True
            wrong = type_mistake(seat.node, topic) if topic.known is not None else None
            if topic.known is None:
                note(f"{name} cannot be fed: {topic.unknown}")
            elif wrong is not None:
                complain(seat.node.full_name, f"{name} cannot be fed: {wrong}")
            else:
                inputs[name] = topic
                if name in said:
                    note(f"{name} is fed as it was recorded; what {said[name]} says on it now reaches nobody")
        if silent:
            note(f"{seat.node.full_name} listens to {', '.join(silent)}, of which nothing was recorded")
    keys_ = [key for seat in seats for key, _ in seat.session.inboxes if key not in said or key in others]
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
