"""What the process of a run reads, and what it writes at its end."""

import os
import shutil
import signal
import sys
from collections.abc import Callable
from pathlib import Path

import msgspec

from robo.batch.attempt import ENDED, JOB, OUTCOME
from robo.batch.plan import Job, Outcome
from robo.process.endings import raised_by_signals
from robo.text.readable import readable


def answer(work: Callable[[Job, Path], Outcome]) -> None:
    """Do what the folder that this process is given asks for, and write there what came of it.

    SIGTERM ends it by SystemExit, so that what it has started ends as well. Where whoever waited for it has gone, its
    folder goes with it, and all of its group.
    """
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    folder = Path(sys.argv[1])
    try:
        with raised_by_signals():
            job = msgspec.msgpack.decode((folder / JOB).read_bytes(), type=readable(Job))
            outcome = work(job, folder)
    except SystemExit:
        if not (folder / ENDED).exists():
            shutil.rmtree(folder, ignore_errors=True)
            os.killpg(0, signal.SIGKILL)
        os._exit(143)  # a thread that hangs holds nobody
    part = folder / f".{OUTCOME}.part"
    part.write_bytes(msgspec.json.encode(outcome))
    part.replace(folder / OUTCOME)
