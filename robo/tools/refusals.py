"""What the routers of a secured network have refused, as they tell it."""

from collections.abc import Iterator

import msgspec
import zenoh

from robo.security.refusals import Count
from robo.text.readable import readable
from robo.text.unreadable import UNREADABLE
from robo.wire import names
from robo.wire.keys import refusals_key
from robo.wire.targets import OF_ALL


class Told(msgspec.Struct, frozen=True):
    """What one router tells."""

    router: str
    counts: list[Count]


def told(session: zenoh.Session, timeout: float) -> Iterator[Told]:
    """What each router tells that this session may ask.

    Args:
        session: the network.
        timeout: how long they may take, s.
    """
    for reply in session.get(refusals_key("**"), timeout=timeout, **OF_ALL):
        if reply.ok is None:
            continue
        name = str(reply.ok.key_expr).split("/")[1]
        try:
            counts = msgspec.json.decode(reply.ok.payload.to_bytes(), type=readable(list[Count]))
        except UNREADABLE:
            continue
        if names.is_word(name):
            yield Told(name, counts)


def of_name(session: zenoh.Session, name: str, timeout: float) -> dict[str, int]:
    """What was refused to a name, a sentence each, and how often.

    Args:
        session: the network.
        name: whose certificate it is.
        timeout: how long routers may take to tell, s.
    """
    return {
        f"{count.sentence} (says router {router.router})": count.count
        for router in told(session, timeout)
        for count in router.counts
        if count.who == name
    }
