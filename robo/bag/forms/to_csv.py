"""Recordings to CSV, a file for each topic.

A row is a message: its times, topic, type and sequence number, then its fields as `columns` has them.
"""

import base64
import csv
import io
import re
from collections.abc import Sequence
from pathlib import Path

from robo.bag.edit.output import new_folder
from robo.bag.forms.columns import HEAD, Column, cells_of, columns_of
from robo.bag.forms.converted import Converted, Wanted, left_behind
from robo.bag.forms.lines import STANDARD, new_text
from robo.bag.progress import Tell, counted, silent
from robo.bag.read.reader import Bag
from robo.bag.read.topics import BagMessage, Topic
from robo.errors import BagError
from robo.interfaces import catalogue
from robo_messages import Message

_MOST_FILES = 1_000
"""That one recording becomes."""
_MOST_WAITING = 2**24
"""Of rows that are not yet written, bytes."""
_NAME = re.compile(r"[^\w.-]+")


def to_csv(
    bag: Bag, output: str | Path, *, wanted: Wanted | None = None, force: bool = False, tell: Tell = silent
) -> Converted:
    """Write the messages of a recording as CSV: one topic to a file, several to files of a new folder.

    Args:
        bag: the recording.
        output: a file that ends in `.csv`, or `-` for standard output, for one topic; else the folder.
        wanted: which topics; None for all.
        force: take the place of a file of this name; never of a folder.
        tell: is told how many messages are done.

    Raises:
        DamagedBag: a part of the recording is damaged.
        BagError: there are several topics and `output` is one file, or it is there already or cannot be written.
    """
    topics = [topic for topic in bag.topics.values() if topic.count and (wanted is None or wanted(topic.name))]
    if not topics:
        raise BagError("no topic of those that are wanted has a message", bag.path)
    one_file = str(output) == STANDARD or Path(output).suffix.lower() == ".csv"
    if one_file and len(topics) > 1:
        names = ", ".join(topic.name for topic in topics[:10])
        raise BagError(
            f"a file has one topic, and there are {len(topics):,} ({names}{', …' if len(topics) > 10 else ''}): name "
            "one, or a folder for all of them",
            bag.path,
        )
    if len(topics) > _MOST_FILES:
        raise BagError(f"it has {len(topics):,} topics, and {_MOST_FILES:,} files at most: name some", bag.path)
    rows = _Rows(bag, topics)
    messages = counted(bag.messages([topic.name for topic in topics]), sum(topic.count for topic in topics), tell)
    if one_file:
        with new_text(output, force=force) as file:
            file.write(rows.head(topics[0]).encode())
            for message in messages:
                file.write(rows.row(message).encode())
    else:
        with new_folder(Path(output)) as folder:
            files = _Files(folder, topics, rows)
            for message in messages:
                files.add(message.topic, rows.row(message))
            files.write()
    return Converted(str(output), len(topics), rows.count, rows.notes())


class _Rows:
    """Makes rows of messages."""

    def __init__(self, bag: Bag, topics: Sequence[Topic]) -> None:
        self.count = 0
        self._bag = bag
        self._topics = topics
        self._bad: dict[str, int] = {}
        self._unknown: dict[str, Topic] = {}

    def head(self, topic: Topic) -> str:
        """The first row of a topic's file."""
        return _text([*HEAD, *(column.name for column in _columns(topic))])

    def row(self, message: BagMessage) -> str:
        """The row of a message; nothing where it is none of its type."""
        topic = message.topic
        number = str(message.sequence) if message.sequence else ""
        row = [str(message.published), str(message.arrived), topic.name, topic.type, number]
        try:
            value = message.value
        except BagError:
            self._bad[topic.name] = self._bad.get(topic.name, 0) + 1
            return ""
        if topic.unknown:
            self._unknown[topic.name] = topic
        if isinstance(value, Message):
            row += cells_of(value, _columns(topic))
        else:
            row.append(base64.b64encode(message.data).decode("ascii"))
        self.count += 1
        return _text(row)

    def notes(self) -> list[str]:
        """What is left out."""
        found = [f"{name}: {count:,} messages are left out, they are no {self._bag.topics[name].type}"
                 for name, count in self._bad.items()]  # fmt: skip
        found += [f"{name} stays bytes, in base64: {topic.unknown}" for name, topic in self._unknown.items()]
        latched = [topic.name for topic in self._topics if topic.qos.latched]
        if latched:
            found.append(f"CSV does not say that a topic is latched: {', '.join(latched[:10])}")
        return found + left_behind(self._bag, "CSV")


_BYTES = Column("payload", "bytes", (), ())
"""In place of the fields of a type that is not known."""


def _columns(topic: Topic) -> tuple[Column, ...]:
    type_ = catalogue.find_here(topic.known.name) if topic.known is not None else None
    return columns_of(type_) if type_ is not None else (_BYTES,)


def _text(row: Sequence[str]) -> str:
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator="\r\n").writerow(row)  # so that a cell with one of these is quoted
    return f"{text.getvalue()[:-2]}\n"


class _Files:
    """The files of a folder, one for each topic; few are open at a time."""

    def __init__(self, folder: Path, topics: Sequence[Topic], rows: _Rows) -> None:
        self._paths: dict[Topic, Path] = {}
        self._waiting: dict[Topic, list[str]] = {}
        self._size = 0
        taken: set[str] = set()
        for topic in topics:
            stem = _NAME.sub("_", topic.name.replace("/", "."))[:100].strip(".") or "topic"
            path, number = folder / f"{stem}.csv", 1
            while path.name.casefold() in taken:  # some disks take a and A for the same
                number += 1
                path = folder / f"{stem}_{number}.csv"
            taken.add(path.name.casefold())
            self._paths[topic] = path
            self._waiting[topic] = [rows.head(topic)]

    def add(self, topic: Topic, row: str) -> None:
        """One more row."""
        self._waiting[topic].append(row)
        self._size += len(row)
        if self._size > _MOST_WAITING:
            self.write()

    def write(self) -> None:
        """Write what waits."""
        for topic, waiting in self._waiting.items():
            if waiting:
                with self._paths[topic].open("ab") as file:
                    file.writelines(row.encode() for row in waiting)
                waiting.clear()
        self._size = 0
