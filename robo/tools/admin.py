"""What Zenoh routers know, by their own account: who is connected to them, and what is declared."""

from collections.abc import Iterator
from typing import Any, Literal

import msgspec
import zenoh

Kind = Literal["publisher", "subscriber"]

_KINDS: tuple[Kind, ...] = ("publisher", "subscriber")


class Link(msgspec.Struct, frozen=True):
    """A connection between two processes, as one of them sees it."""

    src: str
    """The near end's locator."""
    dst: str


class RouterSession(msgspec.Struct, frozen=True):
    """A process that is connected to a router."""

    zid: str
    whatami: str
    """`router`, `peer` or `client`."""
    links: list[Link]


class Router(msgspec.Struct, frozen=True):
    """A Zenoh router."""

    zid: str
    name: str
    """What it calls itself; empty where it has no name."""
    version: str
    locators: list[str]
    """Where it listens."""
    sessions: list[RouterSession]


def declared(session: zenoh.Session, timeout: float) -> Iterator[tuple[Kind, str, str]]:
    """Publishers and subscribers of all processes: what it is, its key, the id of the process.

    Subscribers to patterns are left out: they watch, and make no topic. So is this session itself.
    """
    own = str(session.zid())
    for kind in _KINDS:
        for reply in session.get(f"@/*/router/{kind}/**", timeout=timeout):
            if reply.ok is None:
                continue
            key = str(reply.ok.key_expr).split("/", 4)[4]
            if "*" in key or key.startswith("@"):
                continue
            data = _read(reply.ok)
            for zid in {*data.get("peers", ()), *data.get("clients", ())}:
                if zid != own:
                    yield kind, key, str(zid)


def routers(session: zenoh.Session, timeout: float) -> list[Router]:
    """The routers of the network, sorted by name."""
    found = []
    for reply in session.get("@/*/router", timeout=timeout):
        if reply.ok is None:
            continue
        data = _read(reply.ok)
        metadata = data.get("metadata")
        sessions = [
            RouterSession(
                str(one.get("peer", "")),
                str(one.get("whatami", "")),
                [Link(str(link.get("src", "")), str(link.get("dst", ""))) for link in one.get("links", ())],
            )
            for one in data.get("sessions", ())
        ]
        found.append(
            Router(
                str(data.get("zid", "")),
                str(metadata.get("name", "")) if isinstance(metadata, dict) else "",
                str(data.get("version", "")).partition("-")[0].removeprefix("v"),
                [str(locator) for locator in data.get("locators", ())],
                sessions,
            )
        )
    return sorted(found, key=lambda router: (router.name, router.zid))


def _read(sample: zenoh.Sample) -> dict[str, Any]:
    try:
        data = msgspec.json.decode(sample.payload.to_bytes())
    except (msgspec.DecodeError, UnicodeDecodeError):
        return {}
    return data if isinstance(data, dict) else {}
