"""Which nodes and services there are, by their liveliness tokens."""

import difflib

import msgspec
import zenoh

from robo import names
from robo.discovery import ALL_TOKENS, EndpointToken, NodeToken, parse_token
from robo.errors import NodeNotFound


class ServiceInfo(msgspec.Struct, frozen=True):
    """A service that somebody serves."""

    key: str
    type: str
    servers: list[str]
    """Full names of nodes; more than one is a clash."""


def list_nodes(session: zenoh.Session, timeout: float = 1.0) -> list[NodeToken]:
    """Every node, sorted by full name."""
    found = [token for token in _tokens(session, timeout) if isinstance(token, NodeToken)]
    return sorted(found, key=lambda token: token.full_name)


def list_services(session: zenoh.Session, timeout: float = 1.0) -> list[ServiceInfo]:
    """Every service, sorted by key."""
    found: dict[str, ServiceInfo] = {}
    for token in _tokens(session, timeout):
        if isinstance(token, EndpointToken) and token.kind == "srv":
            info = found.setdefault(token.topic, ServiceInfo(token.topic, token.type_name, []))
            info.servers.append("/" + names.join(token.namespace, token.node))
    return [found[key] for key in sorted(found)]


def find_node(nodes: list[NodeToken], name: str) -> NodeToken:
    """The node that somebody means: its full name, or its name where only one has it.

    Raises:
        NodeNotFound: there is none, or several; says what there is.
    """
    wanted = name.strip("/")
    whole = [node for node in nodes if node.full_name == f"/{wanted}"]
    if whole:
        return whole[0]
    same = [node for node in nodes if node.node == wanted]
    if len(same) == 1:
        return same[0]
    if same:
        raise NodeNotFound(f"several nodes are named {name}: {', '.join(node.full_name for node in same)}")
    known = {other: node.full_name for node in nodes for other in (node.full_name.strip("/"), node.node)}
    close = difflib.get_close_matches(wanted, known, n=1)
    there = ", ".join(node.full_name for node in nodes) or "none"
    hint = f"did you mean {known[close[0]]}?" if close else f"there is {there}"
    raise NodeNotFound(f"there is no node {name}; {hint}")


def _tokens(session: zenoh.Session, timeout: float) -> list[NodeToken | EndpointToken | None]:
    replies = session.liveliness().get(ALL_TOKENS, timeout=timeout)
    return [parse_token(str(reply.ok.key_expr)) for reply in replies if reply.ok is not None]
