"""The Zenoh network as one process sees it, and why two nodes do not see each other."""

import time
from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import product

import msgspec
import zenoh

from robo.errors import NodeUnreachable
from robo.text.graph import SYSTEM_TYPES
from robo.text.suggestions import closest
from robo.tools import nodes, refusals, runs
from robo.tools.refusals import Told
from robo.wire import admin, discovery, listeners, meeting
from robo.wire.admin import RouterInfo, RouterLink
from robo.wire.discovery import hostname
from robo.wire.keys import VERBS, EndpointKind, EndpointToken, NodeToken
from robo.wire.network import RENDEZVOUS
from robo.wire.reports import NodeStatus

_PINGS = 5
_CLOCKS_AGREE = 0.02
"""A difference of clocks that is worth a word, s."""


class NodeOnNet(msgspec.Struct, frozen=True):
    """A node and how it is reached."""

    node: str
    host: str
    pid: int
    zid: str
    """Empty where it does not answer."""
    links: list[str]
    """Nodes, routers and other processes to which it is linked directly."""
    latency: float | None
    """A query and its answer, the best of some, s."""
    clock: float | None
    """How far its clock is ahead of this machine's, s, give or take half the latency."""


class NetworkView(msgspec.Struct, frozen=True):
    """What is seen of the network from here."""

    host: str
    zid: str
    links: list[RouterLink]
    """To routers, as this process has them."""
    latency: float | None
    """To the nearest router and back, s."""
    routers: list[RouterInfo]
    nodes: list[NodeOnNet]
    names: dict[str, str]
    """What is known of Zenoh ids: the node or router that has it."""
    problems: list[str]
    refused: list[Told]
    """What secured routers have refused."""


class Reason(msgspec.Struct, frozen=True):
    """Something about two nodes."""

    fine: bool
    text: str


def look(session: zenoh.Session, timeout: float) -> NetworkView:
    """Ask routers and nodes who they are linked to."""
    routers = admin.routers(session, timeout)
    tokens = nodes.list_nodes(session, timeout)
    status = nodes.all_status(session, timeout)
    names = {status_.zid: name for name, status_ in status.items()}
    for router in routers:
        # A node that is run alone is its own router.
        names.setdefault(router.zid, f"router of {router.name}" if router.name else "router")
    for one in runs.supervisors(session, timeout=timeout):
        names.setdefault(one.zid, f"supervisor of {one.robot}{f' on {one.part}' if one.part else ''}")
    own = str(session.zid())
    found = [_node(session, token, status.get(token.full_name), names, timeout) for token in tokens]
    return NetworkView(
        hostname(),
        own,
        [RouterLink(str(link.src), str(link.dst)) for link in session.info.links()],
        _latency(session, timeout),
        routers,
        found,
        names,
        [*_problems(routers, found, status), *runs.lost_sites(session, timeout=timeout), *_doors(session, timeout)],
        sorted(refusals.told(session, timeout), key=lambda one: one.router),
    )


def _doors(session: zenoh.Session, timeout: float) -> list[str]:
    """Who else holds the port at which others would look at the robots of this user, whom this session has met."""
    if not any(str(link.dst) == meeting.endpoint() for link in session.info.links()):
        return []
    there = listeners.in_the_way([RENDEZVOUS], timeout)
    return [f"{holder}: your robots do not dial it, and others do not see them there" for holder in there]


def _node(
    session: zenoh.Session, token: NodeToken, status: NodeStatus | None, names: Mapping[str, str], timeout: float
) -> NodeOnNet:
    if status is None:
        return NodeOnNet(token.full_name, token.host, token.pid, "", [], None, None)
    best, clock = _clock(session, token, timeout)
    links = sorted(names.get(zid, f"zenoh:{zid}") for zid in status.links)
    return NodeOnNet(token.full_name, token.host, token.pid, status.zid, links, best, clock)


def _clock(session: zenoh.Session, token: NodeToken, timeout: float) -> tuple[float | None, float | None]:
    """The best round trip to a node, and how far its clock is ahead of this machine's, s."""
    best, clock = None, None
    for _ in range(_PINGS):
        begin, wall = time.monotonic(), time.time()
        try:
            answer = nodes.node_status(session, token, timeout)
        except NodeUnreachable:
            break
        took = time.monotonic() - begin
        if best is None or took < best:
            best, clock = took, answer.time * 1e-9 - (wall + took / 2)
    return best, clock


def clocks_off(session: zenoh.Session, names: Collection[str], timeout: float) -> dict[str, str]:
    """Of some nodes, those whose clocks differ from this machine's, and what is to be said of each."""
    found = {}
    for token in nodes.list_nodes(session, timeout):
        if token.full_name in names:
            best, clock = _clock(session, token, timeout)
            if clock is not None and abs(clock) > _CLOCKS_AGREE + (best or 0.0):
                found[token.full_name] = _differs(token.full_name, token.host, clock)
    return found


