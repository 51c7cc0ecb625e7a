"""A supervisor ends when it is told to and when it fails, whatever is wrong with it, and leaves nothing behind."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from tests.support import eventually

pytestmark = pytest.mark.timeout(120)

FAILS = """\
from robo.supervisor import supervisor
def fails(*words): raise OSError("no more room")
supervisor.Control = fails
"""
HANGS = """\
import time
from robo.supervisor import needs, stopping, supervisor
async def hangs(self): time.sleep(600)
supervisor.Supervisor._look_after = hangs
stopping.LAST_RESORT = needs.STOP_LIMIT = 0.5
"""
SHORT = """\
from robo.supervisor import stopping
stopping.LAST_RESORT = 0.5
"""


@pytest.fixture
def mark(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A variable by which all that a test has started is found, and ended."""
    monkeypatch.setenv("ROBO_TEST_MARK", str(tmp_path))
    yield str(tmp_path)
    for process in marked(str(tmp_path)):
        process.kill()


def marked(mark: str) -> list[psutil.Process]:
    found = []
    for process in psutil.process_iter():
        try:
            alive = process.pid != os.getpid() and process.status() != psutil.STATUS_ZOMBIE
            if alive and process.environ().get("ROBO_TEST_MARK") == mark:
                found.append(process)
        except (psutil.Error, OSError):
            continue
    return found


def start(code: str, folder: Path, *words: str) -> "subprocess.Popen[str]":
    """`robo up` with something wrong: Python runs a module of this name before all else."""
    (folder / "sitecustomize.py").write_text(code)
    return subprocess.Popen(
        [sys.executable, "-m", "robo", "up", *words],
        env={**os.environ, "PYTHONPATH": str(folder)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


@pytest.mark.parametrize("words", [(), ("-d", "--wait")])
def test_a_supervisor_that_fails_ends_and_says_why(
    words: tuple[str, ...], endpoint: str, tmp_path: Path, mark: str
) -> None:
    up = start(FAILS, tmp_path, "--robot-name", "r1", "--listen", endpoint, *words)
    output, _ = up.communicate(timeout=60)
    assert up.returncode == 1
    assert "the supervisor has failed: OSError: no more room" in output
    eventually(lambda: marked(mark) == [], "all of it is gone")


def test_a_supervisor_that_hangs_ends_when_it_is_told_to(endpoint: str, tmp_path: Path, mark: str) -> None:
    up = start(HANGS, tmp_path, "--robot-name", "r1", "--listen", endpoint)
    eventually(lambda: len(marked(mark)) >= 5, "the robot is there")
    up.send_signal(signal.SIGTERM)
    up.communicate(timeout=60)
    assert up.returncode != 0
    eventually(lambda: marked(mark) == [], "all of it is gone")


def test_a_supervisor_whose_reader_has_stopped_reading_ends_when_it_is_told_to(
    endpoint: str, tmp_path: Path, mark: str
) -> None:
    manifest = tmp_path / "m.yaml"
    flood = "while True: print('x' * 200, flush=True)"
    manifest.write_text(f'groups: {{g: {{nodes: {{flood: {{run: [python, -c, "{flood}"]}}}}}}}}')
    up = start(SHORT, tmp_path, str(manifest), "--listen", endpoint)
    eventually(lambda: _blocked(up.pid), "its output is blocked")
    up.send_signal(signal.SIGTERM)
    up.wait(60)
    assert up.stdout is not None
    up.stdout.close()
    eventually(lambda: marked(mark) == [], "all of it is gone")


def _blocked(pid: int) -> bool:
    """Whether a process waits for its reader."""
    return Path(f"/proc/{pid}/syscall").read_text().startswith("1 ")
