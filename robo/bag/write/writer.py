"""Writing a recording: one file, or a folder of files that follow one another."""

import time
from collections.abc import Callable, Hashable
from contextlib import suppress
from pathlib import Path

from robo.bag.mcap.compression import MOST, compressor
from robo.bag.mcap.index import COUNTS
from robo.bag.mcap.packing import U32, U64
from robo.bag.options import Options, TopicInFile
from robo.bag.write import counts
from robo.bag.write.contents import Contents
from robo.bag.write.counts import Counter, Counts
from robo.bag.write.disk import Disk, Free, free_room
from robo.bag.write.kept import Said
from robo.bag.write.part import Part
from robo.errors import BagError, DiskFull

MOST_MESSAGE = MOST - 2**26
"""Of a message, bytes: with a chunk before it, it is no more than what is read again."""
MOST_ATTACHMENT = 2**28
"""Bytes: as much as is read again."""


class Recording:
    """Writes a recording. Used by one thread at a time; also a context manager that closes it."""

    def __init__(
        self,
        path: str | Path,
        options: Options | None = None,
        *,
        monotonic: Callable[[], float] = time.monotonic,
        free: Free = free_room,
    ) -> None:
        """
        Args:
            path: of the file; of the folder where there are to be several.
            options: how it is written.
            monotonic: a clock that never goes back, s: for flushes.
            free: room on the disk of a folder, bytes.

        Raises:
            BagError: it cannot be made, is there already, or the library for its compression is not installed.
        """
        self.path = str(path)
        self._options = options if options is not None else Options()
        self._compression = compressor(self._options.compression)
        self._monotonic = monotonic
        self._contents = Contents()
        self._counter = Counter()
        self._disk = Disk(path, self._options, free)
        self._flush_due = monotonic() + self._options.flush_period
        self._ended: BagError | None = None
        """Why nothing can be written any more."""
        span, size = self._options.split_duration, self._options.split_size
        self._split_span = round(min(span, 1e10) * 1e9) if span is not None else 2**64
        self._split_size = size if size is not None else 2**64
        self._part = self._next_part(0)

    def topic(self, topic: TopicInFile) -> int:
        """The number of a topic, for its messages. One that is new is in the file at once.

        Raises:
            BagError: there are too many, or the file cannot be written.
        """
        number = self._contents.number(topic)
        if number is None:
            self._check_open()
            with self._part.writing():
                number = self._contents.add_topic(topic, self._part.writer)
            self._part.flush(sync=False)
        return number

    def write(
        self,
        topic: int,
        data: bytes,
        arrived: int,
        published: int,
        sequence: int | None = None,
        source: Hashable = None,
    ) -> None:
        """Write a message down.

        Args:
            topic: its number.
            data: encoded as its topic says.
            arrived: ns since the epoch, by this machine's clock.
            published: ns since the epoch, by the publisher's; one that no file can hold becomes the time of arrival.
            sequence: its whole number; None where its publisher does not count.
            source: its publisher; None where that is not known.

        Raises:
            DiskFull: the disk has less room than it is to leave; the recording has ended, and is whole.
            BagError: the recording has ended, or the file cannot be written.
        """
        if self._ended is not None:
            self._check_open()
        if not 0 <= arrived <= U64:
            raise BagError(f"a message cannot have come at {arrived} ns: no file can hold this time", self.path)
        if not 0 <= published <= U64:
            published = arrived
        if len(data) > MOST_MESSAGE:
            name, most = self._contents.names[topic], f"{MOST_MESSAGE:,}"
            raise BagError(f"{name}: a message of {len(data):,} bytes is larger than {most}")
        part = self._part
        if part.counts and (arrived - part.begin >= self._split_span or part.size - part.head >= self._split_size):
            self.split(arrived)
            part = self._part
        self._counter.count(self._contents.names[topic], sequence, published, source)
        number = (sequence or 0) & U32
        if self._contents.is_latched(topic):
            self._contents.keep(Said(topic, number, arrived, published, data), source)
        part.add(topic, number, arrived, published, data)
        if self._monotonic() >= self._flush_due:
            self.flush()

    def malformed(self, topic: str, sequence: int | None = None, published: int = 0, source: Hashable = None) -> None:
        """A message came that cannot be written down: it is counted, and not among the lost. The rest as of `write`."""
        self._counter.count_malformed(topic, sequence, published, source)

    def left_out(self, topic: str, count: int) -> None:
        """So many messages of a topic came that nobody has even looked at: they are counted."""
        self._counter.count_left_out(topic, count)

    def forget(self, topic: str, source: Hashable) -> None:
        """A publisher of a latched topic is replaced: what it has said last is not said again in files that follow."""
        self._contents.forget(topic, source)

    def attach(self, name: str, data: bytes, media_type: str, time: int) -> None:
        """Write a file into this file and those that follow.

        Args:
            name: of it; another one of this name takes its place in the files that follow.
            data: what it holds.
            media_type: `text/yaml`, …
            time: of now, ns since the epoch.

        Raises:
            BagError: the recording has ended, or the file cannot be written.
        """
        self._check_open()
        if len(data) > MOST_ATTACHMENT:
            raise BagError(f"{name} has {len(data):,} bytes, and at most {MOST_ATTACHMENT:,} go into a file", self.path)
        with self._part.writing():
            self._contents.attach(name, data, media_type, time, self._part.writer)

    def add_metadata(self, name: str, words: dict[str, str]) -> None:
        """Write words about the recording into this file and those that follow.

        Raises:
            BagError: the recording has ended, or the file cannot be written.
        """
        self._check_open()
        with self._part.writing():
            self._contents.add_metadata(name, words, self._part.writer)

    @property
    def counts(self) -> dict[str, Counts]:
        """How many messages of each topic came, and how many did not, so far."""
        return self._counter.total

    @property
    def files(self) -> list[Path]:
        """The files that are there, the oldest first."""
        return self._disk.files

    def flush(self) -> None:
        """Everything that was written is in the file from now on, whatever becomes of this process.

        Raises:
            DiskFull, BagError: as `write`.
        """
        self._check_open()
        self._flush_due = self._monotonic() + self._options.flush_period  # however long it takes
        self._part.flush(self._options.sync)
        if not self._disk.has_room():
            least = f"{self._options.least_free:,}"
            self._close(DiskFull(f"the recording has ended: the disk has less than {least} bytes left", self.path))
            self._check_open()

    def tick(self) -> float:
        """Flush if that is due. To be called while nothing comes: again after the time that it returns, s.

        Raises:
            DiskFull, BagError: as `write`.
        """
        if self._monotonic() >= self._flush_due:
            self.flush()
        return max(self._flush_due - self._monotonic(), 0.0)

    def split(self, at: int) -> None:
        """Go on in another file, which begins with what latched topics have said last.

        Args:
            at: the time of now, ns since the epoch: that is when what is said again has come.

        Raises:
            BagError: this recording is one file, or has ended, or a file cannot be written.
        """
        self._check_open()
        if not self._options.splits:
            raise BagError("it is one file; one with split_size, split_duration or split_by_hand is several", self.path)
        self._finish_part()
        try:
            self._part = self._next_part(at)
        except BaseException as error:
            self._ended = BagError(f"the recording has ended: {error}")
            raise
        self._disk.keep_newest(at)

    def snapshot(self, folder: str | Path, at: int) -> list[Path]:
        """Go on in another file, and give all files that are there second names: they stay when the recording lets go
        of its oldest ones.

        Args:
            folder: where they are to stand; it is made.
            at: the time of now, ns since the epoch.

        Returns the second names, the oldest file first.

        Raises:
            BagError: as `split`; or the folder is there already, or cannot be made.
        """
        self.split(at)
        return self._disk.snapshot(Path(folder), self._contents.types)

    def close(self) -> None:
        """End the recording: its last file is whole. Once more does nothing.

        Raises:
            BagError: the file cannot be written.
        """
        if self._ended is None:
            self._close(BagError("the recording has ended", self.path))

    def discard(self) -> None:
        """End it, and leave nothing of it."""
        with suppress(BagError):
            self.close()
        self._disk.discard()

    def __enter__(self) -> "Recording":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _close(self, why: BagError) -> None:
        self._ended = why
        if self._part.failure is None:
            self._finish_part()

    def _check_open(self) -> None:
        if self._ended is not None:
            raise self._ended.with_traceback(None)

    def _next_part(self, at: int) -> Part:
        output = self._disk.open_next()
        part = Part(output, str(self._disk.now), self._compression, self._options.chunk_size)
        with part.writing():
            self._contents.begin(part.writer, at)
        part.head = part.size
        self._disk.begun(part.head)
        return part

    def _finish_part(self) -> None:
        part = self._part
        counted = self._counter.take_file()
        with part.writing():
            part.writer.add_metadata(COUNTS, counts.words_of(counted))
        part.finish(self._options.sync)
        self._disk.finished(part.begin, part.end, self._contents.counts(part.counts), self._contents.types)
