"""The thread that publishes for one client, in order: a network that is held up holds up nobody else."""

import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future

import zenoh

from robo.bridges.foxglove.publications import Publications
from robo.errors import RoboError
from robo.text.brief import brief

MOST_WAITING, MOST_BYTES = 100, 32_000_000
"""What may wait for the network; a message is taken where nothing waits, however large it is."""
_MOST_OF_ALL = 1_000
"""Beyond what may wait, words that a topic is given up."""
_PERIOD = 0.05
"""How often it is looked whether a robot is to be told to stand, s."""


class Publishing:
    """Publishes for one client; the thread begins with the first word."""

    def __init__(self, publications: Publications, refused: Callable[[str], None]) -> None:
        """
        Args:
            publications: what it publishes on, which nobody else uses.
            refused: is told by the thread why something was not published.
        """
        self._publications, self._refused = publications, refused
        self._changed = threading.Condition()
        self._waiting: deque[tuple[Callable[[], None], int]] = deque()
        self._bytes = 0
        self._over = False
        self._done: Future[None] | None = None

    def do(self, work: Callable[[], None], size: int = 0, *, always: bool = False) -> bool:
        """Have something done, without waiting for it.

        Args:
            work: what.
            size: bytes that it keeps until then.
            always: where much waits, too.

        Returns:
            Whether it will be.
        """
        with self._changed:
            most = MOST_WAITING + (_MOST_OF_ALL if always else 0)
            if self._over or len(self._waiting) >= most or (self._waiting and self._bytes + size > MOST_BYTES):
                return False
            self._waiting.append((work, size))
            self._bytes += size
            if self._done is None:
                self._done = Future()
                # A daemon: a network that takes nothing does not keep the process from ending.
                threading.Thread(
                    target=self._run, args=(self._done,), name="robo-foxglove-publish", daemon=True
                ).start()
            self._changed.notify()
        return True

    def close(self) -> "Future[None] | None":
        """The client is gone: what waits is not published, and what it drove stands.

        Returns:
            What is done once that is; None for nothing.
        """
        with self._changed:
            self._over = True
            self._waiting.clear()
            self._changed.notify()
            return self._done

    def _run(self, done: "Future[None]") -> None:
        try:
            while not self._over:
                self._once()
        finally:
            self._over = True  # so that whoever asks for more is told
            try:
                self._publications.close()
            finally:
                done.set_result(None)

    def _once(self) -> None:
        with self._changed:
            wait = _PERIOD if self._publications.drives else None
            self._changed.wait_for(lambda: self._over or bool(self._waiting), wait)
            if self._over:
                return
            work, size = self._waiting.popleft() if self._waiting else (None, 0)
            self._bytes -= size
        try:
            if work is not None:
                work()
            self._publications.stand_where_nothing_is_said()
        except (RoboError, zenoh.ZError) as error:
            self._refused(brief(str(error)))
        except BaseException as error:
            # Nobody has thought of it, or Zenoh panics, which is no Exception: the viewer hears of it, and goes on.
            self._refused(brief(f"the bridge has failed: {type(error).__name__}: {error}"))
