"""The files of a recording: one, or a folder of them in the order of their numbers."""

import contextlib
import os
import re
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from robo.bag.mcap.format import METADATA, Malformed, Metadata, MetadataIndex, metadata
from robo.bag.mcap.index import Block, Index
from robo.bag.mcap.scan import index_of, scanned
from robo.bag.mcap.source import OTHERS, UNZSTD, Source
from robo.bag.progress import Tell, silent
from robo.bag.read.order import Cache, Data, Span
from robo.errors import BagError, DamagedBag, UnreadableFile
from robo.text.brief import brief
from robo.text.files import read_text

_MOST_OPEN = 16
"""Files at a time."""


def files_of(path: str | Path) -> list[Path]:
    """The files of a recording: those of a folder have one name and numbers behind it, or it has one alone.

    Raises:
        BagError: there is nothing of this name, a folder without recordings, or one with several.
    """
    path = Path(path)
    try:
        if not path.is_dir():
            return [path]
        names = [entry.name for entry in os.scandir(path) if not entry.name.startswith(".")]
    except (OSError, ValueError) as error:  # a ValueError where its name holds a zero character
        raise BagError(getattr(error, "strerror", None) or str(error), str(path)) from None
    found = sorted((name for name in names if name.endswith(".mcap")), key=_natural)
    if not found:
        raise BagError(f"the folder has no recording: {_reason(names)}", str(path))
    stems = {stem_of(name) for name in found}
    if len(found) > 1 and (len(stems) > 1 or None in stems):
        raise BagError(
            f"the folder has several recordings, name one of them: {brief(', '.join(found), 300)}", str(path)
        )
    return [path / name for name in found]


def stem_of(name: str) -> str | None:
    """What files of a recording in parts have before their numbers; None for the name of another file."""
    match = _PART.fullmatch(name)
    return match[1] if match is not None else None


def number_of(path: str | Path) -> int | None:
    """Which part of a recording a file is; None for one that is no part."""
    match = _PART.fullmatch(Path(path).name)
    return int(match[2]) if match is not None else None


def missing_parts(paths: Sequence[Path]) -> list[str]:
    """Files that a recording in parts should have and has not: between others, or named by ROS's `metadata.yaml`."""
    stems, numbers = {stem_of(path.name) for path in paths}, {number_of(path) for path in paths}
    (stem, *others), there = stems, {number for number in numbers if number is not None}
    if stem is None or others or len(there) != len(paths):
        return []
    text = ""
    with contextlib.suppress(UnreadableFile):
        text = read_text(paths[0].parent / "metadata.yaml")
    named = {number_of(name) for name in _NAMED.findall(text) if stem_of(name) == stem}
    wanted = {number for number in named if number is not None}
    if len(there) * 10 > max(there) - min(there):  # else the numbers are some others, such as dates
        wanted |= set(range(min(there), max(there)))
    return [f"{stem}_{number}.mcap" for number in sorted(wanted - there)]


_NAMED = re.compile(r"""^\s*-\s+["']?([^"'\n]+\.mcap)["']?\s*$""", re.MULTILINE)
_PART = re.compile(r"(.*)_(\d{1,18})\.mcap", re.ASCII | re.DOTALL)

_FORMS = {
    ".db3": OTHERS[b"SQLite f"],
    ".bag": OTHERS[b"#ROSBAG "],
    ".mcap.zstd": f"compressed as a whole: {UNZSTD}",
    ".mcap.zst": f"compressed as a whole: {UNZSTD}",
}


def _reason(names: Sequence[str]) -> str:
    for ending, what in _FORMS.items():
        for name in names:
            if name.endswith(ending):
                return f"{name} is {what}"
    return "no file that ends in .mcap"


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
                self._add(path, partial(scanned, tell=tell) if scan else index_of, alone=len(paths) == 1)
        if not self.indexes:
            raise self.faults[0]
        self.counts = [dict(index.counts) for index in self.indexes]
        """Messages by channel, of each file; what is said again is left out."""
        self._blocks: list[tuple[int, Block]] = []
        try:
            for number, index in enumerate(self.indexes):
                follows = number not in first and self._follows(number)
                after = self._leave_out_repeats(number, index) if follows else 0
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

    def _add(self, path: str | Path, look: Callable[[Source], Index], *, alone: bool) -> None:
        try:
            with Source(path) as source:
                index = look(source)
        except DamagedBag as fault:
            self.faults.append(fault)
            return
        except BagError as error:
            if alone:
                raise
            self.faults.append(DamagedBag(error.reason, str(path)))
            return
        self.paths.append(source.path)
        self.sizes.append(source.size)
        self.indexes.append(index)

    def _follows(self, number: int) -> bool:
        """Whether a file has the one before it beside it, and whole: else what it says again is said nowhere else."""
        here, before = number_of(self.paths[number]), number_of(self.paths[number - 1])
        return here is not None and before == here - 1 and not self.indexes[number - 1].faults

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
