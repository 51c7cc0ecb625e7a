"""The Docker engine of tests, and robo's image of this checkout."""

import os
import shutil
import subprocess
import tempfile
from fcntl import LOCK_EX, flock
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DOCKER_HOST = ROOT.parent / "shared" / "tools" / "docker-host"
"""What sets an engine up where there is none; not part of this repository."""


def docker(*words: str, check: bool = True, **environment: str) -> str:
    """Run `docker`, and return what it prints."""
    result = subprocess.run(
        ["docker", *words], cwd=ROOT, env={**os.environ, **environment}, capture_output=True, text=True, check=False,
        timeout=300,
    )  # fmt: skip
    assert not check or result.returncode == 0, f"docker {' '.join(words)}\n{result.stdout}{result.stderr}"
    return result.stdout


def _lasting() -> dict[str, str]:
    """The environment without what tests have set in it: an engine outlives them, and keeps files where that says."""
    return {name: value for name, value in os.environ.items() if not name.startswith("XDG_")}


def built_image() -> str:
    """The name of the image, which is built where it is not; the test is skipped where there is no engine."""
    with open(Path(tempfile.gettempdir()) / "robo-test-image.lock", "w") as lock:
        flock(lock, LOCK_EX)  # once, also where several workers want it
        if DOCKER_HOST.exists() and os.geteuid() == 0:
            subprocess.run([DOCKER_HOST], check=True, capture_output=True, timeout=400, env=_lasting())
        elif shutil.which("docker") is None or subprocess.run(["docker", "info"], capture_output=True).returncode:
            pytest.skip("there is no Docker engine here")
        docker("build", "--network=host", "--quiet", "--tag", "robo:test", ".")
    return "robo:test"
