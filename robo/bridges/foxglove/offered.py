"""What viewers are offered: topics and services with their definitions, and who is at their ends. Of tokens of nodes.

Pure but for types of users, whose modules are imported when one of them is met first.
"""

import itertools
from collections.abc import Callable, Iterable, Mapping
from typing import Literal, NamedTuple

import msgspec

import robo_messages
from robo.bridges.foxglove.protocol import Channel, Half, Service
from robo.errors import ContractError
from robo.interfaces import catalogue, cdr
from robo.interfaces.ros_names import full_name
from robo.interfaces.ros_text import whole_text
from robo.recording.forms import form_of
from robo.text.brief import brief
from robo.wire import codec, names
from robo.wire.keys import EndpointToken, is_hidden
from robo_messages import UnknownType

CLOCK = "clock"
PLAYER = "playing/GetPlayback"
"""The type of the service by which one who plays a recording is known."""
_ODOMETRY, _TRANSFORMS, _PATH = "nav/Odometry", "tf2/TFMessage", "nav/Path"
_ANYTHING = '{"type": "object", "properties": {}}'
"""The JSON Schema of messages whose type is not known here."""
_LARGE = ("sensor/Image", "sensor/CompressedImage", "sensor/PointCloud2", "nav/OccupancyGrid")
_SLOTS, _LARGE_SLOTS = 64, 4
"""Messages that may wait until somebody looks."""
MOST_TOKENS = 50_000
"""That are looked at: a stranger that makes some up fills no memory."""
_MOST_QUOTED = 200

Made = Literal["", "transforms", "trail"]


class Topic(msgspec.Struct, frozen=True):
    """A topic, as the bridge reads it."""

    key: str
    type: str
    """Robo's name; empty where nobody says it."""
    channel: Channel
    sources: tuple[str, ...]
    """The keys of which its messages are made."""
    latched: bool = False
    made: Made = ""
    """What of odometry may be among its messages."""
    slots: int = _SLOTS


class ServedService(msgspec.Struct, frozen=True):
    """A service, as the bridge calls it."""

    key: str
    type: str
    service: Service


class Ends(NamedTuple):
    """Who publishes and subscribes topics, and who serves services: full names of nodes by name of the topic."""

    publishers: dict[str, tuple[str, ...]]
    subscribers: dict[str, tuple[str, ...]]
    servers: dict[str, tuple[str, ...]]


class Offer(NamedTuple):
    """All that there is."""

    topics: dict[int, Topic]
    services: dict[int, ServedService]
    ends: Ends
    unknown: dict[str, str]
    """Why a topic comes as JSON, or a service is not offered, by name."""
    players: tuple[str, ...]
    """Names of nodes that play recordings."""
    has_clock: bool


class Numbers:
    """Gives channels and services numbers: the same one has the same one for ever."""

    def __init__(self) -> None:
        self._of: dict[object, int] = {}
        self._next = itertools.count(1)

    def of(self, what: object) -> int:
        """The number of something."""
        found = self._of.get(what)
        if found is None:
            found = self._of[what] = next(self._next)
        return found


def offer(tokens: Iterable[EndpointToken], numbers: Numbers, covers: Callable[[str], bool] = lambda _: True) -> Offer:
    """What there is to be offered.

    Args:
        tokens: of all ends of nodes.
        numbers: those that were given before.
        covers: which topics and services are offered at all; those that all robots share are always.
    """
    ends: dict[str, list[EndpointToken]] = {}
    served: dict[str, list[EndpointToken]] = {}
    for token in tokens:
        if is_hidden(token.topic) or not (covers(token.topic) or token.topic in _SHARED):
            continue
        if token.kind in ("pub", "sub"):
            ends.setdefault(token.topic, []).append(token)
        elif token.kind == "srv":
            served.setdefault(token.topic, []).append(token)
    unknown: dict[str, str] = {}
    topics = [_topic(key, ends[key], numbers, unknown) for key in sorted(ends)]
    topics = _with_made(topics, _odometries(ends), numbers)
    services = [_service(key, served[key][0].type_name, numbers, unknown) for key in sorted(served)]
    players = tuple(key.rpartition("/")[0] for key, those in sorted(served.items()) if those[0].type_name == PLAYER)
    has_clock = any(token.kind == "pub" for token in ends.get(CLOCK, ()))
    return Offer(
        {topic.channel.id: topic for topic in topics},
        {one.service.id: one for one in services if one is not None},
        Ends(_nodes(ends, "pub"), _nodes(ends, "sub"), _nodes(served, "srv")),
        unknown,
        players,
        has_clock,
    )


_SHARED = (CLOCK, "tf", "tf_static")


def robots_drawn_into_one(found: Offer) -> list[str]:
    """The namespaces whose transforms a 3D panel takes into one tree, where these are several."""
    those = {topic.key.rpartition("/")[0] for topic in found.topics.values() if topic.type == _TRANSFORMS}
    several = sorted(one for one in those if one)
    return several if len(several) > 1 else []


