"""The folder of results: one file each, whole or not there; the table; logs of what has failed."""

import fcntl
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import msgspec

from robo.batch import table
from robo.batch.plan import Job, Outcome, Result
from robo.errors import UsageError
from robo.text.readable import readable
from robo.text.unreadable import UNREADABLE

RESULTS, LOGS, RECORDINGS = "results", "logs", "recordings"
CSV, JSON_LINES = "results.csv", "results.jsonl"
_LOCK = ".lock"


class Shelf:
    """The folder of one batch; whoever writes there holds its lock."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @contextmanager
    def held(self) -> Iterator[None]:
        """Make the folder, and keep others out of it.

        Raises:
            UsageError: another batch works there, or it cannot be made.
        """
        try:
            for name in (RESULTS, LOGS, RECORDINGS):
                (self.folder / name).mkdir(parents=True, exist_ok=True)
            lock = (self.folder / _LOCK).open("a+")
        except OSError as error:
            raise UsageError(f"-o {self.folder}: {error.strerror}") from None
        with lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                raise UsageError(f"-o {self.folder}: another batch works there; wait for it, or end it") from None
            self._sweep()
            yield

    def there(self, jobs: Iterable[Job]) -> dict[str, Result]:
        """The results of jobs that are there, by key; one that cannot be read is not, nor one without its recording."""
        found: dict[str, Result] = {}
        for job in jobs:
            with suppress(OSError, *UNREADABLE):
                result = msgspec.json.decode(self._file(job.key).read_bytes(), type=readable(Result))
                if result.key == job.key and not (job.output and result.passed and not Path(job.output).exists()):
                    found[job.key] = result
        return found

    def forget(self, keys: Iterable[str]) -> None:
        """Take results away: an interrupted batch goes on with those that are not there."""
        for key in keys:
            self._file(key).unlink(missing_ok=True)

    def put(self, job: Job, outcome: Outcome, attempts: int) -> Result:
        """Write a result, and what it has printed where it has failed.

        Raises:
            UsageError: it cannot be written.
        """
        log = f"{LOGS}/{job.key}.log"
        result = Result(
            key=job.key,
            recording=job.recording,
            parameters=job.parameters,
            seed=job.seed,
            passed=outcome.passed,
            reason=outcome.reason,
            metrics=outcome.metrics,
            attempts=attempts,
            seconds=round(outcome.seconds, 3),
            log="" if outcome.passed else log,
        )
        try:
            if outcome.passed:
                (self.folder / log).unlink(missing_ok=True)
            else:
                _write(self.folder / log, f"{job.label}\n{outcome.reason}\n\n{outcome.log}".encode(errors="replace"))
            _write(self._file(job.key), msgspec.json.encode(result))
        except OSError as error:
            raise UsageError(f"-o {self.folder}: {error.strerror}; what is there stays") from None
        return result

    def write_table(self, results: Iterable[Result]) -> None:
        """Write the table, as CSV and as JSON Lines.

        Raises:
            UsageError: it cannot be written.
        """
        rows = list(results)
        try:
            _write(self.folder / CSV, table.as_csv(rows).encode())
            _write(self.folder / JSON_LINES, b"".join(msgspec.json.encode(row) + b"\n" for row in rows))
        except OSError as error:
            raise UsageError(f"-o {self.folder}: {error.strerror}") from None

    def _file(self, key: str) -> Path:
        return self.folder / RESULTS / f"{key}.json"

    def _sweep(self) -> None:
        """Take away what was being written when somebody was killed."""
        for path in self.folder.rglob(".*.part"):
            path.unlink(missing_ok=True)


def _write(path: Path, data: bytes) -> None:
    """Write a file that is there whole, on the disk too, or not at all."""
    part = path.with_name(f".{path.name}.part")
    with part.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    part.replace(path)
