"""Jobs on this machine without Ray: a thread waits for each process."""

from collections import deque
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait

from robo.batch.attempt import Attempt
from robo.batch.engine import Ended
from robo.batch.plan import Job, Outcome


class Local:
    """Some processes of this machine at a time."""

    def __init__(self, workers: int) -> None:
        """`workers` is how many."""
        self._workers = workers
        self._pool = ThreadPoolExecutor(workers, thread_name_prefix="robo-batch")
        self._running: dict[Future[Outcome], tuple[Job, Attempt]] = {}

    def run(self, queue: deque[Job]) -> Iterator[Ended]:
        """Take jobs from the queue and yield how each ended, until it is empty."""
        while queue or self._running:
            while queue and len(self._running) < self._workers:
                job = queue.popleft()
                attempt = Attempt(job)
                self._running[self._pool.submit(attempt.run)] = job, attempt
            for future in wait(self._running, return_when=FIRST_COMPLETED).done:
                job, _ = self._running.pop(future)
                yield Ended(job, future.result())

    def close(self) -> None:
        """End what still runs."""
        for _, attempt in self._running.values():
            attempt.end()
        self._pool.shutdown()
        self._running.clear()
