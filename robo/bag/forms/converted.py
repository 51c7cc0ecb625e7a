"""What a conversion has come to, and the messages that it adds to a new recording."""

from collections.abc import Callable

import msgspec

from robo.bag.mcap import format as mcap
from robo.bag.mcap.file_writer import FileWriter
from robo.bag.mcap.index import COUNTS, REPEATED
from robo.bag.mcap.packing import U32
from robo.bag.options import TopicInFile
from robo.bag.read.reader import Bag
from robo.bag.read.topics import Topic
from robo.bag.write.contents import Contents
from robo.bag.write.writer import MOST_MESSAGE
from robo.errors import BagError

LAST_TIME = 2**63 - 1
"""ns since the epoch: the year 2262, and what programs that read times as ROS has them can hold."""

Wanted = Callable[[str], bool]
"""Whether a topic is meant."""


class Converted(msgspec.Struct, frozen=True):
    """What a conversion has come to."""

    output: str
    topics: int
    """With messages."""
    messages: int
    notes: list[str]
    """What is left out, and why: one line each."""


class Added:
    """A new recording to which messages are added, topic by topic as they come."""

    def __init__(self, writer: FileWriter, path: str) -> None:
        """`path` is that of the source, for messages."""
        self.messages = 0
        self._writer = writer
        self._path = path
        self._contents = Contents()
        self._used: set[int] = set()

    @property
    def topics(self) -> int:
        """With messages."""
        return len(self._used)

    def topic(self, topic: TopicInFile) -> int:
        """The number of a topic, which is said where it is new.

        Raises:
            BagError: there are too many.
        """
        number = self._contents.number(topic)
        if number is None:
            try:
                number = self._contents.add_topic(topic, self._writer)
            except BagError as error:
                raise BagError(error.reason, self._path) from None
        return number

    def add(self, topic: int, data: bytes, arrived: int, published: int, sequence: int) -> None:
        """A message: times in ns since the epoch; a whole sequence number, 0 where there is none.

        Raises:
            BagError: no file can hold it.
        """
        for time in (arrived, published):
            if not 0 <= time <= LAST_TIME:
                raise BagError(f"no recording can hold the time {time} ns", self._path)
        if len(data) > MOST_MESSAGE:
            raise BagError(f"a message of {len(data):,} bytes is larger than {MOST_MESSAGE:,}", self._path)
        self._writer.add_message(topic, sequence & U32, arrived, published, data)
        self.messages += 1
        self._used.add(topic)

    def done(self, output: str, notes: list[str]) -> Converted:
        """What it has come to.

        Raises:
            BagError: not one message was added.
        """
        if not self.messages:
            raise BagError("it holds no message that a recording could have", self._path)
        return Converted(output, self.topics, self.messages, notes)


def schema_of(bag: Bag, topic: Topic) -> mcap.Schema | None:
    """What a recording says of a topic's type, as it stands there; None where it says nothing."""
    file, number = min(topic.channels)
    index = bag.files.indexes[file]
    return index.schemas.get(index.channels[number].schema_id)


def left_behind(bag: Bag, form: str) -> list[str]:
    """What a form other than MCAP has no room for, in words; nothing of it is read."""
    found = []
    if names := list(bag.attachments):
        found.append(f"attachments stay behind, {form} has no place for them: {_listed(names)}")
    words = dict.fromkeys(one.name for index in bag.files.indexes for one in index.metadata)
    if names := [name for name in words if name not in (COUNTS, REPEATED)]:
        found.append(f"metadata stay behind, {form} has no place for them: {_listed(names)}")
    return found


def _listed(names: list[str], most: int = 10) -> str:
    more = len(names) - most
    return ", ".join(names[:most]) + (f" and {more:,} more" if more > 0 else "")
