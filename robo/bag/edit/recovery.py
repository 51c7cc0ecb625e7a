"""A whole file of one that is cut or damaged: whatever of it can be read, with an index and a summary made anew."""

from collections.abc import Callable
from pathlib import Path

import msgspec

from robo.bag.edit.output import new_file, new_folder
from robo.bag.mcap import format as mcap
from robo.bag.mcap.file_writer import FileWriter
from robo.bag.mcap.format import Malformed, rows
from robo.bag.mcap.index import Index, from_summary
from robo.bag.mcap.scan import scanned
from robo.bag.mcap.source import Place, Source
from robo.bag.progress import Tell, silent
from robo.bag.read.files import files_of
from robo.errors import BagError, DamagedBag


class Recovered(msgspec.Struct, frozen=True):
    """What a recovery has come to."""

    path: str
    output: str
    messages: int
    begin: int
    """The first arrival, ns since the epoch; 0 where there is no message."""
    end: int
    faults: list[DamagedBag]
    """What was wrong with the file; empty for one that was whole."""
    size: int
    """Of the file, bytes."""
    read: int
    """Up to where it could be read, bytes."""


def recover(path: str | Path, output: str | Path, *, force: bool = False, tell: Tell = silent) -> Recovered:
    """Make a whole file of what can be read of another one, which stays as it is; of a folder, part by part, a folder.

    Chunks are copied as they are; those that are damaged are left out. Where the file is cut, its tail is.

    Args:
        path: of the file or folder.
        output: of the new one.
        force: take the place of a file of this name; never of a folder.
        tell: is told how far it is, in bytes of twice the file: it is looked at, then copied.

    Raises:
        DamagedBag: it has not even a header.
        BagError: it cannot be read, or `output` is there already or cannot be written.
    """
    if Path(path).is_dir():
        return _recover_parts(Path(path), Path(output))
    return _recover_file(path, output, force, tell)


def _recover_file(path: str | Path, output: str | Path, force: bool, tell: Tell) -> Recovered:
    with Source(path) as source:
        found = scanned(source, lambda done, _: tell(done, 2 * source.size))
        if not found.faults:
            try:
                from_summary(source)
            except DamagedBag as fault:
                found.add_fault(fault)
        with new_file(output, "none", force=force, profile=found.header.profile) as writer:
            _copy(source, found, writer, lambda done, _: tell(source.size + done, 2 * source.size))
        messages = sum(found.counts.values())
        return Recovered(
            str(path), str(output), messages, found.begin, found.end, found.faults, source.size, found.data_end
        )


def _recover_parts(path: Path, output: Path) -> Recovered:
    """Each file of a folder; one that has not even a beginning is left out."""
    parts: list[Recovered] = []
    faults: list[DamagedBag] = []
    with new_folder(output) as draft:
        for file in files_of(path):
            try:
                parts.append(_recover_file(file, draft / file.name, force=False, tell=silent))
            except BagError as error:
                if error.path != str(file):
                    raise  # it cannot be written
                faults.append(error if isinstance(error, DamagedBag) else DamagedBag(error.reason, error.path))
        if not parts:
            raise faults[0]
    full = [part for part in parts if part.messages]
    return Recovered(
        str(path),
        str(output),
        sum(part.messages for part in parts),
        min((part.begin for part in full), default=0),
        max((part.end for part in full), default=0),
        faults + [fault for part in parts for fault in part.faults],
        sum(part.size for part in parts),
        sum(part.read if any(fault.cut for fault in part.faults) else part.size for part in parts),
    )


def _copy(source: Source, found: Index, writer: FileWriter, tell: Tell) -> None:
    # First, so that they are there even if the chunk that said them is not.
    for schema in found.schemas.values():
        writer.add_schema(schema)
    for channel in found.channels.values():
        writer.add_channel(channel)
    steps: list[tuple[int, Callable[[], None]]] = []
    for block in found.blocks:
        copy = _copy_chunk if block.place.kind else _copy_run
        steps.append((block.place.offset, _step(copy, source, block.place, writer)))
    for attached in found.attachments:
        steps.append((attached.offset, _step(_copy_attachment, source, source.place(attached.offset), writer)))
    for words in found.metadata:
        steps.append((words.offset, _step(_copy_metadata, source, source.place(words.offset), writer)))
    for offset, step in sorted(steps, key=lambda step: step[0]):
        tell(offset, source.size)
        try:
            step()
        except DamagedBag as fault:  # a checksum that nobody has looked at before
            found.add_fault(fault)
        except Malformed as error:
            found.add_fault(source.damaged(offset, str(error)))


def _step(
    copy: Callable[[Source, Place, FileWriter], None], source: Source, place: Place, writer: FileWriter
) -> Callable[[], None]:
    return lambda: copy(source, place, writer)


def _copy_chunk(source: Source, place: Place, writer: FileWriter) -> None:
    chunk = source.chunk(place)
    writer.copy_chunk(chunk, source.restored(place, chunk))


def _copy_run(source: Source, place: Place, writer: FileWriter) -> None:
    data = source.content(place)
    for row in rows(data):
        writer.add_message(row.channel, row.sequence, row.arrived, row.published, data[row.begin : row.end])


def _copy_attachment(source: Source, place: Place, writer: FileWriter) -> None:
    one = source.attachment(place.offset)
    writer.add_attachment(one.arrived, one.created, one.name, one.media_type, one.data)


def _copy_metadata(source: Source, place: Place, writer: FileWriter) -> None:
    words = mcap.metadata(source.content(place))
    writer.add_metadata(words.name, words.words)
