"""robo from its wheel alone, on each Python that it is said to work on and that is here.

Compiled dependencies are those of one Python. For another one than that of the tests they have to be fetched; only CI
lets pip do so, by `FETCH_FOR_INTERPRETERS=1`. Elsewhere the test of that Python is skipped.
"""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from tests import packages
from tests.support import PATIENCE, Running, plain_environment

pytestmark = pytest.mark.timeout(600)

VERSIONS = ("3.11", "3.12", "3.13", "3.14")
OWN = f"{sys.version_info.major}.{sys.version_info.minor}"

NODE = '''
"""A node with all that is read from annotations, as Python 3.14 keeps them too."""

from __future__ import annotations

from typing import Annotated, Literal

import robo
from msgspec import Meta, field
from robo import Client, MessageInfo, Node, Publisher, Unit, service, subscribe, timer
from robo_messages import Header, Message, Trigger, message


@message("my_robot/Grip")
class Grip(Message):
    """How wide a gripper is."""

    header: Header = field(default_factory=Header)
    width: Annotated[float, Meta(ge=0)] = 0.0
    """m."""
    fingers: list[float] = field(default_factory=list)


class Gripper(Node):
    """Tell how wide the gripper is."""

    class Parameters(robo.Parameters):
        rate: Annotated[float, Meta(gt=0, description="how often"), Unit("Hz")] = 20.0
        side: Literal["left", "right"] = "left"

    parameters: Parameters
    grip = Publisher(Grip, "grip")
    close_it = Client(Trigger.Request, Trigger.Response, "close_it")
    width = 0.1

    @subscribe("grip")
    def on_grip(self, grip: Grip, info: MessageInfo) -> None:
        assert info.age is None or info.age >= 0

    @service("close_it")
    def on_close(self, request: Trigger.Request) -> Trigger.Response:
        self.width = 0.0
        return Trigger.Response(success=True, message=self.parameters.side)

    @timer(rate="rate")
    def tell(self) -> None:
        self.grip.publish(Grip(width=self.width, fingers=[0.1, 0.2]))
'''
LATE = NODE.replace("from __future__ import annotations\n", "").replace("my_robot/Grip", "my_robot/LateGrip")
MANIFEST = """
description: two grippers
groups:
  arm:
    namespace: ${robot_name}
    nodes:
      gripper: {service: gripper}
      late: {service: late, remap: {grip: late_grip, close_it: close_late}}
"""


def interpreter(version: str) -> str:
    """A Python of this version: that of the tests, one on the path, one of pyenv's."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
    there = [shutil.which(f"python{version}"), *sorted(pyenv.glob(f"versions/{version}.*/bin/python{version}"))]
    for python in [sys.executable] if version == OWN else there:
        if python is not None:
            asked = subprocess.run([python, "-c", "import ensurepip, ssl"], capture_output=True, check=False)
            if asked.returncode == 0:
                return str(python)
    pytest.skip(f"there is no Python {version} here")


class Installed:
    """An environment with robo from its wheel, and a folder with a user's files."""

    def __init__(self, programs: Path, folder: Path) -> None:
        self.programs = programs
        self.folder = folder
        folder.mkdir()
        for name, text in {"gripper.py": NODE, "late.py": LATE, "mine.yaml": MANIFEST}.items():
            (folder / name).write_text(text)
        # What is deprecated in a newer Python ends the command that does it.
        warnings = "error::DeprecationWarning,error::SyntaxWarning,error::FutureWarning"
        self._environment = plain_environment() | {"PYTHONWARNINGS": warnings}

    def command(self, *words: str, module: bool = False) -> list[str]:
        """`robo`, or `python -m robo`."""
        return [*([str(self.programs / "python"), "-m", "robo"] if module else [str(self.programs / "robo")]), *words]

    def say(self, *words: str, module: bool = False) -> str:
        """What a command prints, which has nothing to complain of."""
        result = subprocess.run(
            self.command(*words, module=module),
            cwd=self.folder, env=self._environment, capture_output=True, text=True, timeout=PATIENCE, check=False,
        )  # fmt: skip
        assert (result.returncode, result.stderr) == (0, ""), f"{words}: {result}"
        return result.stdout

    @contextmanager
    def running(self, *words: str) -> Iterator[Running]:
        """A command that runs beside the test, which it does not survive."""
        with closing(Running(self.command(*words), cwd=str(self.folder), env=self._environment)) as command:
            yield command


@pytest.fixture(params=VERSIONS)
def installed(request: pytest.FixtureRequest, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Installed:
    """An environment of one version of Python."""
    version: str = request.param
    python = interpreter(version)
    if version == OWN:
        built = packages.shared_wheel(tmp_path_factory)
        return Installed(packages.environment(tmp_path / "python", built), tmp_path / "mine")
    if os.environ.get("FETCH_FOR_INTERPRETERS") != "1":
        pytest.skip(f"robo's dependencies for Python {version} are fetched only where FETCH_FOR_INTERPRETERS=1")
    built = packages.shared_wheel(tmp_path_factory)
    subprocess.run([python, "-m", "venv", str(tmp_path / "python")], check=True, capture_output=True)
    programs = tmp_path / "python" / "bin"
    pip = [str(programs / "python"), "-m", "pip", "install", "--quiet", "--only-binary", ":all:", str(built)]
    fetched = subprocess.run(pip, capture_output=True, text=True, check=False)
    if fetched.returncode != 0:
        pytest.skip(f"robo's dependencies for Python {version} cannot be had: {fetched.stderr.splitlines()[-1]}")
    return Installed(programs, tmp_path / "mine")


def test_a_robot_of_ones_own_runs(installed: Installed, endpoint: str) -> None:
    at = ("--connect", endpoint)
    assert installed.say("--version") == installed.say("--version", module=True)
    assert "mine.yaml: fine" in installed.say("check", "mine.yaml", "--robot-name", "r1", module=True)
    assert "robo_services safety_monitor" in installed.say("pkg", "executables").splitlines()
    assert "list of float" in installed.say("interface", "show", "my_robot/Grip")
    for file, kind in {"gripper.py": "my_robot/Grip", "late.py": "my_robot/LateGrip"}.items():
        shown = installed.say("run", file, "--help")
        assert "how often, Hz; > 0" in shown
        assert kind in shown
    with installed.running("up", "mine.yaml", "--robot-name", "r1", "--listen", endpoint) as robot:
        robot.wait_for("r1 is ready")
        assert "width: 0.1" in installed.say("topic", "echo", "r1/grip", "--once", *at)
        assert "message: left" in installed.say("service", "call", "r1/close_late", *at)
        installed.say("topic", "echo", "r1/late_grip", "--once", "--filter", "width == 0", *at)
        installed.say("param", "set", "r1/late", "side", "right", *at)
        assert "message: right" in installed.say("service", "call", "r1/close_late", *at, module=True)
        assert "/r1/gripper" in installed.say("ps", *at)
        robot.interrupt()
        assert robot.wait() == 130, robot.output
    for word in ("Warning", "Traceback", "Exception ignored"):
        assert word not in robot.output
