"""New recordings made of others: a part of the time, some of the topics, several as one.

What latched topics had said before a part begins stands at its beginning. Attachments and metadata are kept.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec

from robo.bag.edit.output import new_file
from robo.bag.mcap.compression import Compression
from robo.bag.mcap.file_writer import FileWriter
from robo.bag.mcap.index import COUNTS, REPEATED
from robo.bag.progress import Tell, counted, silent
from robo.bag.read.files import Files, files_of
from robo.bag.read.reader import Bag
from robo.bag.read.topics import Topic
from robo.bag.types import transforms
from robo.errors import BagError, DamagedBag


class Edited(msgspec.Struct, frozen=True):
    """What an edit has come to."""

    output: str
    topics: int
    messages: int
    latched: int
    """Of those, what latched topics had said before, now at the beginning."""


def cut(
    path: str | Path,
    output: str | Path,
    begin: int | None = None,
    end: int | None = None,
    compression: Compression = "zstd",
    *,
    force: bool = False,
    tell: Tell = silent,
) -> Edited:
    """A part of a recording: arrivals from `begin` on and before `end`, ns since the epoch.

    `force` takes the place of a file of this name, and `tell` is told how far it is.

    Raises:
        BagError: it cannot be read, has nothing in that time, or `output` is there already or cannot be written.
    """
    if begin is not None and end is not None and begin >= end:
        raise BagError(f"nothing is from {begin} ns on and before {end} ns", str(path))
    return _edit([path], lambda _: True, begin, end, _New(output, compression, force), tell)


def keep(
    path: str | Path,
    output: str | Path,
    wanted: Callable[[str], bool],
    compression: Compression = "zstd",
    *,
    force: bool = False,
    tell: Tell = silent,
) -> Edited:
    """Some topics of a recording: those whose names are wanted; `force` and `tell` as in `cut`.

    Raises:
        BagError: it cannot be read, has no such topic, or `output` is there already or cannot be written.
    """
    return _edit([path], wanted, None, None, _New(output, compression, force), tell)


def merge(
    paths: Sequence[str | Path],
    output: str | Path,
    compression: Compression = "zstd",
    *,
    force: bool = False,
    tell: Tell = silent,
) -> Edited:
    """Several recordings as one, in the order of arrivals; `force` and `tell` as in `cut`.

    Raises:
        BagError: one cannot be read, or `output` is there already or cannot be written.
    """
    if not paths:
        raise BagError("there is nothing to merge: name two recordings or more")
    return _edit(paths, lambda _: True, None, None, _New(output, compression, force), tell)


class _New(NamedTuple):
    """The file that is made."""

    path: str | Path
    compression: Compression
    force: bool


def _edit(
    paths: Sequence[str | Path],
    wanted: Callable[[str], bool],
    begin: int | None,
    end: int | None,
    new: _New,
    tell: Tell,
) -> Edited:
    files = Files(*(files_of(path) for path in paths))
    with Bag(" ".join(map(str, paths)), files, transforms) as bag:
        _refuse_damaged(bag)
        topics = [topic for topic in bag.topics.values() if wanted(topic.name)]
        if not topics and (bag.topics or begin is not None or end is not None):
            raise BagError("it has none of these topics", bag.path)
        names = [topic.name for topic in topics]
        total = sum(topic.count for topic in topics) if begin is None and end is None else 0
        profiles = {index.header.profile for index in files.indexes}
        profile = profiles.pop() if len(profiles) == 1 else ""
        with new_file(new.path, new.compression, force=new.force, profile=profile) as writer:
            numbers = say_topics(files, topics, writer)
            latched = 0
            if begin is not None:
                for message in bag.latched(begin):
                    if message.topic in numbers:
                        number = numbers[message.topic]
                        writer.add_message(number, message.sequence, begin, message.published, message.data)
                        latched += 1
            count = 0
            for message in counted(bag.messages(names, begin, end), total, tell):
                number = numbers[message.topic]
                writer.add_message(number, message.sequence, message.arrived, message.published, message.data)
                count += 1
            if not count and (begin is not None or end is not None):
                raise BagError(f"no message came in that time; they came from {bag.begin} to {bag.end} ns", bag.path)
            _copy_what_is_beside(bag, writer)
        return Edited(str(new.path), len(topics), count + latched, latched)


def _refuse_damaged(bag: Bag) -> None:
    """A file that a power cut has left without a beginning is no loss; all else that is wrong has to be mended first.

    Raises:
        DamagedBag: something is wrong.
    """
    for fault in bag.faults:
        if not (fault.cut and fault in bag.files.faults):
            text = f"{fault.reason}; `robo bag recover` makes a whole file of what can be read"
            raise DamagedBag(text, fault.path, fault.offset)


def say_topics(files: Files, topics: Sequence[Topic], writer: FileWriter) -> dict[Topic, int]:
    """Write down topics and their types; the number of each."""
    schemas: dict[tuple[str, str, bytes], int] = {}
    numbers: dict[Topic, int] = {}
    for topic in topics:
        file, number = min(topic.channels)
        index = files.indexes[file]
        channel = index.channels[number]
        schema = index.schemas.get(channel.schema_id)
        schema_id = 0
        if schema is not None:
            said = schema.name, schema.encoding, schema.data
            schema_id = schemas.setdefault(said, len(schemas) + 1)
            writer.add_schema(msgspec.structs.replace(schema, id=schema_id))
        numbers[topic] = len(numbers) + 1
        writer.add_channel(msgspec.structs.replace(channel, id=numbers[topic], schema_id=schema_id))
    return numbers


def _copy_what_is_beside(bag: Bag, writer: FileWriter) -> None:
    """Attachments and metadata, each once, of attachments one at a time in memory; counts do not hold any more."""
    import hashlib  # 4 MB, which a recorder does without

    seen_words: set[tuple[str, tuple[tuple[str, str], ...]]] = set()
    for words in bag.all_metadata():
        said = words.name, tuple(words.words.items())
        if words.name not in (COUNTS, REPEATED) and said not in seen_words:
            seen_words.add(said)
            writer.add_metadata(words.name, words.words)
    seen: set[tuple[str, bytes]] = set()
    last = []
    for number, one in enumerate(bag.all_attachments()):
        what = one.name, hashlib.sha256(one.data).digest()
        if what not in seen:
            seen.add(what)
            last.append(number)
    if not last:
        return
    count = sum(len(index.attachments) for index in bag.files.indexes)
    wanted = {count - 1 - number for number in last}
    for number, one in enumerate(bag.all_attachments(newest_first=False)):
        if number in wanted:
            writer.add_attachment(one.arrived, one.created, one.name, one.media_type, one.data)
