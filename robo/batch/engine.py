"""What runs jobs: this process with some threads, or Ray."""

from collections import deque
from collections.abc import Iterator
from typing import NamedTuple, Protocol

from robo.batch.plan import Job, Outcome


class Ended(NamedTuple):
    """An attempt that is over."""

    job: Job
    outcome: Outcome


class Engine(Protocol):
    """Runs jobs, some at a time."""

    def run(self, queue: deque[Job]) -> Iterator[Ended]:
        """Take jobs from the queue and yield how each ended, until it is empty; more may be added meanwhile."""

    def close(self) -> None:
        """End what still runs; nothing of it is left when this returns."""
