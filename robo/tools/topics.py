"""Which topics there are, what they carry, and who is at their ends."""

from collections.abc import Collection, Iterable, Mapping, Sequence

import msgspec
import zenoh

from robo.errors import MessageError, TopicNotFound, TopicTaken
from robo.text.suggestions import suggest
from robo.text.terminal import visible
from robo.tools import runs, strangers
from robo.wire import admin
from robo.wire.discovery import tokens
from robo.wire.keys import VERBS, EndpointKind, EndpointToken
from robo.wire.qos import QoS, misfit
from robo.wire.reports import ProcessStatus

RATES_TIMEOUT = 0.2
"""How long supervisors may take to tell the rates, s; a list does not wait for one that hangs."""


class End(msgspec.Struct, frozen=True):
    """A publisher or a subscription of a node of robo's."""

    node: str
    """The full name."""
    type: str
    qos: QoS
    """How it keeps messages."""


class Topic(msgspec.Struct, frozen=True):
    """A topic that somebody publishes or subscribes."""

    key: str
    type: str
    """Empty where only clients that are no nodes of robo's are there; the first one where there is a clash."""
    types: list[str]
    """More than one is a clash."""
    publishers: list[str]
    """Full names of nodes; `zenoh:<id>` for a client that is not a node."""
    subscribers: list[str]
    rate: float | None = None
    """Messages a second, as publishers told their supervisors last; None where it is not known."""


class TopicInfo(msgspec.Struct, frozen=True):
    """A topic with all that is known of its ends."""

    key: str
    type: str
    types: list[str]
    publishers: list[End]
    subscribers: list[End]
    rate: float | None
    others: list[str]
    """Ends that are no nodes of robo's: `publisher zenoh:<id>`."""
    strangers: list[str] = []
    """Who publishes without being announced, and whose messages a node leaves out, in words."""
    misfits: list[str] = []
    """Which subscriptions do not get of which publishers what they want, in words."""


EVERY = ("**",)
"""The keys of all topics."""


def list_topics(session: zenoh.Session, timeout: float = 1.0, others: Sequence[str] = EVERY) -> list[Topic]:
    """Every topic of nodes, and those that only other clients have, sorted by key; without rates.

    Args:
        session: the network.
        timeout: how long routers may take to answer, s.
        others: keys of those that only other clients have; they cost more to ask for (`wire.admin`).
    """
    return _topics(session, _ends(session, timeout), timeout, others)


def _topics(
    session: zenoh.Session, ends: Iterable[EndpointToken], timeout: float, others: Sequence[str]
) -> list[Topic]:
    found: dict[str, tuple[set[str], set[str], set[str]]] = {}
    for token in ends:
        types, publishers, subscribers = found.setdefault(token.topic, (set(), set(), set()))
        types.add(token.type_name)
        (publishers if token.kind == "pub" else subscribers).add(token.full_name)
    known = set(found)
    for kind, key, zid in admin.declared_by_others(session, [key for key in others if key not in known], timeout):
        # Of a key that nodes of robo's use, a client that is not a node cannot be told from one that is.
        if key not in known:
            _, publishers, subscribers = found.setdefault(key, (set(), set(), set()))
            (publishers if kind == "pub" else subscribers).add(f"zenoh:{zid}")
    return [
        Topic(key, min(types, default=""), sorted(types), sorted(publishers), sorted(subscribers))
        for key, (types, publishers, subscribers) in sorted(found.items())
    ]


def with_rates(topics: Iterable[Topic], processes: Iterable[ProcessStatus]) -> list[Topic]:
    """Topics with the rates that supervisors know."""
    rates = published_rates(processes)
    return [msgspec.structs.replace(topic, rate=rates.get(topic.key)) for topic in topics]


def published_rates(processes: Iterable[ProcessStatus]) -> dict[str, float]:
    """Messages a second by topic, of all publishers together."""
    rates: dict[str, float] = {}
    for status in processes:
        for key, rate in status.published.items():
            rates[key] = rates.get(key, 0.0) + rate
    return rates


def topic_info(session: zenoh.Session, key: str, timeout: float = 1.0) -> TopicInfo:
    """All about one topic.

    Raises:
        TopicNotFound: nobody has it; says what comes close.
    """
    every = _ends(session, timeout)
    topic = find_topic(_topics(session, every, timeout, (key,)), key)
    ends = [token for token in every if token.topic == key]
    rates = published_rates(runs.processes(session, timeout=RATES_TIMEOUT))
    others = [f"publisher {name}" for name in topic.publishers if name.startswith("zenoh:")]
    others += [f"subscriber {name}" for name in topic.subscribers if name.startswith("zenoh:")]
    found = [str(one) for one in strangers.find(session, timeout, key)]
    return TopicInfo(
        key,
        topic.type,
        topic.types,
        _sorted(ends, "pub"),
        _sorted(ends, "sub"),
        rates.get(key),
        others,
        found,
        misfits(ends),
    )


