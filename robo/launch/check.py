"""Wiring faults: what a plan and the contracts of its node classes say of each other.

Pure, from a `Resolution` to findings: two types on one topic, a subscription that nothing feeds, a
remapping of a name that the node does not have, a promise about a topic that nobody keeps.
"""

from collections.abc import Iterable, Mapping, Sequence

import msgspec

import robo_messages
from robo.errors import ContractError
from robo.launch.check_actions import unexecuted
from robo.launch.check_sources import position_of, unheard
from robo.launch.faults import in_order
from robo.launch.plan import ProcessPlan, TopicPlan
from robo.launch.resolve import Resolution
from robo.parameters.shape import ANY_NAME, declared_as
from robo.text.brief import shown
from robo.text.graph import BROADCAST_TYPES, SYSTEM_TYPES
from robo.text.suggestions import closest, hint, suggest
from robo.text.tree import Position, Problem
from robo.wire import names
from robo.wire.keys import SYSTEM_TOPICS, VERBS, EndpointKind
from robo.wire.qos import QoS, misfit


class TopicEnd(msgspec.Struct, frozen=True):
    """One end of a topic: a node that publishes or subscribes it."""

    node: str
    kind: EndpointKind
    """`pub` or `sub`."""
    key: str
    type: str
    """Empty where it is not known."""
    topic: str
    """As the node itself calls it, before remapping."""
    qos: QoS | None = None
    """What holds there; None where nobody knows, as of a command."""
    written: Position | None = None
    """Where a parameter names it; None where that is not what names it, or it is in no file."""

    def __str__(self) -> str:
        renamed = "" if self.key.endswith(self.topic.strip("/")) else f" (its {self.topic})"
        return f"{self.node} {VERBS[self.kind]} {self.type or 'it'}{renamed}"


class Findings(msgspec.Struct, frozen=True):
    """What a check has found."""

    faults: tuple[Problem, ...]
    notes: tuple[Problem, ...]
    """Worth knowing, and often as intended."""


def ends_of(resolution: Resolution) -> list[TopicEnd]:
    """Every end of every topic, in the order of the plan."""
    ends: list[TopicEnd] = []
    for process in resolution.plan.processes:
        ends += (_end(process, "pub", *topic) for topic in _declared(resolution, process, "pub"))
        ends += (_end(process, "sub", *topic) for topic in _declared(resolution, process, "sub"))
        ends += _subscribed_by_parameters(process, resolution)
    return ends


def misfits(ends: Sequence[TopicEnd]) -> Iterable[tuple[TopicEnd, str]]:
    """The subscriptions among the ends of a topic that do not get what they want, and why."""
    for reader in ends:
        for source in ends:
            if source.kind == "pub" and reader.kind == "sub" and source.qos is not None and reader.qos is not None:
                why = misfit(reader.key, (source.node, source.qos), (reader.node, reader.qos))
                if why:
                    yield reader, why


def _endless(ends: Sequence[TopicEnd]) -> Iterable[tuple[TopicEnd, str]]:
    """The publishers among the ends of a topic that would keep each message for ever, and why."""
    for end in ends:
        if end.kind == "pub" and end.qos is not None:
            try:
                end.qos.of_publisher()
            except ContractError as error:
                yield end, f"{end.node} on {end.key}: {error}"


def check(resolution: Resolution) -> Findings:
    """Everything that is wrong with a manifest, and what else is worth knowing."""
    faults = [*resolution.problems, *resolution.loose]
    notes: list[Problem] = [*resolution.warnings]
    ends = ends_of(resolution)
    by_key: dict[str, list[TopicEnd]] = {}
    for end in ends:
        by_key.setdefault(end.key, []).append(end)
    silent = _that_may_publish(resolution)
    all_known = all(p.service is None or p.full_name in resolution.contracts for p in resolution.plan.processes)
    promised = {topic.key: topic for topic in resolution.plan.topics}
    for key, found in by_key.items():
        faults += _type_clashes(key, found, resolution)
        faults += (Problem(resolution.positions[end.node], why) for end, why in (*_endless(found), *misfits(found)))
        if not all_known:
            continue  # a node class that could not be read may be the other end
        notes += _unread(key, found, promised, resolution)
        for problem in _unfed(key, found, ends, promised, resolution):
            (notes if silent else faults).append(problem if not silent else _may_be_fed(problem, silent))
    faults += unheard(resolution, {key: [e.node for e in found if e.kind == "pub"] for key, found in by_key.items()})
    faults += _unknown_remaps(resolution)
    faults += _never_held(resolution)
    for topic in resolution.plan.topics:
        faults += _promise(topic, by_key, may_be_served=bool(silent) or not all_known)
    for problem, is_fault in (*unmatched(resolution), *unexecuted(resolution, all_known=all_known)):
        (faults if is_fault else notes).append(problem)
    return Findings(in_order(faults), in_order(notes))


