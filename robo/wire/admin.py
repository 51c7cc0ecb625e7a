"""What Zenoh routers know, by their own account: who is connected to them, and what is declared.

A router of Zenoh 1.10.2 that says what is declared while somebody declares something new may stand still for good (its
tables are locked twice by one thread: eclipse-zenoh/zenoh pull request 2619). Therefore it is asked only where somebody
is connected that is not robo's, and of as few keys as will do: an answer without a key does no harm.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import TypeVar

import msgspec
import zenoh

from robo.text.readable import readable
from robo.text.unreadable import UNREADABLE
from robo.wire import access
from robo.wire.ids import is_robos
from robo.wire.keys import EndpointKind

T = TypeVar("T")

_ENDS: dict[str, EndpointKind] = {"publisher": "pub", "subscriber": "sub"}
"""Kinds of ends by the words of Zenoh's keys."""


class RouterLink(msgspec.Struct, frozen=True):
    """A connection between two processes, as one of them sees it."""

    src: str = ""
    """The near end's locator."""
    dst: str = ""


class RouterSession(msgspec.Struct, frozen=True):
    """A process that is connected to a router."""

    zid: str
    whatami: str
    """`router`, `peer` or `client`."""
    links: list[RouterLink]


class RouterInfo(msgspec.Struct, frozen=True):
    """A Zenoh router."""

    zid: str
    name: str
    """What it calls itself; empty where it has no name."""
    version: str
    locators: list[str]
    """Where it listens."""
    sessions: list[RouterSession]


def declared_by_others(
    session: zenoh.Session, keys: Sequence[str], timeout: float
) -> Iterator[tuple[EndpointKind, str, str]]:
    """Publishers and subscribers of processes that are not robo's: what it is, its key, the id of the process.

    Subscribers to patterns are left out: they watch, and make no topic. So is this session itself.

    Args:
        session: the network.
        keys: of which topics; `**` for all.
        timeout: how long a router may take to answer, s.
    """
    if not keys:
        return
    own = str(session.zid())
    asked = [(router, word, key) for router in _with_others(session, own, timeout) for word in _ENDS for key in keys]
    for router, word, wanted in asked:
        for reply in session.get(f"@/{router}/router/{word}/{wanted}", timeout=timeout):
            if reply.ok is None:
                continue
            key = "/".join(str(reply.ok.key_expr).split("/")[4:])
            if not key or "*" in key or key.startswith("@"):
                continue
            told = _read(reply.ok, _Declared)
            for zid in {*told.peers, *told.clients}:
                if zid != own and not is_robos(zid):
                    yield _ENDS[word], key, zid


def _with_others(session: zenoh.Session, own: str, timeout: float) -> list[str]:
    """The ids of the routers to which somebody is connected that is not robo's; routers do not count."""
    return [
        router.zid
        for router in routers(session, timeout)
        if any(one.whatami != "router" and one.zid != own and not is_robos(one.zid) for one in router.sessions)
    ]


def routers(session: zenoh.Session, timeout: float) -> list[RouterInfo]:
    """The routers of the network, sorted by name."""
    found = []
    for reply in session.get("@/*/router", timeout=timeout):
        if reply.ok is None:
            continue
        told = _read(reply.ok, _Router)
        name = told.metadata.get("name") if isinstance(told.metadata, dict) else None
        version = told.version.partition("-")[0].removeprefix("v")
        found.append(RouterInfo(told.zid, str(name or ""), version, told.locators, _sessions(told)))
    return sorted(found, key=lambda router: (router.name, router.zid))


def linked_to(session: zenoh.Session, timeout: float) -> list[RouterSession] | None:
    """Who is connected to the router of which a session is a client, and to its door; None where it does not say.

    The door is the router by which a robot's router meets others with security on: both are linked by a unix socket.
    """
    for zid in session.info.routers_zid():
        found = _connected_to(session, str(zid), timeout)
        if found is not None:
            doors = [one.zid for one in found if one.whatami == "router" and any(map(_is_local, one.links))]
            return [*found, *(one for door in doors for one in _connected_to(session, door, timeout) or ())]
    return None


def _is_local(link: RouterLink) -> bool:
    return link.dst.startswith("unixsock-stream/") or link.src.startswith("unixsock-stream/")


def _connected_to(session: zenoh.Session, zid: str, timeout: float) -> list[RouterSession] | None:
    for reply in session.get(f"@/{zid}/router", timeout=timeout):
        told = _decoded(reply.ok, _Router) if reply.ok is not None else None
        if told is not None:
            return _sessions(told)
    return None


class Door(msgspec.Struct, frozen=True):
    """How a router is open to those who come by a network link: they look."""

    owner: str
    """The name of the user whose it is."""
    shared: tuple[str, ...] = ()
    """The robots, by namespace, with which they may do all."""


def door_of(session: zenoh.Session, zid: str, timeout: float) -> Door | None:
    """How a router is open to others; None where it is to be used by whoever comes, or does not say."""
    for reply in session.get(f"@/{zid}/router", timeout=timeout):
        told = _decoded(reply.ok, _Router) if reply.ok is not None else None
        if told is None or not isinstance(told.metadata, dict) or told.metadata.get("others") != access.LOOKS:
            continue
        with suppress(msgspec.ValidationError):
            return msgspec.convert(told.metadata, readable(Door))
    return None


class _Declared(msgspec.Struct):
    """What a router says of a publisher or a subscriber: the ids of the processes that have declared it."""

    peers: list[str] = []
    clients: list[str] = []


class _Session(msgspec.Struct):
    peer: str = ""
    whatami: str = ""
    links: list[RouterLink] = []


class _Router(msgspec.Struct):
    zid: str = ""
    version: str = ""
    locators: list[str] = []
    sessions: list[_Session] = []
    metadata: object = None


def _read(sample: zenoh.Sample, kind: type[T]) -> T:
    """What a router says; nothing at all where it is something else that answers."""
    return _decoded(sample, kind) or kind()


def _decoded(sample: zenoh.Sample, kind: type[T]) -> T | None:
    try:
        return msgspec.json.decode(sample.payload.to_bytes(), type=readable(kind))
    except UNREADABLE:
        return None


def _sessions(told: _Router) -> list[RouterSession]:
    return [RouterSession(one.peer, one.whatami, one.links) for one in told.sessions]
