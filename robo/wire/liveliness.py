"""Tokens that tell who is there: to hear of them as they come and go, and to ask for all of them.

A client of Zenoh 1.10.2 that hears of tokens may be answered with none, or with some, when it asks for them. Those
that it knows it tells itself, on the thread that asks. What the router answers is left out, as far as it is known, on
another thread; and where that one is first, on a busy machine in one of five, the question ends there. One that has not
heard of any is told all by the router, so who does asks by a second session.
"""

from collections.abc import Iterator
from typing import Any

import zenoh

from robo.wire.relinking import over_losses
from robo.wire.session import beside

_hearing: set[str] = set()
"""The ids of the sessions that hear of tokens, or have done so: they know on what they knew."""


def hear(session: zenoh.Session, keys: str, handler: Any) -> Any:
    """Hear of tokens: of those that are there, and of each that comes or goes, until what is returned is undeclared.

    Args:
        session: the network.
        keys: which tokens.
        handler: what Zenoh takes for one: a channel, or what is called.
    """
    _hearing.add(str(session.zid()))
    return session.liveliness().declare_subscriber(keys, handler, history=True)


def ask(session: zenoh.Session, keys: str, timeout: float) -> Iterator[str]:
    """The keys of the tokens that are there. They are asked for at once, and waited for as they are taken.

    Args:
        session: the network.
        keys: which tokens.
        timeout: how long to wait for routers that do not answer, s.
    """
    return _ask(_asking(session, timeout), keys, timeout)


def every(session: zenoh.Session, keys: str, timeout: float) -> list[str]:
    """The same, once all are known; asked again where a client's link was lost meanwhile.

    Args:
        session: the network.
        keys: which tokens.
        timeout: how long to wait for routers that do not answer, and for a link that is lost, s.
    """
    asking = _asking(session, timeout)
    return over_losses(asking, lambda: list(_ask(asking, keys, timeout)), timeout)


def _asking(session: zenoh.Session, timeout: float) -> zenoh.Session:
    """By which session to ask."""
    return (beside(session, timeout) if str(session.zid()) in _hearing else None) or session


def _ask(session: zenoh.Session, keys: str, timeout: float) -> Iterator[str]:
    replies = session.liveliness().get(keys, timeout=timeout)
    return (str(reply.ok.key_expr) for reply in replies if reply.ok is not None)
