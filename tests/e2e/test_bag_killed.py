"""A recorder that is killed loses a second at most, and what is there is mended."""

import os
import random
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

from robo import bag

ROOT = Path(__file__).parents[2]
MOST_LOST = 1.0
"""s."""


def kill_after(count: int, path: Path, rate: float = 100.0) -> list[tuple[int, int]]:
    """Number and time of each message that was written when a process was killed; at the least `count`."""
    paths = [str(ROOT), str(ROOT / "messages"), str(ROOT / "services")]
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.recording_process", str(path), str(rate)],
        cwd=ROOT, env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)}, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stdout is not None
    with process, process.stdout:
        lines = [process.stdout.readline() for _ in range(count)]
        process.kill()
        lines += process.stdout.readlines()
    pairs = (line.split() for line in lines if line.endswith("\n"))
    return [(int(number), int(at)) for number, at in pairs]


def lost(path: Path, written: list[tuple[int, int]]) -> float:
    """How long before its end a recording ends, s; what is there is whole and in order."""
    whole = path.with_name("whole.mcap")
    recovered = bag.recover(path, whole)
    assert all(fault.cut for fault in recovered.faults)
    assert bag.check(whole).findings == []
    with bag.open(whole) as opened:
        found = [(message.sequence, message.arrived) for message in opened.messages()]
    count = min(len(found), len(written))
    assert found[:count] == written[:count]
    return (written[-1][1] - (found[-1][1] if found else written[0][1])) * 1e-9


def test_a_recorder_that_is_killed_loses_a_second_at_most(tmp_path: Path) -> None:
    for attempt in range(2):
        path = tmp_path / f"{attempt}" / "drive.mcap"
        count = random.randrange(50, 350)
        written = kill_after(count, path)
        pauses = [(later - sooner) * 1e-9 for (_, sooner), (_, later) in pairwise(written)]
        assert lost(path, written) <= MOST_LOST + max(pauses, default=0.0), f"killed after {count} messages"