def unmatched(resolution: Resolution) -> list[tuple[Problem, bool]]:
    """The entries of parameter files that mean no node of this launch, and whether that is a fault.

    A file may serve several launches: that a node is not in this one is none, but a pattern that
    matches nothing and a name that is nearly another one's are.
    """
    present = [name.rpartition("/")[2] for name in resolution.positions]
    found = []
    for entry in resolution.unmatched:
        others = [name for name in resolution.positions if entry.matches(*_split(name))]
        if others:
            text = (
                f"{entry.pattern} means {others[0]}, which is not given this file; name it in params: of that node too"
            )
            found.append((Problem(entry.position, text), False))
            continue
        meant = hint(entry.pattern.rpartition("/")[2], present)
        problem = Problem(entry.position, f"{entry.pattern} matches no node of this launch{meant}")
        found.append((problem, bool(meant) or not entry.names_one_node))
    return found


def _split(full_name: str) -> tuple[str, str]:
    """A full name as namespace and node."""
    namespace, _, node = full_name.strip("/").rpartition("/")
    return namespace, node


def _declared(
    resolution: Resolution, process: ProcessPlan, kind: EndpointKind
) -> Iterable[tuple[str, str, QoS | None]]:
    """The topics of a process with their types, as they are written and as its class declares them."""
    for topic, type_name in (process.publishes if kind == "pub" else process.subscribes).items():
        yield topic, type_name, None
    contract = resolution.contracts.get(process.full_name)
    if contract is not None:
        topics = contract.publishers if kind == "pub" else contract.subscriptions
        yield from ((declared.topic, declared.type, declared.qos) for declared in topics)


def _subscribed_by_parameters(process: ProcessPlan, resolution: Resolution) -> Iterable[TopicEnd]:
    """The topics that a process subscribes because a parameter names them."""
    contract = resolution.contracts.get(process.full_name)
    if contract is None:
        return
    infos = {info.name: info for info in contract.parameters if info.subscribes is not None}
    values = {name: info.default for name, info in infos.items() if info.default is not None and ANY_NAME not in name}
    for name, topic in (values | process.parameters).items():
        info = infos.get(declared_as(name, infos) or "")
        if info is not None and isinstance(topic, str) and names.is_name(topic):  # else it is refused itself
            end = _end(process, "sub", topic, info.subscribes or "", None)
            yield msgspec.structs.replace(end, written=position_of(process, name))


def _end(process: ProcessPlan, kind: EndpointKind, topic: str, type_name: str, qos: QoS | None) -> TopicEnd:
    key = names.resolve(topic, namespace=process.namespace, node=process.name, remappings=process.remap)
    if qos is not None and key in process.qos:
        qos = process.qos[key].over(qos)
    return TopicEnd(process.full_name, kind, key, type_name, topic, qos)


def _type_clashes(key: str, ends: Sequence[TopicEnd], resolution: Resolution) -> Iterable[Problem]:
    first, *others = [end for end in ends if end.type] or ends[:1]
    for other in others:
        if other.type != first.type:
            where = resolution.positions[first.node]
            text = f"two types on {key}: {other}, but {first} (in {where})"
            yield Problem(resolution.positions[other.node], text)


def _unfed(
    key: str,
    ends: Sequence[TopicEnd],
    all_ends: Sequence[TopicEnd],
    promised: Mapping[str, TopicPlan],
    resolution: Resolution,
) -> Iterable[Problem]:
    if any(end.kind == "pub" for end in ends) or (key in promised and promised[key].external):
        return
    if _every_node_publishes(key, resolution):
        return
    for end in ends:
        candidates = [o for o in all_ends if o.kind == "pub" and o.type == end.type and o.node != end.node]
        promise = "promise it: topics: {" + end.topic + ": {external: true}}"
        close = closest(key, [other.key for other in candidates], cutoff=0.0)
        if close is not None:
            other = next(other for other in candidates if other.key == close)
            which = "remap one of them" if end.written is None else "name that, if it is meant"
            advice = f"{other.node} publishes this type on {other.key}: {which}; if it comes from outside, {promise}"
        else:
            advice = f"start a node that does, or {promise}"
        position = end.written or resolution.positions[end.node]
        yield Problem(position, f"nothing publishes {key}, which {end}; {advice}")


