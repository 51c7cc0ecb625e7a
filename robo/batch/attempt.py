"""One attempt at a run: a process of its own, with a folder and a port of its own, in bounded time."""

import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from contextlib import closing, suppress
from pathlib import Path

import msgspec

from robo.batch import folders
from robo.batch.plan import Job, Outcome
from robo.environment import CONNECT_VARIABLE, LISTEN_VARIABLE, LOG_FOLDER_VARIABLE
from robo.text.readable import readable
from robo.text.unreadable import UNREADABLE
from robo.wire.tcp import HeldPort

_PROGRAMS = {
    "replay": "robo.testing.regression.job",  # by name: tests stand above
    "replay-test": "robo.testing.regression.job",
    "function": "robo.batch.call",
    "command": "robo.batch.call",
}
FOLDER = "robo-batch-"
_GRACE = 10.0
"""How long a run may take to end once it is asked to, s."""
_MOST_LOG = 200_000
"""Bytes of what a run has printed that are kept: the last ones."""
JOB, OUTCOME, LOG, ENDED = "job.msgpack", "outcome.json", "log.txt", "ended"
"""The files of a run's folder: what is asked, what came of it, what was printed; that somebody has asked it to end."""


class Attempt:
    """One attempt; another thread may end it."""

    def __init__(self, job: Job) -> None:
        self._job = job
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._folder: Path | None = None
        self._is_ended = False

    def run(self) -> Outcome:
        """Run it to its end."""
        begun = time.monotonic()
        try:
            folders.sweep(FOLDER)
            folder = folders.make(FOLDER)
        except OSError as error:
            return Outcome(passed=False, reason=f"it has no folder to run in: {error.strerror}")
        try:
            with closing(HeldPort()) as port:
                outcome = self._run_in(folder, port.number)
        except OSError as error:
            outcome = Outcome(passed=False, reason=f"it cannot be run: {error.strerror}: {error.filename or ''}")
        finally:
            shutil.rmtree(folder, ignore_errors=True)
        outcome.seconds = time.monotonic() - begun
        return outcome

    def end(self) -> None:
        """End it: `run` returns soon."""
        with self._lock:
            self._is_ended = True
            if self._process is not None and self._folder is not None:
                _ask_to_end(self._process, self._folder)

    def _run_in(self, folder: Path, port: int) -> Outcome:
        job = self._job
        (folder / JOB).write_bytes(msgspec.msgpack.encode(job))
        leash = [sys.executable, "-m", "robo.machine.leash", str(os.getpid()), sys.executable]
        with (folder / LOG).open("wb") as log, self._lock:
            if self._is_ended:
                return Outcome(passed=False, reason="it was ended before it began", died=True)
            self._folder = folder
            self._process = process = subprocess.Popen(
                [*leash, "-m", _PROGRAMS[job.work.run], str(folder)],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                cwd=job.work.folder,
                env=_environment(job, folder, port),
                start_new_session=True,  # Ctrl-C is for whoever waits, who ends it
            )
        try:
            code = process.wait(job.work.timeout)
        except subprocess.TimeoutExpired:
            reason = f"it was not done within {job.work.timeout:g} s"
            return Outcome(passed=False, reason=reason, log=_log(folder))
        finally:
            _end(process, folder)
        outcome = _written(folder)
        if outcome is not None:
            outcome.log = "" if outcome.passed else _log(folder)
            return outcome
        how = f"was ended by {signal.Signals(-code).name}" if code < 0 else f"has ended with exit code {code}"
        return Outcome(passed=False, reason=f"its process {how}", died=code < 0, log=_log(folder))


def _ask_to_end(process: "subprocess.Popen[bytes]", folder: Path) -> None:
    """Tell a run's process to end, and that somebody is there who waits for it."""
    with suppress(FileNotFoundError):  # it has ended, and so has all that it had
        (folder / ENDED).touch()
    process.terminate()  # does nothing where it has ended


def _end(process: "subprocess.Popen[bytes]", folder: Path) -> None:
    """End a run's process, and all of its group: nicely, so that it ends what it has started, then for good."""
    if process.poll() is None:
        _ask_to_end(process, folder)
        with suppress(subprocess.TimeoutExpired):
            process.wait(_GRACE)
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _environment(job: Job, folder: Path, port: int) -> dict[str, str]:
    """A run finds nothing that is said to robo or Ray elsewhere, and a network, logs and files of its own."""
    endpoint = f"tcp/127.0.0.1:{port}"
    return {
        **{name: value for name, value in os.environ.items() if not name.startswith(("ROBO_", "RAY_"))},
        "PYTHONHASHSEED": str(job.seed or 0),
        LISTEN_VARIABLE: endpoint,
        CONNECT_VARIABLE: endpoint,
        LOG_FOLDER_VARIABLE: str(folder / "logs"),
        "TMPDIR": str(folder),
    }


def _written(folder: Path) -> Outcome | None:
    try:
        return msgspec.json.decode((folder / OUTCOME).read_bytes(), type=readable(Outcome))
    except (FileNotFoundError, *UNREADABLE):
        return None


def _log(folder: Path) -> str:
    with (folder / LOG).open("rb") as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(0, size - _MOST_LOG))
        return file.read().decode(errors="replace")