def _differs(node: str, host: str, clock: float) -> str:
    return f"the clock of {node} on {host} is {clock:+.3f} s off: so are delays"


def _latency(session: zenoh.Session, timeout: float) -> float | None:
    routers = session.info.routers_zid()
    best = None
    for _ in range(_PINGS if routers else 0):
        begin = time.monotonic()
        answered = [r for r in session.get(f"@/{routers[0]}/router", timeout=timeout) if r.ok is not None]
        if answered:
            took = time.monotonic() - begin
            best = took if best is None else min(best, took)
    return best


def _problems(
    routers: Sequence[RouterInfo], found: Sequence[NodeOnNet], status: Mapping[str, NodeStatus]
) -> Iterable[str]:
    for node in found:
        if not node.zid:
            yield f"{node.node} is there and does not answer: robo why {node.node}"
        elif node.clock is not None and abs(node.clock) > _CLOCKS_AGREE + (node.latency or 0.0):
            yield _differs(node.node, node.host, node.clock)
    # The nodes of one robot are linked directly: with each other, or not at all.
    peers = {one.zid: router for router in routers for one in router.sessions if one.whatami == "peer"}
    for a in found:
        for b in found:
            same = a.zid and b.zid and a.node < b.node and peers.get(a.zid) is not None
            if same and peers.get(a.zid) is peers.get(b.zid) and b.zid not in status[a.node].links:
                yield f"{a.node} and {b.node} meet at one router and are not linked: robo net {a.node} {b.node}"


def why(session: zenoh.Session, a_name: str, b_name: str, timeout: float) -> list[Reason]:
    """What connects two nodes, and what does not."""
    tokens = nodes.list_nodes(session, timeout)
    found = []
    reasons: list[Reason] = []
    for name in (a_name, b_name):
        missing = _missing(session, tokens, name)
        if missing is not None:
            reasons.append(Reason(False, missing))
        else:
            found.append(nodes.find_node(tokens, name))
    if len(found) < 2:
        return reasons
    a, b = found
    return [*_linked(session, a, b, timeout), *_talk(session, a, b, timeout)]


def _missing(session: zenoh.Session, tokens: Sequence[NodeToken], name: str) -> str | None:
    """Why a node is not on this network; None where it is.

    Raises:
        NodeNotFound: several have that name.
    """
    wanted = name.strip("/")
    if any(wanted in (token.full_name.strip("/"), token.node) for token in tokens):
        return None
    for process in runs.processes(session):
        if wanted in (process.node.strip("/"), process.node.rpartition("/")[2]):
            reason = f": {process.reason}" if process.reason else ""
            return f"{process.node} is {process.state}{reason}; it is not on the network: robo why {process.node}"
    close = closest(wanted, [token.full_name.strip("/") if "/" in wanted else token.node for token in tokens])
    hint = f"did you mean {close}?" if close else "is it started, and on this network? another one: --connect"
    return f"there is no node {name} on this network; {hint}"


def _linked(session: zenoh.Session, a: NodeToken, b: NodeToken, timeout: float) -> Iterable[Reason]:
    status: dict[str, NodeStatus] = {}
    for node in (a, b):
        try:
            status[node.full_name] = nodes.node_status(session, node, timeout)
        except NodeUnreachable as error:
            yield Reason(False, f"{error}: a callback may be stuck, or the process stopped: robo why {node.full_name}")
    if len(status) < 2:
        return
    one, other = status[a.full_name], status[b.full_name]
    where = "on one host" if a.host == b.host else f"on {a.host} and {b.host}"
    if one.zid == other.zid:
        yield Reason(True, f"they are in one process on {a.host}")
        return
    if other.zid in one.links:
        yield Reason(True, f"they are linked directly, {where}")
        return
    routers = {router.zid: router for router in admin.routers(session, timeout)}
    mine, theirs = ({zid for zid in (s.zid, *s.links) if zid in routers} for s in (one, other))
    if mine & theirs:
        shared = routers[next(iter(mine & theirs))]
        kinds = {s.zid: s.whatami for s in shared.sessions}
        if kinds.get(one.zid) == kinds.get(other.zid) == "peer":
            text = (
                f"both are peers of the router {shared.name or shared.zid} and not linked with each other; a router "
                f"does not pass messages between its peers. Can {a.host} reach where {b.full_name} listens?"
            )
            yield Reason(False, text)
        else:
            yield Reason(True, f"they meet at the router {shared.name or shared.zid}, {where}")
        return
    joined = _joined(routers, mine)
    if joined & theirs:
        names = " and ".join(sorted({routers[zid].name or zid for zid in mine | theirs}))
        yield Reason(True, f"their routers are linked ({names}), {where}")
    else:
        listens = ", ".join(sorted(place for zid in mine for place in routers[zid].locators)) or "nowhere"
        text = f"their routers are not linked: {a.full_name} is behind {listens}; let the other router --connect there"
        yield Reason(False, text)


