"""What stands in examples/ works as it says."""

import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from robo.wire.network import Network
from robo.wire.session import close_session, open_session
from tests.conftest import free_port
from tests.support import Inbox, robo, run_robo

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def robot() -> Iterator[str]:
    """The robot with the lamp; its endpoint."""
    where = f"tcp/127.0.0.1:{free_port()}"
    with robo("up", str(EXAMPLES / "other_languages.yaml"), "--robot-name", "r1", "--listen", where) as run:
        run.wait_for("is ready")
        assert "lamp of r1 on, robot at " in run.output
        yield where
        run.interrupt()
        run.wait_for("lamp off")


def test_a_plain_client_reads_calls_and_sets(robot: str) -> None:
    command = [sys.executable, str(EXAMPLES / "plain_client.py"), "r1", robot]
    found = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True).stdout
    assert "encoding  application/msgpack;nav/Odometry" in found
    assert "reset     {'success': True" in found
    assert "set       {'successful': True" in found
    assert "expected float <= 5.0" in found
    assert "get       {'linear_velocity': 0.3}" in found


def test_a_shell_drives_with_json(robot: str) -> None:
    assert run_robo("stop", "velocity_controller", "--connect", robot).returncode == 0
    session = open_session(Network(mode="client", connect=(robot,)))
    odometry = Inbox(session, "r1/odom")
    odometry.wait_until(lambda messages: speed(messages[-1]) == 0.0, "it stands")
    odometry.forget()
    said = subprocess.run(
        ["sh", str(EXAMPLES / "drive.sh"), "r1", "0.25"],
        env={"PATH": "/usr/bin:/bin", "PYTHON": sys.executable, "ROBO_CONNECT": robot},
        capture_output=True, text=True, timeout=60, check=True,
    )  # fmt: skip
    assert said.stdout == 'r1/cmd_vel_raw: {"linear": {"x": 0.25}}\n'
    odometry.wait_until(lambda messages: any(speed(message) > 0.2 for message in messages), "it drives")
    close_session(session)
    assert run_robo("start", "velocity_controller", "--connect", robot).returncode == 0


def speed(odometry: dict[str, Any]) -> float:
    """Of a message of odometry, m/s."""
    return float(odometry["twist"]["twist"]["linear"]["x"])


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
