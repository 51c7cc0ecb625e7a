"""A user's wheel, installed and removed as anybody does, in an environment of its own and used from another folder."""

import os
import subprocess
import sys
import sysconfig
import venv
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from tests import user_package
from tests.support import PATIENCE, Running, plain_environment

pytestmark = pytest.mark.timeout(180)


class Environment:
    """A Python environment with robo in it, as it is here, and whatever is installed into it."""

    def __init__(self, folder: Path) -> None:
        venv.create(folder / "venv", symlinks=True)
        self.python = str(folder / "venv" / "bin" / "python")
        site = sysconfig.get_path("purelib", vars={"base": str(folder / "venv")})
        # Nothing is fetched from anywhere; this one has what robo needs, and robo.
        Path(site, "here.pth").write_text(f"import site; site.addsitedir({sysconfig.get_path('purelib')!r})\n")
        self.elsewhere = folder / "elsewhere"
        self.elsewhere.mkdir()

    def pip(self, *words: str) -> None:
        """Have this environment's packages changed by the pip of the environment that runs the tests."""
        command = [sys.executable, "-m", "pip", "--python", self.python, *words]
        subprocess.run(command, check=True, capture_output=True, env={**os.environ, "PIP_NO_INDEX": "1"})

    def robo(self, *words: str) -> str:
        """What a command prints, from a folder where nothing is."""
        command = [self.python, "-m", "robo", *words]
        result = subprocess.run(
            command, cwd=self.elsewhere, env=plain_environment(), capture_output=True, text=True, timeout=PATIENCE,
        )  # fmt: skip
        assert (result.returncode, result.stderr) == (0, ""), result
        return result.stdout

    @contextmanager
    def running(self, *words: str) -> Iterator[Running]:
        """A command that runs beside the test, which it does not survive."""
        command = Running([self.python, "-m", "robo", *words], cwd=str(self.elsewhere), env=plain_environment())
        with closing(command):
            yield command


@pytest.fixture
def environment(tmp_path: Path) -> Environment:
    return Environment(tmp_path)


def test_a_wheel_is_all_that_a_robot_needs(environment: Environment, tmp_path: Path, endpoint: str) -> None:
    before = environment.robo("pkg", "list")
    wheel = user_package.wheel(user_package.project(tmp_path / "project"), tmp_path)
    environment.pip("install", "--no-deps", "--no-index", str(wheel))
    listed = environment.robo("pkg", "list").splitlines()
    assert [line for line in listed if line.startswith("my_robot ")]
    assert environment.robo("pkg", "executables", "my_robot") == "my_robot gripper\n"
    assert "std" not in environment.robo("interface", "show", "my_robot/Grip")
    assert "my_robot:robot.yaml: fine, 1 note" in environment.robo("check", "my_robot:robot.yaml", "--robot-name", "r1")
    with environment.running("up", "my_robot:robot.yaml", "--robot-name", "r1", "--listen", endpoint) as robot:
        robot.wait_for("is ready")
        assert "data: half open" in environment.robo("topic", "echo", "r1/grip", "--once", "--connect", endpoint)
        robot.interrupt()
        assert robot.wait() == 130, robot.output
    with environment.running("run", "my_robot", "gripper", "--name", "claw", "--listen", endpoint) as node:
        node.wait_for("runs as /claw")
        node.interrupt()
        assert node.wait() in (0, 130), node.output
    environment.pip("uninstall", "--yes", "my-robot")
    assert environment.robo("pkg", "list") == before, "shorter, and nothing else"


def test_what_is_meant_by_two_words_is_told(environment: Environment, endpoint: str) -> None:
    for words, told in {
        ("absent", "gripper"): "error: there is no package 'absent'; is it installed here?",
        ("robo_service", "safety_monitor"): "error: there is no package 'robo_service'; did you mean robo_services?",
        ("robo_services", "safety_monitr"): "did you mean robo_services.safety_monitor?",
    }.items():
        with environment.running("run", *words, "--listen", endpoint) as node:
            assert node.wait() == 1
            assert told in node.output
