"""A new recording of what others hold of a time, with more beside it: what a flight recorder hands out."""

from collections.abc import Callable, Sequence
from pathlib import Path

from robo.bag.edit.editing import Edited, say_topics
from robo.bag.edit.output import new_file
from robo.bag.mcap.compression import Compression
from robo.bag.mcap.file_writer import FileWriter
from robo.bag.read.files import Files
from robo.bag.read.reader import Bag
from robo.bag.read.topics import BagMessage
from robo.bag.types import transforms
from robo.errors import BagError


def excerpt(
    recordings: Sequence[Sequence[Path]],
    output: Path,
    begin: int,
    end: int,
    beside: Callable[[FileWriter], None],
    compression: Compression = "zstd",
    later: int = 0,
) -> Edited:
    """Write what came in a time, what latched topics had said before it at its beginning.

    A file that is damaged gives what can be read of it, and the metadata `flight_recorder_damage` say why there is no
    more. What is found may be nothing: then the file has what is beside.

    Args:
        recordings: the files of each, in their order; none is no mistake.
        output: the new file.
        begin: arrivals from here on, ns since the epoch.
        end: and before this time, ns since the epoch.
        beside: writes attachments and metadata.
        compression: of the new file.
        later: by how much all is to have arrived later in the new file, ns.

    Raises:
        BagError: `output` is there already or cannot be written.
    """
    there = [files for files in recordings if files]
    found = Edited(str(output), 0, 0, 0)
    with new_file(output, compression) as writer:
        try:
            if there:
                found = _copy(Files(*there), output, begin, end, writer, later)
        except BagError as error:  # of what is read: what cannot be written is an OSError here
            _say_damage(writer, error)
        beside(writer)
    return found


def _say_damage(writer: FileWriter, error: BagError) -> None:
    writer.add_metadata("flight_recorder_damage", {"reason": str(error)})


def _copy(files: Files, output: Path, begin: int, end: int, writer: FileWriter, later: int) -> Edited:
    with Bag(str(output), files, transforms) as bag:
        topics = list(bag.topics.values())
        numbers = say_topics(files, topics, writer)
        latched: list[BagMessage] = []
        try:
            latched = bag.latched(begin)
        except BagError as error:
            _say_damage(writer, error)
        for message in latched:
            writer.add_message(numbers[message.topic], message.sequence, begin + later, message.published, message.data)
        count = 0
        try:
            for message in bag.messages(None, begin, end):
                number = numbers[message.topic]
                writer.add_message(number, message.sequence, message.arrived + later, message.published, message.data)
                count += 1
        except BagError as error:
            _say_damage(writer, error)
    return Edited(str(output), len(topics), count + len(latched), len(latched))
