"""Topics of a recording and their messages, as values."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

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
    """As robo has it, without a leading slash; of several of one name with what tells them apart behind it."""
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
    unknown: str
    """Why its messages stay bytes; empty where they are robo's."""
    channels: frozenset[ChannelOf]
    known: Known | None
    publishers: int = 1
    """How many of them were announced, at least 1."""
    beside: str = ""
    """What its name has behind that of the file, where several are of one name."""

    @property
    def own_name(self) -> str:
        """Its name without what tells it from others of that name."""
        return self.name.removesuffix(self.beside)


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


def own_name(name: str) -> str:
    """A topic's name as robo has it, of one that a file or somebody says."""
    return name.lstrip("/")


class _Said(NamedTuple):
    """A channel of a file."""

    where: ChannelOf
    channel: mcap.Channel
    text: str
    """The definition of its type."""
    messages: int


def topics_of(indexes: Sequence[Index], counts: Sequence[Mapping[int, int]], find: Find) -> list[Topic]:
    """The topics of files that are one recording, by name; one whose type changes is one for each of its types."""
    found: dict[tuple[str, str, str, str, str], list[_Said]] = {}
    for number, index in enumerate(indexes):
        for channel in index.channels.values():
            schema = index.schemas.get(channel.schema_id)
            name, kind, data = (schema.name, schema.encoding, schema.data) if schema is not None else ("", "", b"")
            said = _Said(
                (number, channel.id), channel, data.decode("utf-8", "replace"), counts[number].get(channel.id, 0)
            )
            key = own_name(channel.topic), name, kind, channel.encoding, _meaning(name, kind, data)
            found.setdefault(key, []).append(said)
    names: set[str] = set()
    return [_topic(key, found[key], names, find) for key in sorted(found)]


def _meaning(name: str, kind: str, data: bytes) -> str:
    """What tells a definition from another one of the same name: not comments, so that versions of ROS go together."""
    if kind != ROS_TEXT or not data or len(data) > _MOST_TEXT:
        return data.decode("latin-1")
    return repr(sorted(definitions.fields_of(name, data.decode("utf-8", "replace"))))


def _topic(key: tuple[str, str, str, str, str], said: Sequence[_Said], names: set[str], find: Find) -> Topic:
    """A topic of its channels; its name becomes one of `names`."""
    own, schema, kind, encoding, _ = key
    name, number = own, 1
    while name in names:
        name = f"{own} ({schema})" if number == 1 else f"{own} ({schema}) {number}"
        number += 1
    names.add(name)
    text = said[0].text
    known, unknown = _type(schema, kind, text, encoding, find)
    return Topic(
        name,
        known.name if known is not None else schema,
        schema,
        text,
        encoding,
        sum(one.messages for one in said),
        offered.qos_of(said[0].channel.metadata),
        unknown,
        frozenset(one.where for one in said),
        known,
        _publishers(said),
        name.removeprefix(own),
    )


def _publishers(said: Sequence[_Said]) -> int:
    """Of a topic, at most in one file: each file of a recording says the same ones again."""
    found: dict[int, int] = {}
    for one in said:
        file, _ = one.where
        found[file] = found.get(file, 0) + offered.publishers_of(one.channel.metadata)
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
