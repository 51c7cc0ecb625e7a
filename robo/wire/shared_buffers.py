"""Shared memory itself: taken as it is needed, given to one message after the other, and read without being torn."""

import logging
import threading
import time
from typing import Any

import zenoh

from robo.wire.shared_room import FOLDER, MOST, free_bytes

LARGE = 65_536
"""From so many bytes on a message goes through shared memory: smaller ones are as quick through a socket."""

FIRST = 16 * 2**20
"""The least that is taken at once, bytes."""
_MESSAGES = 8
"""Of the first message's size, so many fit at least."""
_SPARE = 4 * 2**20
"""What is left free for others, and for Zenoh's own book-keeping of 1.3 MB, bytes."""
_PIECE = 2**17
"""What is not in `bytes` is copied by way of so many bytes at once: they stay in the processor's cache."""

LONGEST_WAIT = 1.0
"""How long a message that is not to be lost waits for memory, s, before it takes the socket."""
SHORT_WAIT = 0.003
"""How long another one does, s, before more memory is taken: no longer than a socket would take for it."""
_PAUSE = 0.0002
"""Between looks whether memory has become free, s."""

_logger = logging.getLogger("robo.wire.shared_buffers")


class SharedMemory:
    """What one process has of it, all its publishers together; taken when the first large message comes."""

    def __init__(self, problem: str = "", most: int = MOST) -> None:
        """`problem` says why there is none; `most` is what is taken at most, bytes."""
        self._hindered = problem
        self._most = most
        self._lock = threading.Lock()
        self._providers: list[Any] = []
        self._taken = 0
        self._patient = True
        self._told = False
        self.carried = 0
        """Messages that went through it, so far."""
        self.problem = problem
        """Why the last message that should have gone through it did not; empty where it did."""

    def buffer(self, size: int, *, wait: bool) -> Any:
        """Memory for one message, a `zenoh.shm.ZShmMut`; None where there is none.

        What readers have done with is taken again, the same place as soon as possible: it is in the processor's
        cache still. Where all is in use this waits for readers; without `wait` only briefly, and more is taken, up
        to `most`.

        Args:
            size: bytes.
            wait: whether a slow reader is to slow down the writer.
        """
        if self._hindered:
            return self._tell(self._hindered)
        found = self._find(size)
        if found is None and self._room_for(size):
            found = self._await(size, LONGEST_WAIT if wait else SHORT_WAIT)
        if found is None and not (wait and self._room_for(size)):
            found = self._more(size)
        if found is None:
            # Who was killed while it read holds its message for ever, but for Zenoh's watch over it. One that is merely
            # stopped finds afterwards that what it reads is another message: see `is_torn`.
            for provider in self._providers:
                provider.garbage_collect_unsafe()
            found = self._find(size)
        if found is None:
            return self._tell(self.problem or "all of it is in use: readers are too slow for it")
        self.carried += 1
        self._patient, self.problem = True, ""
        return found

    def _find(self, size: int) -> Any:
        for provider in self._providers:
            provider.garbage_collect()
            try:
                return provider.alloc(size)
            except zenoh.ZError:
                continue  # all in use, or in too small pieces
        return None

    def _room_for(self, size: int) -> bool:
        return bool(self._providers) and size * (_MESSAGES - 1) <= self._taken

    def _await(self, size: int, longest: float) -> Any:
        end = time.monotonic() + (longest if self._patient else 0.0)
        while time.monotonic() < end:
            time.sleep(_PAUSE)
            if (found := self._find(size)) is not None:
                return found
        self._patient = False
        return None

    def _more(self, size: int) -> Any:
        with self._lock:
            if (found := self._find(size)) is not None:  # of what another thread has just taken
                return found
            amount = max(FIRST, self._taken, -(-size * _MESSAGES // 2**20) * 2**20)
            if self._taken + amount > self._most:
                amount = self._most - self._taken
            if amount < size:
                self.problem = "" if self._taken else f"a message of {size / 1e6:.0f} MB is too large for it"
                return None
            if (free := free_bytes()) < amount + _SPARE:
                self.problem = f"{FOLDER} has {free / 2**20:.0f} MB free"
                return None
            return self._find(size) if self._take(amount) else None

    def _take(self, amount: int) -> bool:
        try:
            from zenoh.shm import ShmProvider  # nodes carry it only if they need it

            provider = ShmProvider.default_backend(amount)
            provider.alloc(1)  # Zenoh makes its book-keeping now, or panics, which is no Exception
        except (KeyboardInterrupt, SystemExit):
            raise
        except BaseException as error:
            self.problem = f"Zenoh gets none: {error}"
            self._hindered = "" if self._taken else self.problem  # not tried again: each try may leave a file behind
            self._most = self._taken
            return False
        self._providers.append(provider)
        self._taken += amount
        return True

    def _tell(self, problem: str) -> None:
        self.problem = problem
        if not self._told:
            self._told = True
            _logger.warning("large messages go through sockets, which is slower: %s", problem)


def fill(buffer: Any, head: bytes, data: memoryview) -> None:
    """Write a message into its memory: its beginning, and its bytes, which are copied once.

    Args:
        buffer: a `zenoh.shm.ZShmMut` of just their size. It takes `bytes` and `bytearray` alone.
        head: what comes first.
        data: what comes then, one byte an element.
    """
    start = len(head)
    buffer[:start] = head
    owner = data.obj
    if isinstance(owner, (bytes, bytearray)) and len(owner) == len(data):
        buffer[start:] = owner
        return
    piece = bytearray(_PIECE)
    view = memoryview(piece)
    whole = len(data) // _PIECE * _PIECE
    for at in range(0, whole, _PIECE):
        view[:] = data[at : at + _PIECE]
        buffer[start + at : start + at + _PIECE] = piece
    if whole < len(data):
        buffer[start + whole :] = bytes(data[whole:])


def is_torn(payload: zenoh.ZBytes) -> bool:
    """Whether the memory of a payload has been given to another message, so that what was read of it is none.

    Asked after it was read: while it is not, nobody has written there.
    """
    shared: Any = payload.as_shm()
    return shared is not None and not shared.is_valid()
