"""A new recording of what others hold of a time, with more beside it: what a flight recorder hands out."""

from collections.abc import Callable, Sequence
from pathlib import Path

from robo.bag.edit.editing import Edited, say_topics
from robo.bag.edit.output import new_file
from robo.bag.mcap.compression import Compression
from robo.bag.mcap.file_writer import FileWriter
from robo.bag.read.files import Files
from robo.bag.read.reader import Bag
from robo.bag.types import nothing
from robo.errors import BagError


def excerpt(
    recordings: Sequence[Sequence[Path]],
    output: Path,
    begin: int,
    end: int,
    beside: Callable[[FileWriter], None],
    compression: Compression = "zstd",
) -> Edited:
    """Write what came in a time, what latched topics had said before it at its beginning.

    A file that is damaged gives what can be read of it. What is found may be nothing: then the file has what is beside.

    Args:
        recordings: the files of each, in their order; none is no mistake.
        output: the new file.
        begin: arrivals from here on, ns since the epoch.
        end: and before this time, ns since the epoch.
        beside: writes attachments and metadata.
        compression: of the new file.

    Raises:
        BagError: a file cannot be read, or `output` is there already or cannot be written.
    """
    there = [files for files in recordings if files]
    with new_file(output, compression) as writer:
        found = _copy(there, output, begin, end, writer) if there else Edited(str(output), 0, 0, 0)
        beside(writer)
    return found


def _copy(recordings: Sequence[Sequence[Path]], output: Path, begin: int, end: int, writer: FileWriter) -> Edited:
    files = Files(*recordings)
    with Bag(str(output), files, nothing) as bag:
        topics = list(bag.topics.values())
        numbers = say_topics(files, topics, writer)
        latched = bag.latched(begin)
        for message in latched:
            writer.add_message(numbers[message.topic], message.sequence, begin, message.published, message.data)
        count = 0
        try:
            for message in bag.messages(None, begin, end):
                number = numbers[message.topic]
                writer.add_message(number, message.sequence, message.arrived, message.published, message.data)
                count += 1
        except BagError as error:
            if not count:
                raise
            writer.add_metadata("flight_recorder_damage", {"reason": str(error)})
    return Edited(str(output), len(topics), count + len(latched), len(latched))
