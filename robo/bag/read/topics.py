"""Topics of a recording and their messages, as values."""

from collections.abc import Mapping, Sequence

import msgspec

from robo.bag import definitions, offered
from robo.bag.mcap import format as mcap
from robo.bag.mcap.index import Index
from robo.bag.options import CDR, ROS_TEXT
from robo.bag.types import Find, Known
from robo.errors import BagError, RoboError
from robo.text.brief import brief, shown
from robo.text.unreadable import UNREADABLE
from robo.wire.qos import QoS
from robo_messages import Message

_MOST_TEXT = 1_000_000
"""Of a definition, characters."""

ChannelOf = tuple[int, int]
"""The number of a file, and that of a channel in it."""


class Topic(msgspec.Struct, frozen=True, eq=False):
    """A topic of a recording."""

    name: str
    """As robo has it, without a leading slash."""
    type: str
    """Robo's name, `geometry/Twist`; of a type that is not known, what the file calls it."""
    schema: str
    """What the file calls its type; empty where it says nothing."""
    text: str
    """Its definition, as the file has it."""
    encoding: str
    """Of its messages: cdr."""
    count: int
    """Of its messages."""
    qos: QoS
    """What its publishers offer, as far as the file says."""
    publishers: int
    """How many of them were announced, at least 1."""
    unknown: str
    """Why its messages stay bytes; empty where they are robo's."""
    channels: frozenset[ChannelOf]
    known: Known | None


class BagMessage(msgspec.Struct, frozen=True, gc=False):
    """A message of a recording."""

    topic: Topic
    arrived: int
    """When it was recorded, ns since the epoch."""
    published: int
    """ns since the epoch, by the publisher's clock."""
    sequence: int
    """The last 32 bits of its sequence number; 0 where nothing is known."""
    data: bytes

    @property
    def value(self) -> Message | bytes:
        """The message; its bytes where its type is not known.

        Raises:
            BagError: it is no message of its type.
        """
        known = self.topic.known
        if known is None:
            return self.data
        try:
            return known.decode(self.data)
        except (ValueError, RoboError, *UNREADABLE) as error:
            where = f"{brief(self.topic.name, 200)}, the message that came at {self.arrived} ns"
            raise BagError(f"{where}: no {self.topic.type}: {brief(str(error), 200)}") from None


def topics_of(indexes: Sequence[Index], counts: Sequence[Mapping[int, int]], find: Find) -> list[Topic]:
    """The topics of files that are one recording, by name; one whose type changes is one for each of its types."""
    found: dict[tuple[str, str, str, str], list[tuple[ChannelOf, int, mcap.Channel]]] = {}
    texts: dict[ChannelOf, str] = {}
    for number, index in enumerate(indexes):
        for channel in index.channels.values():
            schema = index.schemas.get(channel.schema_id)
            name, kind = (schema.name, schema.encoding) if schema is not None else ("", "")
            where = number, channel.id
            texts[where] = schema.data.decode("utf-8", "replace") if schema is not None else ""
            key = channel.topic.removeprefix("/"), name, kind, channel.encoding
            found.setdefault(key, []).append((where, counts[number].get(channel.id, 0), channel))
    topics = []
    names: set[str] = set()
    for (name, schema_name, kind, encoding), channels in sorted(found.items()):
        where, _, channel = channels[0]
        known, unknown = _type(schema_name, kind, texts[where], encoding, find)
        topics.append(
            Topic(
                name if name not in names else f"{name} ({schema_name})",
                known.name if known is not None else schema_name,
                schema_name,
                texts[where],
                encoding,
                sum(count for _, count, _ in channels),
                offered.qos_of(channel.metadata),
                _publishers(channels),
                unknown,
                frozenset(where for where, _, _ in channels),
                known,
            )
        )
        names.add(name)
    return topics


def _publishers(channels: Sequence[tuple[ChannelOf, int, mcap.Channel]]) -> int:
    """Of a topic, at most in one file: each file of a recording says the same ones again."""
    found: dict[int, int] = {}
    for (file, _), _, channel in channels:
        found[file] = found.get(file, 0) + offered.publishers_of(channel.metadata)
    return max(found.values())


def _type(name: str, kind: str, text: str, encoding: str, find: Find) -> tuple[Known | None, str]:
    """What robo has for a type of a file, or why it has nothing."""
    if not name:
        return None, "the file does not say what its type is"
    if encoding != CDR:
        return None, f"its messages are in {shown(encoding)}, and robo reads {CDR}"
    known = find(name)
    if known is None:
        return None, f"robo has no type {shown(name)}"
    if text and kind != ROS_TEXT:
        return None, f"its definition is in {shown(kind)}, and robo reads {ROS_TEXT}"
    if len(text) > _MOST_TEXT:
        return None, f"its definition has {len(text):,} characters, and at most {_MOST_TEXT:,} are read"
    if text and (difference := definitions.differs(name, text, known.text)):
        return None, f"its definition is another one: {brief(difference, 300)}"
    return known, ""
