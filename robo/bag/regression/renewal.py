"""A recording with the outputs of some nodes taken from another one: a new reference, whole, or not there."""

import heapq
import os
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path

from robo.bag.mcap.compression import best_compression
from robo.bag.mcap.index import COUNTS, REPEATED
from robo.bag.options import Options, TopicInFile
from robo.bag.read.reader import Bag
from robo.bag.read.topics import BagMessage, Topic
from robo.bag.write.writer import Recording
from robo.errors import BagError


def renew(old: Bag, new: Bag, outputs: Collection[str], words: Mapping[str, dict[str, str]], output: Path) -> int:
    """Write what `old` has, but of `outputs` what `new` has; the file takes the place of one that is there, at once.

    Args:
        old: the recording.
        new: what is to be said of the outputs.
        outputs: names of topics.
        words: metadata by name, in the place of those that `old` has.
        output: of the file.

    Returns:
        How many messages it has.

    Raises:
        BagError: it cannot be written.
    """
    part = output.with_name(f".{output.name}.{os.getpid()}.mcap")
    try:
        count = _write(old, new, outputs, words, part)
        part.replace(output)
    except OSError as error:
        raise BagError(f"it cannot be written: {error.strerror}", str(output)) from None
    finally:
        part.unlink(missing_ok=True)
    return count


def _write(old: Bag, new: Bag, outputs: Collection[str], words: Mapping[str, dict[str, str]], path: Path) -> int:
    kept = [name for name in old.topics if name not in outputs]
    with Recording(path, Options(compression=best_compression())) as recording:
        numbers: dict[Topic, int] = {}
        for bag, names in ((old, kept), (new, [name for name in new.topics if name in outputs])):
            for name in names:
                topic = bag.topic(name)
                qos_of = old.topics.get(name, topic)
                numbers[topic] = recording.topic(_in_file(bag, topic, qos_of))
        for about in old.all_metadata():
            if about.name not in (COUNTS, REPEATED, *words):
                recording.add_metadata(about.name, about.words)
        for name, said in words.items():
            recording.add_metadata(name, said)
        for file in reversed(list(old.all_attachments())):
            recording.attach(file.name, file.data, file.media_type, file.arrived)
        count = 0
        for message in heapq.merge(_chosen(old, kept), _chosen(new, outputs), key=lambda one: one.arrived):
            sequence = message.sequence or None
            recording.write(numbers[message.topic], message.data, message.arrived, message.published, sequence)
            count += 1
        return count


def _chosen(bag: Bag, names: Collection[str]) -> Iterator[BagMessage]:
    there = [name for name in names if name in bag.topics]
    return bag.messages(there) if there else iter(())


def _in_file(bag: Bag, topic: Topic, offered: Topic) -> TopicInFile:
    file, number = min(topic.channels)
    index = bag.files.indexes[file]
    channel = index.channels[number]
    schema = index.schemas.get(channel.schema_id)
    return TopicInFile(
        channel.topic.removeprefix("/"),
        topic.schema,
        topic.text,
        channel.metadata.get("topic_type_hash", ""),
        offered.qos,
        topic.encoding,
        schema.encoding if schema is not None else "",
    )
