"""The files of a recording: one, or a folder of them in the order of their numbers."""

import os
import re
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from robo.bag.mcap.format import METADATA, Malformed, Metadata, MetadataIndex, metadata
from robo.bag.mcap.index import Block, Index
from robo.bag.mcap.scan import index_of, scanned
from robo.bag.mcap.source import Source
from robo.bag.progress import Tell, silent
from robo.bag.read.order import Cache, Data, Span
from robo.errors import BagError, DamagedBag

_MOST_OPEN = 16
"""Files at a time."""


def files_of(path: str | Path) -> list[Path]:
    """The files of a recording.

    Raises:
        BagError: there is nothing of this name, or a folder without recordings.
    """
    path = Path(path)
    try:
        if not path.is_dir():
            return [path]
        names = [entry.name for entry in os.scandir(path) if entry.name.endswith(".mcap")]
    except (OSError, ValueError) as error:  # a ValueError where its name holds a zero character
        raise BagError(getattr(error, "strerror", None) or str(error), str(path)) from None
    if not names:
        raise BagError("the folder has no recording: no file that ends in .mcap", str(path))
    return [path / name for name in sorted(names, key=_natural)]


def _natural(name: str) -> list[tuple[int, str]]:
    """So that run_10 comes after run_9."""
    return [(int(part), "") if part.isdecimal() else (0, part) for part in re.split(r"(\d+)", name)]


class Files:
    """Files that are read as one recording, with what is in each."""

    def __init__(self, *recordings: Sequence[str | Path], scan: bool = False, tell: Tell = silent) -> None:
        """
        Args:
            recordings: the files of each, in their order.
            scan: look at all of each file, whatever its summary says.
            tell: is told how far that is with a file, in bytes.

        Raises:
            BagError: one of them cannot be read.
            DamagedBag: none of them is a recording.
        """
        self._sources: dict[int, Source] = {}
        self.paths: list[str] = []
        self.indexes: list[Index] = []
        self.sizes: list[int] = []
        self.faults: list[DamagedBag] = []
        """Of files that are no recordings at all."""
        first: set[int] = set()
        for paths in recordings:
            first.add(len(self.indexes))
            for path in paths:
                self._add(path, partial(scanned, tell=tell) if scan else index_of)
        if not self.indexes:
            raise self.faults[0]
        self.counts = [dict(index.counts) for index in self.indexes]
        """Messages by channel, of each file; what is said again is left out."""
        self._blocks: list[tuple[int, Block]] = []
        try:
            for number, index in enumerate(self.indexes):
                after = self._leave_out_repeats(number, index) if number not in first else 0
                self._blocks += [(number, block) for block in index.blocks if block.place.offset >= after]
        except BagError:
            self.close()
            raise
        self.spans: list[Span] = [Span(block.begin, block.end) for _, block in self._blocks]
        self._cache = Cache(self._load)

    def source(self, number: int) -> Source:
        """A file, open."""
        found = self._sources.pop(number, None)
        if found is None:
            found = Source(self.paths[number])
        self._sources[number] = found
        if len(self._sources) > _MOST_OPEN:
            self._sources.pop(next(iter(self._sources))).close()
        return found

    def block(self, number: int) -> tuple[int, Block]:
        """A block of them all, with the number of its file."""
        return self._blocks[number]

    def data(self, number: int) -> Data:
        """The records of a block.

        Raises:
            DamagedBag: it is damaged.
        """
        return self._cache.get(number)

    def damaged(self, number: int, reason: str) -> DamagedBag:
        """An error of a block."""
        file, block = self._blocks[number]
        return DamagedBag(reason, self.paths[file], block.place.offset)

    def close(self) -> None:
        """Close all files."""
        for source in self._sources.values():
            source.close()
        self._sources.clear()

    def _add(self, path: str | Path, look: Callable[[Source], Index]) -> None:
        try:
            with Source(path) as source:
                index = look(source)
        except DamagedBag as fault:
            self.faults.append(fault)
            return
        self.paths.append(source.path)
        self.sizes.append(source.size)
        self.indexes.append(index)

    def _leave_out_repeats(self, number: int, index: Index) -> int:
        """What the first blocks of a file say again does not count; where the others begin."""
        where = index.repeats
        if where is None:
            return 0
        counts = self.counts[number]
        for channel, again in self.metadata(number, where).words.items():
            if _is_number(channel) and int(channel) in counts and _is_number(again):
                counts[int(channel)] = max(counts[int(channel)] - int(again), 0)
        return where.offset

    def metadata(self, number: int, where: MetadataIndex) -> Metadata:
        """Words of a file.

        Raises:
            DamagedBag: there are none.
        """
        source = self.source(number)
        place = source.place(where.offset)
        try:
            if place.kind != METADATA:
                raise Malformed("there are no metadata, and the index says some are")
            return metadata(source.content(place))
        except Malformed as error:
            raise source.damaged(where.offset, str(error)) from None

    def _load(self, number: int) -> Data:
        file, block = self._blocks[number]
        source = self.source(file)
        if not block.place.kind:
            return source.content(block.place)
        place = source.place(block.place.offset)
        if place != block.place:
            raise source.damaged(block.place.offset, "there is another record than the index says")
        return source.restored(place, source.chunk(place))


def _is_number(text: str) -> bool:
    return len(text) < 20 and text.isascii() and text.isdecimal()
