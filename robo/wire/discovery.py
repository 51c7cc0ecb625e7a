"""Who is there, by liveliness tokens that name nodes, publishers and subscriptions; and on which machine."""

import os
import pwd
import threading
from collections.abc import Iterable

import zenoh

from robo.wire.keys import ALL_TOKENS, EndpointToken, NodeToken, parse_token, tokens_of_publishers
from robo.wire.liveliness import every, hear


def tokens(session: zenoh.Session, timeout: float, keys: str = ALL_TOKENS) -> list[NodeToken | EndpointToken]:
    """Every node and every end of a topic or service that this session can see.

    Args:
        session: whose network to ask on.
        timeout: how long to wait for routers that do not answer, and for a link that is lost, s.
        keys: which of them; a router's time for an answer grows with the square of its tokens.
    """
    found = map(parse_token, every(session, keys, timeout))
    return [token for token in found if isinstance(token, NodeToken | EndpointToken)]


def publishers_of(session: zenoh.Session, topic: str, timeout: float) -> list[EndpointToken]:
    """The publishers of a topic that nodes have announced.

    Args:
        session: whose network to ask on.
        topic: the key expression.
        timeout: how long to wait for routers that do not answer, and for a link that is lost, s.
    """
    found = map(parse_token, every(session, tokens_of_publishers(topic), timeout))
    return [token for token in found if isinstance(token, EndpointToken)]


def hostname() -> str:
    """This machine's name, as a chunk of a key may hold it."""
    return _as_chunk(os.uname().nodename)


def user() -> str:
    """The name of the user whose process this is, as a chunk of a key may hold it."""
    try:
        return _as_chunk(pwd.getpwuid(os.geteuid()).pw_name)
    except KeyError:  # a number that has no name, as containers have them
        return str(os.geteuid())


def wait_for_nodes(session: zenoh.Session, full_names: Iterable[str], timeout: float) -> set[str]:
    """Wait until this session sees each of these nodes ready, and return those it does not see.

    Peers of one robot see a token only over their direct link, where declarations travel in order:
    whoever sees a node's token already knows its subscriptions, and loses no message to it.

    Args:
        session: the session that wants to see them.
        full_names: for example `/r1/position_tracker`.
        timeout: in s.
    """
    wanted = frozenset(full_names)
    if not wanted:
        return set()
    changed = threading.Condition()
    seen: set[str] = set()

    def notice(sample: zenoh.Sample) -> None:
        token = parse_token(str(sample.key_expr))
        if sample.kind == zenoh.SampleKind.PUT and isinstance(token, NodeToken) and token.full_name in wanted:
            with changed:
                seen.add(token.full_name)
                changed.notify()

    subscriber = hear(session, ALL_TOKENS, notice)
    with changed:
        changed.wait_for(lambda: seen == wanted, timeout)
        missing = wanted - seen
    subscriber.undeclare()
    return set(missing)


def _as_chunk(text: str) -> str:
    return "".join(c if c.isalnum() or c in "._-" else "_" for c in text) or "_"
