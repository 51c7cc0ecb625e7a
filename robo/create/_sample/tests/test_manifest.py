"""The manifest names nodes that are there, and what they say to each other fits."""

import subprocess
import sys
from pathlib import Path


def test_the_manifest_has_no_mistake() -> None:
    command = [sys.executable, "-m", "robo", "check", "launch/robot.yaml"]
    done = subprocess.run(command, cwd=Path(__file__).parents[1], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