def _nodes(ends: Mapping[str, list[EndpointToken]], kind: str) -> dict[str, tuple[str, ...]]:
    found = {
        f"/{key}": tuple(sorted({one.full_name for one in those if one.kind == kind})) for key, those in ends.items()
    }
    return {name: nodes for name, nodes in found.items() if nodes}


def _topic(key: str, ends: list[EndpointToken], numbers: Numbers, unknown: dict[str, str]) -> Topic:
    sources = [one for one in ends if one.kind == "pub"] or ends
    type_name = min((one.type_name for one in sources if one.type_name), default="")
    form = form_of(key, f"{codec.MSGPACK};{type_name}")
    text = form.topic
    if form.unknown:
        unknown[f"/{key}"] = form.unknown
        said = ("json", brief(type_name, _MOST_QUOTED) or "unknown", _ANYTHING, "jsonschema")
    else:
        said = (text.encoding, text.schema, text.text, text.schema_encoding)
    channel = Channel(numbers.of((key, *said)), f"/{key}", *said)
    slots = _LARGE_SLOTS if type_name in _LARGE or form.unknown else _SLOTS
    return Topic(key, type_name, channel, (key,), any(one.qos.latched for one in sources), slots=slots)


def _odometries(ends: Mapping[str, list[EndpointToken]]) -> list[str]:
    """Topics on which somebody publishes odometry."""
    return [
        key for key, those in sorted(ends.items()) if any(o.kind == "pub" and o.type_name == _ODOMETRY for o in those)
    ]


def _with_made(topics: list[Topic], odometries: list[str], numbers: Numbers) -> list[Topic]:
    """Topics, with those that are made of odometry: viewers draw robots by transforms alone, and trails as paths."""
    by_key = {topic.key: topic for topic in topics}
    for key in odometries:
        tf = names.join(key.rpartition("/")[0], "tf")
        known = by_key.get(tf) or _made(tf, _TRANSFORMS, numbers, "transforms")
        if known.channel.schema_name == "tf2_msgs/msg/TFMessage":
            by_key[tf] = msgspec.structs.replace(known, sources=(*known.sources, key), made="transforms")
        trail = f"{key}_trail"
        if trail not in by_key:
            by_key[trail] = msgspec.structs.replace(_made(trail, _PATH, numbers, "trail"), sources=(key,))
    return [by_key[key] for key in sorted(by_key)]


def _made(key: str, type_name: str, numbers: Numbers, made: Made) -> Topic:
    text = form_of(key, f"{codec.MSGPACK};{type_name}").topic
    said = (text.encoding, text.schema, text.text, text.schema_encoding)
    return Topic(key, type_name, Channel(numbers.of((key, *said)), f"/{key}", *said), (), made=made)


def _service(key: str, type_name: str, numbers: Numbers, unknown: dict[str, str]) -> ServedService | None:
    try:
        halves = [_half(name) for name in robo_messages.halves_of(type_name)]
    except (ContractError, UnknownType, LookupError, ValueError) as error:
        unknown[f"/{key}"] = brief(f"its type {type_name} is not known here, or ROS cannot have it: {error}", 300)
        return None
    except Exception as error:  # of a user's module
        unknown[f"/{key}"] = brief(f"its type {type_name} cannot be used: {type(error).__name__}: {error}", 300)
        return None
    name = full_name(type_name, "service")
    number = numbers.of(("service", key, name, *halves))
    return ServedService(key, type_name, Service(number, f"/{key}", name, halves[0], halves[1]))


def _half(name: str) -> Half:
    type_ = catalogue.find_here(name)
    if type_ is None:
        raise UnknownType(name)
    cdr.encoder(type_), cdr.decoder(type_)  # what ROS cannot have is told here
    return Half("cdr", full_name(name), "ros2msg", whole_text(name))


def graph_changes(before: Ends | None, after: Ends) -> dict[str, object] | None:
    """What of who is at which end has changed, as a client is told; None where nothing has.

    Args:
        before: what it knows; None for one that has been told nothing, and is to be told even that there is nothing.
        after: what holds.
    """
    is_first = before is None
    before = before or Ends({}, {}, {})
    changed = [
        {name: nodes for name, nodes in new.items() if old.get(name) != nodes}
        for old, new in zip(before, after, strict=True)
    ]
    known = {*before.publishers, *before.subscribers}
    there = {*after.publishers, *after.subscribers}
    # Where one kind of ends is gone and the other is not, the topic stays, with nobody at these.
    for number, (old, new) in enumerate(zip(before[:2], after[:2], strict=True)):
        changed[number] |= dict.fromkeys((old.keys() - new.keys()) & there, ())
    gone, unserved = sorted(known - there), sorted(before.servers.keys() - after.servers.keys())
    if not is_first and not any(changed) and not gone and not unserved:
        return None
    words = (
        ("publishedTopics", "publisherIds"),
        ("subscribedTopics", "subscriberIds"),
        ("advertisedServices", "providerIds"),
    )
    said: dict[str, object] = {
        word: [{"name": name, ids: list(nodes)} for name, nodes in sorted(those.items())]
        for (word, ids), those in zip(words, changed, strict=True)
    }
    return said | {"removedTopics": gone, "removedServices": unserved}