def _every_node_publishes(key: str, resolution: Resolution) -> bool:
    """Whether it is a topic that the runtime gives every node, of a namespace in which there is one."""
    namespace, _, topic = key.rpartition("/")
    nodes = (p for p in resolution.plan.processes if p.service is not None)
    return topic in SYSTEM_TOPICS and any(p.namespace == namespace for p in nodes)


def _may_be_fed(problem: Problem, silent: Sequence[str]) -> Problem:
    nodes = ", ".join(silent)
    return problem._replace(text=f"{problem.text} (unless {nodes} does: say it with publishes: {{topic: type}})")


def _unread(
    key: str, ends: Sequence[TopicEnd], promised: Mapping[str, TopicPlan], resolution: Resolution
) -> Iterable[Problem]:
    if any(end.kind == "sub" for end in ends) or key in promised:
        return
    for end in ends:
        if end.type not in BROADCAST_TYPES | SYSTEM_TYPES:
            yield Problem(resolution.positions[end.node], f"nobody reads {key}, which {end}")


def _that_may_publish(resolution: Resolution) -> list[str]:
    """Commands that do not say what they publish."""
    return [
        process.full_name
        for process in resolution.plan.processes
        if process.service is None and not process.publishes and not process.subscribes
    ]


def _unknown_remaps(resolution: Resolution) -> Iterable[Problem]:
    """Remappings of names that the node does not have; of a group, that none of its nodes has."""
    used: set[Position] = set()
    unused: dict[tuple[Position, str], list[ProcessPlan]] = {}
    declared: dict[str, list[str]] = {}
    for process in resolution.plan.processes:
        topics = [*_declared(resolution, process, "pub"), *_declared(resolution, process, "sub")]
        own = declared[process.full_name] = [topic for topic, *_ in topics]
        if contract := resolution.contracts.get(process.full_name):
            own += [end.service for end in (*contract.services, *contract.clients)]
            own += [action.action for action in contract.actions]
            own += [client.action for client in contract.action_clients]
        keys = {names.resolve(name, namespace=process.namespace, node=process.name) for name in own}
        silent = not own and process.full_name not in resolution.contracts
        for old, origin in resolution.remaps.get(process.full_name, {}).items():
            if silent or names.resolve(old, namespace=process.namespace, node=process.name) in keys:
                used.add(origin.position)
            else:
                unused.setdefault((origin.position, old), []).append(process)
    for (position, old), processes in unused.items():
        if position in used:
            continue
        instead = suggest(old, [name for process in processes for name in declared[process.full_name]])
        first = processes[0]
        if len(processes) == 1:
            owner = f"{first.full_name} ({first.service or 'a command'}) has no"
        else:
            owner = f"none of {', '.join(process.full_name for process in processes)} has a"
        yield Problem(position, f"remap {old} to {first.remap[old]}: {owner} topic or service {shown(old)}; {instead}")


def _never_held(resolution: Resolution) -> Iterable[Problem]:
    """Plain nodes that their manifest wants to wait: they would not."""
    for process in resolution.plan.processes:
        contract = resolution.contracts.get(process.full_name)
        if not process.autostart and contract is not None and not contract.managed:
            text = f"autostart: false, but {contract.class_name} is a plain node, which begins to work at its start"
            advice = "a managed one derives from robo.LifecycleNode"
            yield Problem(resolution.positions[process.full_name], f"{process.full_name} says {text}; {advice}")


def _promise(topic: TopicPlan, by_key: Mapping[str, Sequence[TopicEnd]], *, may_be_served: bool) -> Iterable[Problem]:
    ends = by_key.get(topic.key, ())
    if not topic.external and not may_be_served and not any(end.kind == "pub" for end in ends):
        meant = hint(topic.key, by_key, "; if it comes from outside, say external: true")
        yield Problem(topic.source, f"nobody publishes {topic.key}, which is promised here{meant}")
    if topic.type is None:
        return
    for end in ends:
        if end.type not in (topic.type, ""):
            yield Problem(topic.source, f"{topic.key} is promised as {topic.type}, but {end}")
    known = robo_messages.type_names()
    if topic.type not in known and not any(end.type == topic.type for end in ends):
        close = closest(topic.type, known, cutoff=0.75)
        if close is not None:
            yield Problem(topic.source, f"{topic.key}: there is no type {shown(topic.type)}; did you mean {close}?")
