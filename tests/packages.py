"""robo as a user has it: installed from its wheel, in an environment of its own, without a network."""

import os
import subprocess
import sys
import sysconfig
from fcntl import LOCK_EX, flock
from pathlib import Path

import pytest

from tests.pages import ROOT


def wheel(folder: Path) -> Path:
    """Build robo's wheel into a folder."""
    options = ("--quiet", "--no-deps", "--no-build-isolation", "--no-index", "--wheel-dir", str(folder))
    subprocess.run([sys.executable, "-m", "pip", "wheel", *options, str(ROOT)], check=True, capture_output=True)
    (built,) = folder.glob("robo_zenoh-*.whl")
    return built


def shared_wheel(base: pytest.TempPathFactory) -> Path:
    """Robo's wheel, built once for all workers of a run of tests."""
    # Workers have folders of their own, below that of the run.
    mine = base.getbasetemp()
    folder = (mine.parent if "PYTEST_XDIST_WORKER" in os.environ else mine) / "robo_wheel"
    folder.mkdir(exist_ok=True)
    with open(folder / "lock", "w") as lock:
        flock(lock, LOCK_EX)
        return next(folder.glob("robo_zenoh-*.whl"), None) or wheel(folder)


def environment(folder: Path, built: Path) -> Path:
    """Make an environment with robo from its wheel; what robo depends on is taken from the one that runs the tests.

    Returns:
        Its folder of programs.
    """
    subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True, capture_output=True)
    # A path in a .pth is not searched for more of them: the checkout, installed to be edited, stays out.
    packages = next((folder / "lib").glob("python*/site-packages"))
    (packages / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    pip = (str(folder / "bin" / "python"), "-m", "pip", "install", "--quiet", "--no-index", "--no-deps")
    subprocess.run([*pip, "--ignore-installed", str(built)], check=True, capture_output=True)
    return folder / "bin"
