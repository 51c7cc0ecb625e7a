"""What is said soon, read before it is due: a thread reads, and whoever says it finds it ready."""

import threading
from collections import deque
from collections.abc import Callable, Iterator
from typing import Generic, TypeVar

from robo.recording.play.playback import Item

T = TypeVar("T")

Wanted = Callable[[], bool]
"""Whether what is read is still wanted: what takes long asks now and then."""

MOST_BYTES = 2**24
"""That wait; whoever takes them may have as many in hand."""
MOST_ITEMS = 4_000
_BATCH = 64
"""Messages that are handed over at a time, at most."""
_BATCH_BYTES = 2**18


class Ahead(Generic[T]):
    """Reads in a thread of its own, and nowhere else: what is read need not be safe from several threads."""

    def __init__(self, read: Callable[[int, Wanted], Iterator[Item[T]]], size_of: Callable[[T], int]) -> None:
        """
        Args:
            read: what is to be said from a time on, ns since the epoch, for as long as that is wanted.
            size_of: a message, in bytes.
        """
        self._read = read
        self._size_of = size_of
        self._changed = threading.Condition()
        self._run = 0
        self._at = 0
        self._ready: deque[Item[T]] = deque()
        self._bytes = 0
        self._ended = False
        self._error: BaseException | None = None
        self._closed = False
        self._thread = threading.Thread(target=self._work, name="robo-read-ahead", daemon=True)
        self._thread.start()

    def run(self, at: int) -> Iterator[Item[T]]:
        """What is to be said from a time on; what an earlier call returned ends.

        Raises:
            Exception: what reading raises, in the place where it did.
        """
        with self._changed:
            self._run += 1
            self._at = at
            self._forget()
            self._changed.notify_all()
            return self._items(self._run)

    def stop(self) -> None:
        """Read no more: what `run` returned ends."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def close(self) -> None:
        """Read no more. What is read may be closed after this."""
        self.stop()
        self._thread.join()

    def _items(self, run: int) -> Iterator[Item[T]]:
        while True:
            with self._changed:
                while run == self._run and not (self._ready or self._ended or self._closed):
                    self._changed.wait()
                if run != self._run or self._closed:
                    return
                taken, self._ready, self._bytes = self._ready, deque(), 0
                error = self._error
                self._changed.notify_all()
            yield from taken
            if not taken:
                if error is not None:
                    raise error
                return

    def _work(self) -> None:
        done = 0
        while True:
            with self._changed:
                while not self._closed and self._run == done:
                    self._changed.wait()
                if self._closed:
                    return
                done, at = self._run, self._at
            error: BaseException | None = None
            try:
                self._read_all(done, at)
            except BaseException as raised:  # it is told to whoever wants the messages
                error = raised
            with self._changed:
                if self._run == done:
                    self._ended, self._error = True, error
                    self._changed.notify_all()

    def _read_all(self, run: int, at: int) -> None:
        batch: list[Item[T]] = []
        size = 0
        try:
            for item in self._read(at, lambda: run == self._run and not self._closed):
                batch.append(item)
                size += self._size_of(item.what)
                if len(batch) >= _BATCH or size >= _BATCH_BYTES or not self._ready:
                    if not self._hand_over(run, batch, size):
                        return
                    batch, size = [], 0
        finally:
            self._hand_over(run, batch, size)  # also what comes before a part that cannot be read

    def _hand_over(self, run: int, batch: list[Item[T]], size: int) -> bool:
        """Returns whether more is wanted, once there is room."""
        with self._changed:
            if run != self._run or self._closed:
                return False
            self._ready.extend(batch)
            self._bytes += size
            self._changed.notify_all()
            while (self._bytes > MOST_BYTES or len(self._ready) > MOST_ITEMS) and run == self._run and not self._closed:
                self._changed.wait()
            return run == self._run and not self._closed

    def _forget(self) -> None:
        self._ready, self._bytes, self._ended, self._error = deque(), 0, False, None
