"""Recordings as JSON Lines, the form of `robo topic echo --json`, and back without a loss.

A line is a record of one message. What a network does not say of it stands in fields that readers of records pass over:
when it arrived, what its topic is (in the first line of each), and the bytes where the message does not tell them all.
"""

import base64
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec

from robo.bag.edit.output import new_file
from robo.bag.forms.converted import Added, Converted, Wanted, left_behind, schema_of
from robo.bag.forms.lines import lines_of, new_text
from robo.bag.mcap.compression import Compression
from robo.bag.options import CDR, ROS_TEXT, TopicInFile
from robo.bag.progress import Tell, counted, silent
from robo.bag.read.reader import Bag
from robo.bag.read.topics import BagMessage, Topic, own_name
from robo.bag.types import topic_of
from robo.errors import BagError, ContractError, MessageError, RoboError
from robo.interfaces import catalogue, cdr
from robo.interfaces.message_input import message_of
from robo.samples.records import Record, sample_of
from robo.text.brief import brief, shown
from robo.text.readable import readable
from robo.text.terminal import escaped_json
from robo.text.unreadable import UNREADABLE
from robo.wire.codec import Decoder, Malformed, jsonable
from robo.wire.qos import QoS, from_word
from robo_messages import Message, UnknownType

_CDR = "application/cdr"
"""The encoding of a payload that is CDR, with the type behind it."""


class TopicWords(msgspec.Struct, frozen=True, omit_defaults=True):
    """What a recording knows of a topic, beside its name."""

    qos: str = ""
    """As `QoS.word` has it."""
    schema: str | None = None
    """What the recording calls its type, where robo does not know that."""
    definition: str = ""
    """Of that type."""
    binary: str = ""
    """The definition in base64, where it is no text."""
    schema_encoding: str = ROS_TEXT
    encoding: str = CDR


class Line(Record, frozen=True, omit_defaults=True):
    """One message of a recording. Its `payload` is CDR where `encoding` says so."""

    arrived: int | None = None
    """ns since the epoch; None where only `time` is known."""
    topic: TopicWords | None = None
    """In the first line of each topic."""
    beside: str = ""
    """What tells the topic from others of its name and another type."""
    cdr: str = ""
    """The bytes, base64, where the message does not tell them all. They count as long as nobody has changed it."""


def to_json_lines(
    bag: Bag, output: str | Path, *, wanted: Wanted | None = None, force: bool = False, tell: Tell = silent
) -> Converted:
    """Write the messages of a recording as JSON Lines, in the order of their arrivals.

    Args:
        bag: the recording.
        output: the file; `-` for standard output.
        wanted: which topics; None for all.
        force: take the place of a file of this name.
        tell: is told how many messages are done.

    Raises:
        DamagedBag: a part of the recording is damaged.
        BagError: `output` is there already or cannot be written.
    """
    topics = [topic for topic in bag.topics.values() if wanted is None or wanted(topic.name)]
    total = sum(topic.count for topic in topics)
    said: set[Topic] = set()
    count = 0
    with new_text(output, force=force) as file:
        # Of all topics whatever is there, also where a damaged index does not say so.
        names = [topic.name for topic in topics] if len(topics) < len(bag.topics) else None
        for message in counted(bag.messages(names), total, tell):
            words = None if message.topic in said else _words(bag, message.topic)
            said.add(message.topic)
            line = line_of(message, words)
            file.write(escaped_json(msgspec.json.encode(line).decode()).encode() + b"\n")
            count += 1
    return Converted(str(output), len(said), count, left_behind(bag, "JSON Lines"))


def line_of(message: BagMessage, words: TopicWords | None) -> Line:
    """A message as a line, with words of its topic where it is the first one."""
    topic = message.topic
    value: Any = None
    error, encoding, payload, exact = topic.unknown, "", "", ""
    if topic.known is not None:
        try:
            value = message.value
        except BagError as reason:
            error = str(reason)
    if error:
        encoding = f"{_CDR if topic.encoding == CDR else topic.encoding};{topic.schema}"
        payload = base64.b64encode(message.data).decode("ascii")
    else:
        type_ = type(value)
        value = jsonable(msgspec.to_builtins(value))
        if not _tells(type_, message.value, value, message.data):
            exact = base64.b64encode(message.data).decode("ascii")
    return Line(
        topic.own_name,
        topic.type,
        message.published,
        message.sequence or None,
        value,
        error,
        encoding,
        payload,
        arrived=message.arrived,
        topic=words,
        beside=topic.beside,
        cdr=exact,
    )


def _tells(type_: type[Message], value: Any, plain: object, data: bytes) -> bool:
    """Whether a message tells every byte of its recording."""
    try:
        if cdr.encoder(type_)(value) != data:
            return False
        # There are many NaN, and text has one; and where any type may stand, the text of an infinity is text.
        text = msgspec.json.encode(plain)
        if not any(word in text for word in (b'"nan"', b'"inf"', b'"-inf"')):
            return True
        return cdr.encoder(type_)(message_of(type_, plain)) == data
    except MessageError:
        return False


def _words(bag: Bag, topic: Topic) -> TopicWords:
    words = TopicWords(topic.qos.word)
    if topic.known is not None:
        return words
    schema = schema_of(bag, topic)
    if schema is None:
        return msgspec.structs.replace(words, schema="", encoding=topic.encoding)
    said = TopicWords(words.qos, schema.name, "", "", schema.encoding, topic.encoding)
    try:
        return msgspec.structs.replace(said, definition=schema.data.decode("utf-8"))
    except UnicodeDecodeError:
        return msgspec.structs.replace(said, binary=base64.b64encode(schema.data).decode("ascii"))


