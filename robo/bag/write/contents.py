"""What stands in each file of a recording: its topics, what latched ones said last, words and files beside them."""

from collections import Counter
from collections.abc import Hashable

import msgspec

from robo.bag import offered
from robo.bag.mcap import format as mcap
from robo.bag.mcap.file_writer import FileWriter
from robo.bag.mcap.index import REPEATED
from robo.bag.options import TopicInFile
from robo.bag.write.kept import Kept, Said
from robo.bag.write.ros2_folder import TopicKey, TopicOf
from robo.errors import BagError

TYPE_HASH = "topic_type_hash"
"""The word of a channel's metadata that ROS reads."""

_MOST_TOPICS = 65_535


class _Attachment(msgspec.Struct, frozen=True):
    """A file within files."""

    time: int
    media_type: str
    data: bytes


class Contents:
    """What a new file begins with."""

    def __init__(self) -> None:
        self.names: dict[int, str] = {}
        """Of topics, by number."""
        self._types: dict[TopicKey, TopicOf] = {}
        """Topics as ROS calls them: one for all channels of a topic that differ in what is offered alone."""
        self._numbers: dict[TopicInFile, int] = {}
        self._schemas: dict[tuple[str, str, str], mcap.Schema] = {}
        self._channels: list[mcap.Channel] = []
        self._keys: list[TopicKey] = []
        """Of the channels."""
        self._kept = Kept()
        self._metadata: dict[str, dict[str, str]] = {}
        self._attachments: dict[str, _Attachment] = {}

    def number(self, topic: TopicInFile) -> int | None:
        """Of a topic that was said."""
        return self._numbers.get(topic)

    def add_topic(self, topic: TopicInFile, writer: FileWriter) -> int:
        """Say a topic in this file and those that follow; its number.

        Raises:
            BagError: there are too many.
        """
        number = len(self._channels) + 1
        if number > _MOST_TOPICS:
            raise BagError(f"a recording has at most {_MOST_TOPICS:,} topics")
        schema = self._schema(topic)
        words = offered.words_of(topic.qos)
        if topic.type_hash:
            words[TYPE_HASH] = topic.type_hash
        channel = mcap.Channel(number, schema.id, f"/{topic.name.removeprefix('/')}", topic.encoding, words)
        writer.add_schema(schema)
        writer.add_channel(channel)
        self._channels.append(channel)
        self._numbers[topic] = number
        self.names[number] = topic.name
        key = TopicKey(channel.topic, topic.schema, topic.encoding)
        self._keys.append(key)
        self._types[key] = TopicOf(key, topic.type_hash, words[offered.OFFERED])
        if topic.qos.latched:
            self._kept.begin(number, topic.name, topic.qos.depth)
        else:
            self._kept.forget_topic(topic.name)
        return number

    @property
    def types(self) -> list[TopicOf]:
        """Topics as ROS calls them."""
        return list(self._types.values())

    def keep(self, message: Said, source: Hashable) -> None:
        """A message of a latched topic, for the files that follow."""
        self._kept.add(message, source)

    def forget(self, topic: str, source: Hashable) -> None:
        """What a publisher of a latched topic has said is not said again."""
        self._kept.forget(topic, source)

    def is_latched(self, topic: int) -> bool:
        """Whether messages of a topic are kept."""
        return topic in self._kept

    def add_metadata(self, name: str, words: dict[str, str], writer: FileWriter) -> None:
        """Say words in this file and those that follow."""
        self._metadata[name] = dict(words)
        writer.add_metadata(name, words)

    def attach(self, name: str, data: bytes, media_type: str, time: int, writer: FileWriter) -> None:
        """Put a file into this file and those that follow; the time is ns since the epoch."""
        self._attachments[name] = _Attachment(time, media_type, data)
        writer.add_attachment(time, time, name, media_type, data)

    def counts(self, of_topics: dict[int, int]) -> dict[TopicKey, int]:
        """Messages by the number of a topic, by what ROS calls it."""
        found: Counter[TopicKey] = Counter()
        for number, count in of_topics.items():
            found[self._keys[number - 1]] += count
        return found

    def begin(self, writer: FileWriter, at: int) -> None:
        """Say all of it in a new file, as of a time, ns since the epoch."""
        kept = list(self._kept)
        for schema in self._schemas.values():
            writer.add_schema(schema)
        for channel in self._channels:
            writer.add_channel(channel)
        for said in kept:
            writer.add_message(said.channel, said.sequence, at, said.published, said.data)
        writer.end_chunk()
        if kept:
            again = Counter(said.channel for said in kept)
            writer.add_metadata(REPEATED, {str(channel): str(count) for channel, count in again.items()})
        for name, words in self._metadata.items():
            writer.add_metadata(name, words)
        for name, one in self._attachments.items():
            writer.add_attachment(one.time, one.time, name, one.media_type, one.data)

    def _schema(self, topic: TopicInFile) -> mcap.Schema:
        said = topic.schema, topic.schema_encoding, topic.text
        schema = self._schemas.get(said)
        if schema is None:
            data = _definition(topic.text)
            schema = mcap.Schema(len(self._schemas) + 1, topic.schema, topic.schema_encoding, data)
            self._schemas[said] = schema
        return schema


def _definition(text: str) -> bytes:
    """Bytes that are no text stand in one as Python escapes them."""
    try:
        return text.encode("utf-8", "surrogateescape")
    except UnicodeEncodeError:
        return text.encode("utf-8", "replace")