def _joined(routers: Mapping[str, RouterInfo], begin: set[str]) -> set[str]:
    """The routers that can be reached from some."""
    reached, todo = set(begin), list(begin)
    while todo:
        router = routers.get(todo.pop())
        for one in router.sessions if router is not None else ():
            if one.zid in routers and one.zid not in reached:
                reached.add(one.zid)
                todo.append(one.zid)
    return reached


def _talk(session: zenoh.Session, a: NodeToken, b: NodeToken, timeout: float) -> Iterable[Reason]:
    ends: dict[str, list[EndpointToken]] = {a.full_name: [], b.full_name: []}
    for token in discovery.tokens(session, timeout):
        if isinstance(token, EndpointToken):
            ends.setdefault(token.full_name, []).append(token)
    talks = False
    for kinds, (x, y) in product(_PAIRS, ((a, b), (b, a))):
        for given, taken in product(ends[x.full_name], ends[y.full_name]):
            if (given.kind, taken.kind) != kinds or given.topic != taken.topic:
                continue
            talks = True
            text = f"{given.topic}: {x.full_name} {VERBS[given.kind]}, {y.full_name} {VERBS[taken.kind]}"
            if given.type_name == taken.type_name:
                yield Reason(True, f"{text} ({given.type_name})")
            else:
                yield Reason(False, f"{text}, but as {given.type_name} and {taken.type_name}: nothing arrives")
    if not talks:
        yield from between(a.full_name, b.full_name, ends) or nearly(a.full_name, b.full_name, ends)


_PAIRS: tuple[tuple[EndpointKind, EndpointKind], ...] = (("pub", "sub"), ("srv", "cli"), ("act", "acl"))
"""Kinds of ends that meet."""


def between(a: str, b: str, ends: Mapping[str, Sequence[EndpointToken]]) -> list[Reason]:
    """Nodes by which one of two reaches the other: they read what it publishes, and publish what the other reads.

    Or several, each of which passes on what the one before it says.
    Such nodes are there on purpose, as a safety monitor is: that the two share no topic is no fault.
    """
    found = []
    for x, y in ((a, b), (b, a)):
        given, wanted = _topics(ends, x, "pub"), _topics(ends, y, "sub")
        for middle in sorted(ends.keys() - {a, b}):
            for read in sorted(given & _topics(ends, middle, "sub")):
                for written in sorted(wanted & _topics(ends, middle, "pub")):
                    way = f"{x} publishes {read}, {middle} subscribes it and publishes {written}, {y} subscribes that"
                    found.append(Reason(True, f"{way}: {middle} stands between them"))
    return found or [reason for x, y in ((a, b), (b, a)) if (reason := _chained(x, y, ends)) is not None]


def _chained(x: str, y: str, ends: Mapping[str, Sequence[EndpointToken]]) -> Reason | None:
    """The shortest chain of nodes that pass on messages of one type from one node to another."""
    ways = [[(x, end)] for end in ends[x] if end.kind == "pub" and end.type_name not in SYSTEM_TYPES]
    seen = {end.topic for way in ways for _, end in way}
    while ways:
        longer = []
        for way in ways:
            last = way[-1][1]
            for node, theirs in sorted(ends.items()):
                if not any((e.kind, e.topic, e.type_name) == ("sub", last.topic, last.type_name) for e in theirs):
                    continue
                if node == y:
                    said = [f"{one} publishes {end.topic}" for one, end in way]
                    chain = ", ".join(one for one, _ in way[1:])
                    return Reason(True, f"{', '.join(said)}, {y} subscribes that: {chain} stand between them")
                for end in theirs:
                    if end.kind == "pub" and end.type_name == last.type_name and end.topic not in seen:
                        seen.add(end.topic)
                        longer.append([*way, (node, end)])
        ways = longer
    return None


def _topics(ends: Mapping[str, Sequence[EndpointToken]], node: str, kind: EndpointKind) -> set[str]:
    return {end.topic for end in ends[node] if end.kind == kind and end.type_name not in SYSTEM_TYPES}


def nearly(a: str, b: str, ends: Mapping[str, Sequence[EndpointToken]]) -> list[Reason]:
    """Topics of one type that may have been meant to be one."""
    near = []
    for x, y in ((a, b), (b, a)):
        inputs = [end for end in ends[y] if end.kind == "sub"]
        for out in ends[x]:
            same = [end.topic for end in inputs if end.type_name == out.type_name] if out.kind == "pub" else []
            close = closest(out.topic, same) or next(iter(same), None)
            if close is not None:
                text = f"{x} publishes {out.topic}, {y} subscribes {close}, both {out.type_name}"
                near.append(Reason(False, f"{text}: remap one of them, or start both with one --robot-name"))
    return near or [Reason(False, "they have no topic and no service in common, nor two of one type")]