def from_json_lines(
    path: str | Path,
    output: str | Path,
    compression: Compression = "zstd",
    *,
    wanted: Wanted | None = None,
    force: bool = False,
    tell: Tell = silent,
) -> Converted:
    """Make a recording of JSON Lines: of those that `to_json_lines` or `robo topic echo --json` has written.

    Args:
        path: of the file; `-` for standard input.
        output: of the recording.
        compression: of the recording.
        wanted: which topics; None for all.
        force: take the place of a file of this name.
        tell: is told how many bytes are done.

    Raises:
        BagError: a line is no record, its message does not fit its type, or nobody says what that is: names the line.
    """
    with new_file(output, compression, force=force) as writer:
        reading = _Reading(Added(writer, str(path)))
        for number, line in _records(path, tell):
            if wanted is None or wanted(own_name(line.key)):
                try:
                    reading.take(line)
                except RoboError as error:
                    raise BagError(f"line {number:,}: {brief(str(error))}", str(path)) from None
        return reading.added.done(str(output), [])


def _records(path: str | Path, tell: Tell) -> Iterator[tuple[int, Line]]:
    for number, text in enumerate(lines_of(path, tell), start=1):
        if text.isspace():
            continue
        try:
            yield number, msgspec.json.decode(text, type=readable(Line))
        except UNREADABLE as error:
            reason = brief(str(error), 300)
            raise BagError(
                f"line {number:,} is no record as `robo topic echo --json` has it: {reason}", str(path)
            ) from None


_Which = tuple[str, str, str]
"""A topic: its name, its type, and what tells it from others of both."""


class _Reading:
    """Takes lines, one after another."""

    def __init__(self, added: Added) -> None:
        self.added = added
        self._words: dict[_Which, TopicWords] = {}
        self._types: dict[str, type[Message] | None] = {}
        self._decoders: dict[type[Message], Decoder[Message]] = {}
        self._numbers: dict[_Which, int] = {}

    def take(self, line: Line) -> None:
        """Add its message.

        Raises:
            RoboError: it cannot be added; says why.
        """
        key = own_name(line.key)
        if line.topic is not None:
            self._words[key, line.type, line.beside] = line.topic
        type_ = self._type(line.type)
        data = self._data(line, type_)
        arrived = line.arrived if line.arrived is not None else line.time
        number = line.sequence_number or 0
        if number < 0:
            raise MessageError(f"{shown(line.key)}: there is no sequence number {number}")
        self.added.add(self._number(key, line, type_), data, arrived, line.time, number)

    def _number(self, key: str, line: Line, type_: type[Message] | None) -> int:
        which = key, line.type, line.beside
        number = self._numbers.get(which) if line.topic is None else None
        if number is None:
            words = self._words.get(which, TopicWords())
            qos = from_word(words.qos) or QoS.DEFAULT
            number = self._numbers[which] = self.added.topic(_topic(key, words, type_, line, qos))
        return number

    def _type(self, name: str) -> type[Message] | None:
        if name not in self._types:
            self._types[name] = catalogue.find_here(name) if name else None
        return self._types[name]

    def _data(self, line: Line, type_: type[Message] | None) -> bytes:
        if line.message is None and (line.encoding.partition(";")[0] == _CDR or line.topic or type_ is None):
            return _bytes(line.payload)
        if type_ is None:
            what = f"robo has no type {shown(line.type)}" if line.type else "it does not say its type"
            raise MessageError(f"{shown(line.key)}: {what}, and a recording needs to know it")
        if line.cdr:
            data = _bytes(line.cdr)
            if _still_tells(type_, data, line.message):
                return data
        return cdr.encoder(type_)(self._message(line, type_))

    def _message(self, line: Line, type_: type[Message]) -> Message:
        if not line.payload and not line.error:
            return message_of(type_, line.message)
        payload, encoding = sample_of(line)
        decoder = self._decoders.get(type_)
        if decoder is None:
            decoder = self._decoders[type_] = Decoder(type_)
        try:
            return decoder.decode(payload, encoding)
        except Malformed as error:
            raise MessageError(f"{shown(line.key)}: its payload cannot be read: {error}") from None


def _topic(key: str, words: TopicWords, type_: type[Message] | None, line: Line, qos: QoS) -> TopicInFile:
    if words.schema is not None:
        text = _bytes(words.binary).decode("utf-8", "surrogateescape") if words.binary else words.definition
        return TopicInFile(key, words.schema, text, "", qos, words.encoding, words.schema_encoding)
    if type_ is None:
        raise MessageError(f"{shown(key)}: nothing says what a {shown(line.type)} is, and a recording needs to know it")
    try:
        return topic_of(key, type_, qos)
    except (ContractError, UnknownType) as error:
        raise MessageError(f"{shown(key)}: {error}") from None


def _bytes(text: str) -> bytes:
    try:
        return base64.b64decode(text, validate=True)
    except ValueError as error:
        raise MessageError(f"its bytes are no base64: {error}") from None


def _still_tells(type_: type[Message], data: bytes, plain: object) -> bool:
    """Whether a message beside its bytes is the one that they say."""
    try:
        return jsonable(msgspec.to_builtins(cdr.decoder(type_)(data))) == plain
    except MessageError:
        return False
