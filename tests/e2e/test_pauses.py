"""A machine that is busy holds anybody up at any moment: a robot comes up nevertheless."""

import random
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import psutil
import pytest

from tests.support import robo

HELD_UP = """\
import os, sys, time
from robo.machine.forks import Template

read = Template._read

def held_up(self):
    time.sleep(float(os.environ["PAUSE"]))  # the whole loop: what the template says waits, what Zenoh says does not
    read(self)

Template._read = held_up
from robo.cli import main
sys.argv[0] = "robo"
main()
"""


@pytest.mark.parametrize("pause", [0.05, 0.15, 0.3])
def test_a_supervisor_that_is_held_up_after_each_fork_knows_its_own_nodes(
    pause: float, endpoint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = tmp_path / "held_up.py"
    script.write_text(HELD_UP)
    monkeypatch.setenv("PAUSE", str(pause))
    result = subprocess.Popen(
        [sys.executable, str(script), "up", "--robot-name", "r1", "--listen", endpoint],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    assert result.stdout is not None
    lines = []
    for line in result.stdout:
        lines.append(line)
        if "r1 is ready" in line:
            break
    result.send_signal(signal.SIGTERM)
    rest, _ = result.communicate(timeout=60)
    assert any("r1 is ready" in line for line in lines), "".join(lines) + rest


@pytest.mark.parametrize("seed", range(3))
def test_a_robot_comes_up_whoever_of_it_is_held_up(seed: int, endpoint: str) -> None:
    chance = random.Random(seed)
    with robo("up", "--robot-name", "r1", "--listen", endpoint) as up:
        supervisor = psutil.Process(up.process.pid)
        while "r1 is ready" not in up.output and up.process.poll() is None:
            with suppress(psutil.Error):
                held = chance.choice([supervisor, *supervisor.children(recursive=True)])
                held.suspend()
                try:
                    time.sleep(chance.uniform(0.05, 0.3))
                finally:
                    held.resume()
        up.wait_for("r1 is ready")
        assert "runs already" not in up.output
