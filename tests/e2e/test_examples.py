"""What stands in examples/ works as it says."""

import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from robo.testing import Launch, Robot
from tests.support import eventually, run_robo

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def lamp(module_launch: Launch) -> Iterator[Robot]:
    """The robot with the lamp."""
    robot = module_launch(EXAMPLES / "other_languages.yaml")
    robot.wait_for_line("lamp of r1 on, robot at ")
    yield robot
    assert run_robo("stop", "lamp", "--connect", robot.endpoint).returncode == 0
    robot.wait_for_line("lamp off")


@pytest.fixture
def robot(lamp: Robot) -> str:
    """Its endpoint."""
    return lamp.endpoint


def test_a_plain_client_reads_calls_and_sets(robot: str) -> None:
    command = [sys.executable, str(EXAMPLES / "plain_client.py"), "r1", robot]
    found = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True).stdout
    assert "encoding  application/msgpack;nav/Odometry" in found
    assert "reset     {'success': True" in found
    assert "set       {'successful': True" in found
    assert "expected float <= 100.0" in found
    assert "get       {'speed': 0.3}" in found


def test_a_shell_drives_with_json(robot: str, lamp: Robot) -> None:
    lamp.clear()

    def driven() -> bool:
        """One command may be left out: it has no stamp, and where the mux was held up just then it may be old."""
        said = subprocess.run(
            ["sh", str(EXAMPLES / "drive.sh"), "r1", "-0.25"],
            env={"PATH": "/usr/bin:/bin", "PYTHON": sys.executable, "ROBO_CONNECT": robot},
            capture_output=True, text=True, timeout=60, check=True,
        )  # fmt: skip
        assert said.stdout == 'r1/cmd_vel_key: {"linear": {"x": -0.25}}\n'
        return any(odometry.twist.twist.linear.x < 0.0 for odometry in lamp.messages("odom"))

    eventually(driven, "it drives backwards, which its course never asks for")
    lamp.wait_for("odom", lambda odometry: odometry.twist.twist.linear.x > 0.1, new=True)


@pytest.mark.timeout(600)
def test_the_rust_client_builds(tmp_path: Path) -> None:
    if shutil.which("cargo") is None:
        pytest.skip("there is no cargo here")
    folder = tmp_path / "rust"
    shutil.copytree(EXAMPLES / "rust", folder)
    fetched = subprocess.run(["cargo", "fetch"], cwd=folder, capture_output=True, text=True, timeout=120, check=False)
    if fetched.returncode:
        pytest.skip(f"cargo's registry cannot be reached: {fetched.stderr.strip().splitlines()[-1]}")
    built = subprocess.run(
        ["cargo", "build", "--offline"], cwd=folder, capture_output=True, text=True, timeout=500, check=False
    )
    assert built.returncode == 0, built.stderr
