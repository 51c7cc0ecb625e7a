"""Who publishes without having said so: by what nodes leave out, and by counts that do not add up."""

import time
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise

import msgspec
import zenoh

from robo.tools.nodes import all_status
from robo.wire.discovery import tokens
from robo.wire.keys import EndpointToken
from robo.wire.reports import NodeStatus

WINDOW = 0.5
"""Over which messages are counted, s."""

WINDOWS = 2
"""In how many of them, one after the other, counts must not add up: a node that was held up takes in at once what has
waited for it, and has more in that one alone."""

LATELY = 60.0
"""Whose messages were left out longer ago than this is no longer told of, s."""


class Stranger(msgspec.Struct, frozen=True):
    """A source of messages that is not the one, or that nobody has announced."""

    topic: str
    receiver: str
    """The full name of the node that has noticed."""
    text: str

    def __str__(self) -> str:
        return self.text


def find(session: zenoh.Session, timeout: float = 1.0, topic: str | None = None) -> list[Stranger]:
    """All who can be noticed, on one topic or on all. It takes WINDOW, and WINDOWS times as long where there is one."""
    looks, ends = [all_status(session, timeout)], _publishers(session, timeout)
    unannounced: list[Stranger] = []
    while len(looks) == 1 or (unannounced and len(looks) <= WINDOWS):
        time.sleep(WINDOW)
        looks.append(all_status(session, timeout))
        ends |= _publishers(session, timeout)  # who has begun meanwhile is announced by now
        unannounced = lasting_surplus(looks, ends)
    found = refused(looks[-1])
    known = {one.topic for one in found}
    found += [one for one in unannounced if one.topic not in known]
    return [one for one in found if topic in (None, one.topic)]


def _publishers(session: zenoh.Session, timeout: float) -> set[EndpointToken]:
    return {token for token in tokens(session, timeout) if isinstance(token, EndpointToken) and token.kind == "pub"}


def refused(statuses: Mapping[str, NodeStatus]) -> list[Stranger]:
    """Whose messages nodes leave out because another source is the one."""
    return [
        Stranger(
            topic,
            node,
            f"{node} leaves out messages of {one.sender} on {topic}: {one.count} so far, the last {one.age:.1f} s ago",
        )
        for node, status in sorted(statuses.items())
        for topic, senders in status.refused.items()
        for one in senders
        if one.age < LATELY
    ]


def lasting_surplus(looks: Sequence[Mapping[str, NodeStatus]], publishers: Iterable[EndpointToken]) -> list[Stranger]:
    """What `surplus` finds between all looks, in the words of the last one."""
    ends = list(publishers)
    *earlier, last = [surplus(before, after, ends) for before, after in pairwise(looks)]
    lasting = [{(one.topic, one.receiver) for one in found} for found in earlier]
    return [one for one in last if all((one.topic, one.receiver) in found for found in lasting)]


def surplus(
    before: Mapping[str, NodeStatus], after: Mapping[str, NodeStatus], publishers: Iterable[EndpointToken]
) -> list[Stranger]:
    """Topics on which nodes receive more than all who are announced have published.

    Args:
        before: counters of nodes.
        after: the same a moment later.
        publishers: those that are announced. A topic with one that tells no counters is left out.
    """
    announced: dict[str, set[str]] = {}
    for token in publishers:
        announced.setdefault(token.topic, set()).add(token.full_name)
    found = []
    for node, status in sorted(after.items()):
        if node not in before or not (span := status.uptime - before[node].uptime) > 0:
            continue
        for topic, received in status.received.items():
            senders = announced.get(topic, set())
            rates = [_rate(before, after, sender, topic) for sender in senders]
            if None in rates:
                continue
            came = received - before[node].received.get(topic, 0)
            expected = sum(rate for rate in rates if rate is not None) * span
            # One message more or less at each end of each count, and one more.
            if came - expected > 2 + len(senders) + 0.05 * expected:
                more = (came - expected) / span
                who = "somebody who is not announced publishes"
                found.append(
                    Stranger(topic, node, f"{who} on {topic}: {node} receives {more:.0f} Hz more than nodes send")
                )
    return found


def _rate(before: Mapping[str, NodeStatus], after: Mapping[str, NodeStatus], node: str, topic: str) -> float | None:
    """What a node publishes, messages a second; None where it does not tell."""
    if node not in before or node not in after or not (span := after[node].uptime - before[node].uptime) > 0:
        return None
    return (after[node].published.get(topic, 0) - before[node].published.get(topic, 0)) / span
