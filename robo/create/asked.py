"""What `robo create` is asked for: from the words of its command line to nodes with their topics and services."""

from collections.abc import Callable, Collection, Sequence
from typing import TypeVar

import msgspec

from robo.create import names
from robo.create.licenses import license_fault
from robo.create.types import ServiceUse, TypeUse, message_type, service_type
from robo.errors import UsageError
from robo.text.brief import shown

T = TypeVar("T")

FIRST_NODE = "talker"
FIRST_TOPIC = "chatter:std/String"
"""The node of a package for which nobody names one, and what it publishes."""


class TopicUse(msgspec.Struct, frozen=True):
    """One end of a topic."""

    topic: str
    type: TypeUse


class ServiceEnd(msgspec.Struct, frozen=True):
    """A service that a node offers."""

    service: str
    type: ServiceUse


class NodePlan(msgspec.Struct, frozen=True):
    """A node that is to be made."""

    name: str
    publishes: tuple[TopicUse, ...] = ()
    subscribes: tuple[TopicUse, ...] = ()
    serves: tuple[ServiceEnd, ...] = ()


class Asked(msgspec.Struct, frozen=True, kw_only=True):
    """The words of the command line."""

    nodes: tuple[str, ...] = ()
    publishes: tuple[str, ...] = ()
    """Each `TOPIC:group/Type`, or `NODE:TOPIC:group/Type`."""
    subscribes: tuple[str, ...] = ()
    services: tuple[str, ...] = ()
    messages: tuple[str, ...] = ()
    license: str | None = None
    description: str | None = None


class Contents(msgspec.Struct, frozen=True):
    """What is to be made in a package."""

    nodes: tuple[NodePlan, ...]
    messages: tuple[str, ...]


def contents(asked: Asked, package: str) -> Contents:
    """The nodes and messages that are asked for. A node without topics and services publishes a text.

    Raises:
        UsageError: the words make no sense; a line for each mistake.
    """
    problems = [fault for name in asked.nodes if (fault := names.node_fault(name))]
    problems += [fault for name in asked.messages if (fault := names.message_fault(name))]
    problems += [f"--{what} {name} stands twice" for what, name in _twice(asked)]
    if not problems and len({name.lower() for name in asked.messages}) < len(asked.messages):
        problems.append("two messages differ only in capitals; name them apart")
    nodes = dict.fromkeys(asked.nodes)

    def ends(option: str, words: Sequence[str], of_type: Callable[[str], T]) -> list[tuple[str, str, T]]:
        found = []
        for word in words:
            try:
                found.append(_end(option, word, nodes, of_type))
            except UsageError as error:
                problems.append(str(error))
        return found

    def topic(name: str) -> TypeUse:
        return message_type(name, package, asked.messages)

    publishes = ends("--publishes", asked.publishes, topic)
    subscribes = ends("--subscribes", asked.subscribes, topic)
    serves = ends("--service", asked.services, service_type)
    plans = []
    for node in nodes:
        plan = NodePlan(
            node,
            tuple(TopicUse(name, type_) for owner, name, type_ in publishes if owner == node),
            tuple(TopicUse(name, type_) for owner, name, type_ in subscribes if owner == node),
            tuple(ServiceEnd(name, type_) for owner, name, type_ in serves if owner == node),
        )
        problems += _clashes(plan)
        if not (plan.publishes or plan.subscribes or plan.serves):
            plan = NodePlan(node, (TopicUse(node, message_type("std/String", package, ())),))
        plans.append(plan)
    problems += _two_types(plans)
    if problems:
        raise UsageError("\n".join(dict.fromkeys(problems)))
    return Contents(tuple(plans), asked.messages)


def about_faults(asked: Asked) -> list[str]:
    """What is wrong with the license and the description of a new package."""
    found = []
    if asked.license is not None and (fault := license_fault(asked.license)):
        found.append(fault)
    if asked.description is not None and not (asked.description.strip() and asked.description.isprintable()):
        found.append(f"description {shown(asked.description)}: write one line of text")
    return found


def _twice(asked: Asked) -> list[tuple[str, str]]:
    named = (("node", asked.nodes), ("message", asked.messages))
    return [(what, name) for what, every in named for name in dict.fromkeys(every) if every.count(name) > 1]


def _end(option: str, word: str, nodes: Collection[str], of_type: Callable[[str], T]) -> tuple[str, str, T]:
    """The node, the name and the type of a topic or service."""
    example = "close:std/Trigger" if option == "--service" else "grip:std/String"
    parts = word.split(":")
    if len(parts) not in (2, 3) or not all(parts):
        raise UsageError(f"{option} {shown(word)}: write NAME:group/Type, for example {example}")
    node, name, type_name = parts if len(parts) == 3 else ("", *parts)
    if not nodes:
        raise UsageError(f"{option} {shown(word)}: name the node that it belongs to, --node NAME")
    if not node and len(nodes) > 1:
        first = next(iter(nodes))
        raise UsageError(f"{option} {shown(word)}: say which of the nodes, for example {first}:{word}")
    if node and node not in nodes:
        raise UsageError(f"{option} {shown(word)}: there is no --node {shown(node)} beside it")
    what = "service" if option == "--service" else "topic"
    if fault := names.end_fault(what, name):
        raise UsageError(f"{option} {shown(word)}: {fault}")
    try:
        return node or next(iter(nodes)), name, of_type(type_name)
    except UsageError as error:
        raise UsageError(f"{option} {shown(word)}: {error}") from None


def _clashes(plan: NodePlan) -> list[str]:
    """Ends of one node that would get the same name in its code."""
    published, heard = [end.topic for end in plan.publishes], [end.topic for end in plan.subscribes]
    served = [end.service for end in plan.serves]
    kinds = (
        ("--publishes", published, names.attribute),
        ("--subscribes", heard, names.handler),
        ("--service", served, names.answerer),
    )
    found, members = [], []
    for option, ends, member in kinds:
        found += [f"{option} {end} stands twice" for end in dict.fromkeys(ends) if ends.count(end) > 1]
        labels = names.labels(dict.fromkeys(ends))
        members += [(member(label), f"{option} {end}") for end, label in labels.items()]
    for name in dict.fromkeys(name for name, _ in members):
        alike = [end for other, end in members if other == name]
        if len(alike) > 1:
            found.append(f"{' and '.join(alike)} of {plan.name} would both be {name} in its code; name one otherwise")
    return found


def _two_types(plans: Sequence[NodePlan]) -> list[str]:
    """Topics that would have two types, and names that would be a topic and a service."""
    found = []
    types: dict[str, tuple[str, str]] = {}
    for plan in plans:
        for end in (*plan.publishes, *plan.subscribes):
            key = names.key(end.topic, plan.name)
            first = types.setdefault(key, (end.type.name, plan.name))
            if first[0] != end.type.name:
                found.append(
                    f"topic {end.topic} would have two types: {first[0]} in {first[1]}, {end.type.name} in {plan.name}"
                )
    for plan in plans:
        for served in plan.serves:
            if names.key(served.service, plan.name) in types:
                found.append(
                    f"service {served.service} of {plan.name} is called like a topic; name one of them otherwise"
                )
    return found
