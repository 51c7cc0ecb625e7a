"""Jobs as tasks of Ray: on this machine, or on a cluster that is there.

Ray is imported here and nowhere else. It is started without its dashboard and without its statistics of use, on
loopback, with a folder of its own that goes away with it; nothing is sent anywhere.
"""

from __future__ import annotations

import importlib
import logging
import os
import secrets
import shutil
import signal
import socket
import sys
import tempfile
from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, redirect_stdout, suppress
from pathlib import Path
from typing import Any

import psutil

from robo.batch import folders
from robo.batch.attempt import FOLDER, Attempt
from robo.batch.engine import Ended
from robo.batch.plan import Job, Outcome
from robo.errors import RunError
from robo.machine.leash import end_with_parent
from robo.machine.orphans import wait_for_ends
from robo.packages.absent import absent

_MEMORY = 100_000_000
"""Of Ray's store of objects, bytes: a result has a few hundred."""
_AHEAD = 2
"""Tasks that wait for each that runs."""
_PATIENCE = 10.0
"""How long processes may take to end, s."""
_FOLDER = "robo-ray-"
_LONGEST = 20
"""Characters of the folder for temporary files in which Ray may have its own: it makes sockets in there, whose paths
have at most 107."""
_ADVICE = "; one that asks for a token wants RAY_AUTH_MODE=token, and RAY_AUTH_TOKEN or RAY_AUTH_TOKEN_PATH"
_QUIET = {
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_USAGE_STATS_PROMPT_ENABLED": "0",
    "RAY_DISABLE_IMPORT_WARNING": "1",
    "RAY_ENABLE_UV_RUN_RUNTIME_ENV": "0",
    "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",
}
"""Read by Ray when it is imported, and by what it starts."""


def check_ray() -> None:
    """See whether Ray is there, without importing it.

    Raises:
        RunError: it is not installed.
    """
    for lacking in absent({"ray": "robo-zenoh[ray]"}):
        raise RunError(f"a batch {lacking}; --engine local does without it, on this machine")


def attempt(job: Job) -> Outcome:
    """What a task does.

    Ray's worker ends with the process that has started it. It looks for that by itself, but takes a dead one that
    nobody reaps, as in containers without an init, for one that lives.
    """
    end_with_parent(signal.SIGKILL)
    return Attempt(job).run()


class Ray:
    """A Ray of one's own on this machine, or one that is there."""

    def __init__(self, workers: int, address: str | None = None) -> None:
        """
        Args:
            workers: how many jobs run at a time on this machine.
            address: of a cluster, which says itself how many; None for this machine.

        Raises:
            RunError: Ray is not installed, does not start, or no cluster answers.
        """
        check_ray()
        if address is not None:
            _reach(address)
        os.environ.update(_QUIET)
        if address is None:  # nobody else on this machine runs anything in it; Ray would keep a token at home
            os.environ.update({"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": secrets.token_hex(32)})
            # On Linux it takes 127.0.0.1 for the address by which others reach this machine, and listens on all. So it
            # is told what it goes by on other systems, where it has no clusters.
            os.environ["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] = "0"
        self._ray: Any = importlib.import_module("ray")  # its types are there only where it is
        self._pending: dict[Any, Job] = {}
        self._children: list[psutil.Process] = []
        self._apart = ExitStack()
        self._folder = _own_folder() if address is None else None
        with ExitStack() as undo:
            undo.callback(self.close)
            # A thread of Ray's prints what its processes complain of; what comes of it is told here.
            self._apart.enter_context(redirect_stdout(self._apart.enter_context(open(os.devnull, "w"))))
            try:
                with _apart_from_terminal():
                    if address is None:
                        self._ray.init(
                            address="local",  # whatever RAY_ADDRESS says
                            num_cpus=workers,
                            include_dashboard=False,
                            object_store_memory=_MEMORY,
                            _node_ip_address="127.0.0.1",
                            _temp_dir=str(self._folder),
                            log_to_driver=False,
                            logging_level=logging.ERROR,
                        )
                    else:
                        self._ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR)
            except Exception as error:  # it raises just that where its processes take long to start
                where = "on this machine" if address is None else f"at {address}"
                raise RunError(f"Ray does not start {where}: {error}{_ADVICE if address is not None else ''}") from None
            # Attempts are counted here, where each is told.
            self._task = self._ray.remote(num_cpus=1, max_retries=0)(attempt)
            self._most = _AHEAD * max(1, int(self._ray.cluster_resources().get("CPU", workers)))
            undo.pop_all()

    def run(self, queue: deque[Job]) -> Iterator[Ended]:
        """Take jobs from the queue and yield how each ended, until it is empty."""
        while queue or self._pending:
            while queue and len(self._pending) < self._most:
                job = queue.popleft()
                self._pending[self._task.remote(job)] = job
            done, _ = self._ray.wait(list(self._pending), num_returns=1)
            for task in done:
                job = self._pending.pop(task)
                yield Ended(job, self._outcome(task))

    def close(self) -> None:
        """End what still runs, and Ray, where it is one's own."""
        if self._folder is not None:
            with suppress(psutil.Error):
                self._children = psutil.Process().children(recursive=True)
        self._ray.shutdown()
        wait_for_ends(self._children, _PATIENCE)
        for process in self._children:
            with suppress(psutil.Error):  # as of one that has ended
                process.kill()
        wait_for_ends(self._children, _PATIENCE)
        self._apart.close()
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)
            folders.sweep(FOLDER)  # of runs whose workers were ended just now

    def _outcome(self, task: Any) -> Outcome:
        try:
            outcome: Outcome = self._ray.get(task)
        except self._ray.exceptions.RayTaskError as error:  # of robo's own, or of an older robo on the cluster
            return Outcome(passed=False, reason="its task raised", log=str(error))
        except self._ray.exceptions.RayError as error:
            reason = next(iter(str(error).splitlines()), "") or type(error).__name__
            return Outcome(passed=False, reason=f"its worker died: {reason}", died=True, log=str(error))
        return outcome


def _reach(address: str) -> None:
    """See whether anybody answers at an address: Ray itself would wait for minutes.

    Raises:
        RunError: it is no address, or nobody does.
    """
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not host or not port.isdecimal():
        raise RunError(f"--address {address}: write HOST:PORT, for example 192.168.1.20:6379")
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=_PATIENCE).close()
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or error
        raise RunError(f"no cluster of Ray's answers at {address}: {reason}") from None


def _own_folder() -> Path:
    """A folder for Ray; those of commands that were killed go."""
    base = Path(tempfile.gettempdir())
    if len(str(base)) > _LONGEST:
        base = Path("/tmp")
    folders.sweep(_FOLDER, base)
    return folders.make(_FOLDER, base)


@contextmanager
def _apart_from_terminal() -> Iterator[None]:
    """What Ray prints while it starts goes nowhere: its errors are raised. Signals stay as they were."""
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    on_term = signal.getsignal(signal.SIGTERM)  # Ray sets one of its own
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        signal.signal(signal.SIGTERM, on_term)
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
