"""One file of a recording while it is written: what is in it is whole up to the last chunk, whatever happens."""

import contextlib
import io
import os
from collections.abc import Iterator

from robo.bag.mcap.compression import Compress
from robo.bag.mcap.file_writer import FileWriter
from robo.errors import BagError

_sync = getattr(os, "fdatasync", os.fsync)


class Part:
    """A file with its first and last arrival."""

    def __init__(self, output: io.FileIO, path: str, compression: tuple[str, Compress | None], chunk_size: int) -> None:
        """
        Args:
            output: the file, empty.
            path: of it.
            compression: what MCAP calls it, and what does it.
            chunk_size: bytes.

        Raises:
            BagError: it cannot be written.
        """
        self.path = path
        self.begin = 0
        """The first arrival, ns."""
        self.end = 0
        """The last arrival, ns."""
        self.counts: dict[int, int] = {}
        """Messages by the number of their topic."""
        self.head = 0
        """Of what it begins with, as all files of a recording do, bytes."""
        self.failure: BagError | None = None
        """Why nothing can be written any more."""
        self._output = output
        self._has_name = os.fstat(output.fileno()).st_nlink > 0  # some disks do not tell
        with self.writing():
            self.writer = FileWriter(output, *compression, chunk_size)

    @property
    def size(self) -> int:
        """What has been written, bytes."""
        return self.writer.size

    def add(self, topic: int, sequence: int, arrived: int, published: int, data: bytes) -> None:
        """A message: times in ns, a sequence number of 32 bits."""
        if self.failure is not None:
            raise self.failure
        if not self.counts or arrived < self.begin:
            self.begin = arrived
        if arrived > self.end:
            self.end = arrived
        self.counts[topic] = self.counts.get(topic, 0) + 1
        try:
            self.writer.add_message(topic, sequence, arrived, published, data)
        except (OSError, ValueError) as error:
            raise self._failed(error) from None

    def flush(self, sync: bool) -> None:
        """Everything that was added is in the file; on the disk, too, where `sync`."""
        with self.writing():
            self.writer.end_chunk()
            self._settle(sync)

    def finish(self, sync: bool) -> None:
        """Make it a whole file, and close it."""
        try:
            with self.writing():
                self.writer.finish()
                self._settle(sync)
                self._output.close()  # a disk in the network may say only now that it is full
        finally:
            self._close()

    @contextlib.contextmanager
    def writing(self) -> Iterator[None]:
        """Around what may fail for want of room, or of a disk."""
        if self.failure is not None:
            raise self.failure
        try:
            yield
        except (OSError, ValueError) as error:
            raise self._failed(error) from None

    def _failed(self, error: OSError | ValueError) -> BagError:
        """What was written in part goes: a reader finds whole chunks. The first reason is the one that counts."""
        if self.failure is not None:
            return self.failure
        with contextlib.suppress(OSError, ValueError, AttributeError):
            os.ftruncate(self._output.fileno(), self.writer.size)
        self._close()
        reason = getattr(error, "strerror", None) or error
        text = f"it cannot be written: {reason}; `robo bag recover` makes a whole file of what is there"
        if isinstance(error, FileNotFoundError):
            text = "somebody has deleted it while it was recorded"
        self.failure = BagError(text, self.path)
        return self.failure

    def _settle(self, sync: bool) -> None:
        """On the disk, where `sync`; and it still has a name.

        Raises:
            OSError: it cannot be written; FileNotFoundError where somebody has deleted it.
        """
        if sync:
            _sync(self._output.fileno())
        if self._has_name and not os.fstat(self._output.fileno()).st_nlink:
            raise FileNotFoundError

    def _close(self) -> None:
        with contextlib.suppress(OSError):  # it is closed all the same
            self._output.close()
