"""What running nodes offer to be called by others: services and actions."""

from collections.abc import Mapping
from typing import Literal

import msgspec
import zenoh

from robo.errors import ActionError, RoboError, ServiceTimeout
from robo.text.suggestions import suggest
from robo.wire.discovery import tokens
from robo.wire.keys import EndpointToken
from robo.wire.names import shown_key


class Offer(msgspec.Struct, frozen=True):
    """A service that somebody serves, or an action that somebody executes."""

    key: str
    type: str
    servers: list[str]
    """Full names of nodes; more than one is a clash."""
    clients: list[str] = []
    """Full names of nodes that may call it, or send goals."""


def list_services(session: zenoh.Session, timeout: float = 1.0) -> list[Offer]:
    """Every service that somebody serves, sorted by key."""
    return _offers(session, "srv", "cli", timeout)


def list_actions(session: zenoh.Session, timeout: float = 1.0) -> list[Offer]:
    """Every action that somebody executes, sorted by key."""
    return _offers(session, "act", "acl", timeout)


def find_service(session: zenoh.Session, key: str, timeout: float) -> Offer:
    """The service of a key.

    Raises:
        ServiceTimeout: nobody serves it; says what comes close.
    """
    there = {one.key: one for one in list_services(session, timeout)}
    return _of(there, key, "serves", ServiceTimeout)


def find_action(session: zenoh.Session, key: str, timeout: float) -> Offer:
    """The action of a key.

    Raises:
        ActionError: nobody executes it; says what comes close.
    """
    there = {one.key: one for one in list_actions(session, timeout)}
    return _of(there, key, "executes", ActionError)


def _of(there: Mapping[str, Offer], key: str, does: str, missing: type[RoboError]) -> Offer:
    if key in there:
        return there[key]
    raise missing(f"nobody {does} {shown_key(key)}; {suggest(key, there)}")


def _offers(
    session: zenoh.Session, serves: Literal["srv", "act"], calls: Literal["cli", "acl"], timeout: float
) -> list[Offer]:
    ends = [token for token in tokens(session, timeout) if isinstance(token, EndpointToken)]
    found: dict[str, Offer] = {}
    for token in ends:
        if token.kind == serves:
            found.setdefault(token.topic, Offer(token.topic, token.type_name, [], [])).servers.append(token.full_name)
    for token in ends:
        if token.kind == calls and token.topic in found:
            found[token.topic].clients.append(token.full_name)
    return [found[key] for key in sorted(found)]
