"""What goes on beside each other in a run: work for as long as it lasts, and work that comes to its own end."""

import asyncio
from collections.abc import Callable, Coroutine, Iterable
from typing import Any

Work = Coroutine[Any, Any, object]


class Tasks:
    """The tasks of one run; at its end all are cancelled."""

    def __init__(self, failed: Callable[[str, BaseException], None]) -> None:
        """`failed` is told the name of work that ought to last and has died, and of what."""
        self._failed = failed
        self._lasting: set[asyncio.Task[object]] = set()
        self._passing: set[asyncio.Task[object]] = set()

    def tend(self, work: Work, name: str) -> "asyncio.Task[object]":
        """Do something for as long as the run lasts."""
        task = asyncio.create_task(work, name=name)
        self._lasting.add(task)
        task.add_done_callback(self._on_lasting_over)
        return task

    def do(self, work: Work) -> "asyncio.Task[object]":
        """Do something beside the rest."""
        task = asyncio.create_task(work)
        self._passing.add(task)
        task.add_done_callback(self._passing.discard)
        return task

    async def all(self, works: Iterable[Work]) -> None:
        """Do all of it. Whoever waits may give up; what has begun goes on, for a stop may be half done."""
        await asyncio.gather(*(asyncio.shield(self.do(work)) for work in works))

    def cancel(self) -> None:
        """End all of it."""
        for task in (*self._lasting, *self._passing):
            task.cancel()

    def _on_lasting_over(self, task: "asyncio.Task[object]") -> None:
        self._lasting.discard(task)
        error = task.exception() if not task.cancelled() else None
        if error is not None:
            self._failed(task.get_name(), error)