def all_misfits(session: zenoh.Session, timeout: float = 1.0) -> list[str]:
    """Which subscriptions do not get of which publishers what they want, of all topics, in words."""
    return misfits(_ends(session, timeout))


def misfits(ends: Iterable[EndpointToken]) -> list[str]:
    """Which of some subscriptions do not get of which publishers what they want, in words."""
    by_topic: dict[str, list[EndpointToken]] = {}
    for end in ends:
        by_topic.setdefault(end.topic, []).append(end)
    found = [
        misfit(topic, (source.full_name, source.qos), (reader.full_name, reader.qos))
        for topic, both in sorted(by_topic.items())
        for source in both
        for reader in both
        if source.kind == "pub" and reader.kind == "sub"
    ]
    return list(dict.fromkeys(why for why in found if why))


def find_topic(topics: Iterable[Topic], key: str) -> Topic:
    """The topic of a key.

    Raises:
        TopicNotFound: nobody has it; says what comes close.
    """
    by_key: Mapping[str, Topic] = {topic.key: topic for topic in topics}
    if key in by_key:
        return by_key[key]
    raise TopicNotFound(f"nobody publishes or subscribes {key}; {suggest(key, by_key)}")


def check_type(session: zenoh.Session, key: str, type_name: str, timeout: float = 1.0) -> None:
    """Refuse a type that a topic does not have.

    Raises:
        MessageError: nodes that publish or subscribe the topic know it as something else.
    """
    ends = [token for token in _ends(session, timeout) if token.topic == key and token.type_name]
    if ends and type_name not in {token.type_name for token in ends}:
        there = ends[0]
        what = visible(f"{there.full_name} {VERBS[there.kind]} {there.type_name}")
        raise MessageError(f"{key} is no {type_name}: {what} on it; --force to insist")


def check_unpublished(session: zenoh.Session, key: str, timeout: float = 1.0) -> None:
    """Refuse a topic that somebody publishes already: receivers would get both in turns.

    Raises:
        TopicTaken: names who publishes it.
    """
    for topic in among(session, (key,), timeout):
        refuse_taken(topic)


def among(session: zenoh.Session, keys: Collection[str], timeout: float = 1.0) -> list[Topic]:
    """Those of some topics that somebody publishes or subscribes."""
    return [topic for topic in list_topics(session, timeout, list(keys)) if topic.key in keys]


def refuse_type(topic: Topic, type_name: str) -> None:
    """Refuse a type that a topic does not have.

    Raises:
        MessageError: nodes that publish or subscribe the topic know it as something else.
    """
    types = [one for one in topic.types if one]
    if types and type_name not in types:
        who = visible(", ".join([*topic.publishers, *topic.subscribers]))
        raise MessageError(f"{topic.key} is no {type_name}: {who} know it as {visible(types[0])}; --force to insist")


def refuse_taken(topic: Topic, otherwise: str = "") -> None:
    """Refuse a topic that somebody publishes already.

    Args:
        topic: which.
        otherwise: what else there is to do, in words.

    Raises:
        TopicTaken: names who publishes it.
    """
    publishers = topic.publishers
    if publishers:
        nodes = [name for name in publishers if not name.startswith("zenoh:")]
        how = f" (robo stop {' '.join(nodes)})" if nodes else ""
        verb = "publishes" if len(publishers) == 1 else "publish"
        more = f"; {otherwise}" if otherwise else ""
        raise TopicTaken(
            f"{', '.join(publishers)} {verb} {topic.key} already, and receivers would get both in turns: "
            f"stop it first{how}, or add --beside{more}"
        )


def _sorted(ends: Iterable[EndpointToken], kind: EndpointKind) -> list[End]:
    return [
        End(token.full_name, token.type_name, token.qos)
        for token in sorted(ends, key=lambda token: token.full_name)
        if token.kind == kind
    ]


def _ends(session: zenoh.Session, timeout: float) -> list[EndpointToken]:
    found = tokens(session, timeout)
    return [token for token in found if isinstance(token, EndpointToken) and token.kind in ("pub", "sub")]
