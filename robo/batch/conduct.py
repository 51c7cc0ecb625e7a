"""From jobs to results: what is missing is run, what dies is begun anew so many times, each result is kept at once."""

from collections import Counter, deque
from collections.abc import Collection, Sequence
from typing import Protocol

from robo.batch.engine import Engine
from robo.batch.plan import Job, Outcome, Result


class Shelf(Protocol):
    """Where results are kept."""

    def put(self, job: Job, outcome: Outcome, attempts: int) -> Result:
        """Keep a result."""


class Listener(Protocol):
    """Who is told how it goes."""

    def ended(self, result: Result) -> None:
        """A run has a result, which is kept."""

    def again(self, job: Job, reason: str) -> None:
        """A run is begun anew."""


def missing(jobs: Sequence[Job], there: Collection[str]) -> list[Job]:
    """The jobs that have no result."""
    return [job for job in jobs if job.key not in there]


def conduct(jobs: Sequence[Job], engine: Engine, shelf: Shelf, attempts: int, listener: Listener) -> dict[str, Result]:
    """Run jobs, and keep what comes of each as it comes.

    Args:
        jobs: what is run.
        engine: runs them.
        shelf: keeps results.
        attempts: how often a run begins whose process dies; then it has failed.
        listener: is told.

    Returns:
        The results by key.
    """
    queue = deque(jobs)
    begun: Counter[str] = Counter()
    found: dict[str, Result] = {}
    for job, outcome in engine.run(queue):
        begun[job.key] += 1
        if outcome.died and begun[job.key] < attempts:
            queue.append(job)
            listener.again(job, outcome.reason)
            continue
        if outcome.died:
            outcome.reason = f"{outcome.reason}, {_times(begun[job.key])}"
        found[job.key] = shelf.put(job, outcome, begun[job.key])
        listener.ended(found[job.key])
    return found


def _times(count: int) -> str:
    return "in its only attempt" if count == 1 else f"in each of {count} attempts"
