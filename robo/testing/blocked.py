"""Whether a thread is blocked: it waits for something else than the processor."""

import threading
import time
from collections import deque
from contextlib import suppress

_LOOKS = 5
"""So many looks have to find it so."""

_LEAST_SHARE = 0.2
"""Who is busy, or wants to be, for a smaller share of the time is blocked."""

_UNKNOWN = 0.5
"""How long a thread gets where the system does not tell what it does, s."""


class Watch:
    """Looks at one thread now and then."""

    def __init__(self, thread: threading.Thread) -> None:
        self._thread = thread
        self._seen: deque[tuple[int, int]] = deque(maxlen=_LOOKS)
        """When one looked, and for how long the thread had been busy until then, ns."""
        self._begun = 0.0

    def begin(self) -> None:
        """It has just begun to run."""
        self._seen.clear()
        self._begun = time.monotonic()

    def is_blocked(self) -> bool:
        """Look again."""
        busy = self._busy()
        if busy is None:
            return time.monotonic() - self._begun > _UNKNOWN
        self._seen.append((time.monotonic_ns(), busy))
        (begin, before), (end, after) = self._seen[0], self._seen[-1]
        return len(self._seen) == _LOOKS and after - before < _LEAST_SHARE * (end - begin)

    def _busy(self) -> int | None:
        """How long it has run, or waited for a processor, ns; None where the system does not say."""
        with suppress(OSError, ValueError), open(f"/proc/self/task/{self._thread.native_id}/schedstat") as file:
            running, waiting, _ = file.read().split()
            return int(running) + int(waiting)
        return None
