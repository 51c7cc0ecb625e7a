"""A package that `robo create` makes runs and passes its tests, with robo installed from its wheel."""

import shlex
import shutil
import sys
from pathlib import Path

import pytest

from tests.packages import environment, shared_wheel
from tests.pages import blocks
from tests.support import Desk, Running

pytestmark = pytest.mark.timeout(420)


class Maker:
    """Somebody with an installed robo, in an empty folder."""

    def __init__(self, desk: Desk, programs: Path) -> None:
        self._desk = desk
        self._programs = programs
        self.project = desk.folder / "my_robot"

    def type(self, line: str, *, fails: bool = False) -> str:
        """Type a line in the project's folder, or above it while it is not there; what is printed."""
        code, output = self._desk.run(self._line(line), ends=True, timeout=200)
        assert (code != 0) == fails, output
        assert "Traceback" not in output
        return output

    def start(self, line: str) -> Running:
        """Type a line that goes on."""
        return self._desk.start(self._line(line))

    def readme(self) -> list[str]:
        """The first two commands of the package's README."""
        lines = [
            line
            for block in blocks(self.project / "README.md")
            if block.language == "sh"
            for line, _ in block.commands()
        ]
        return lines[:2]

    def _line(self, line: str) -> str:
        where = f"cd {shlex.quote(str(self.project))} && " if self.project.exists() else ""
        return f"export PATH={shlex.quote(str(self._programs))}:$PATH; {where}{line}"


@pytest.fixture(scope="session")
def programs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The programs of an environment with robo."""
    return environment(tmp_path_factory.mktemp("installed") / "venv", shared_wheel(tmp_path_factory))


@pytest.fixture
def maker(desk: Desk, programs: Path) -> Maker:
    """Somebody with an installed robo."""
    return Maker(desk, programs)


def runs_and_passes(maker: Maker, topic: str) -> None:
    """What the README's first two commands promise; and the tools find nothing."""
    run, test = maker.readme()
    robot = maker.start(run)
    robot.wait_for(" at tcp/")
    assert "data" in maker.type(f"robo topic echo {topic} --once --duration 30")
    robot.interrupt()
    assert robot.wait() == 130, robot.output
    assert "FATAL" not in robot.output
    assert " passed" in maker.type(test)
    maker.type(f"{sys.executable} -m ruff check --no-cache && {sys.executable} -m ruff format --check --no-cache")
    maker.type("python -m mypy --strict --cache-dir ../mypy")


def test_a_new_package_runs_and_passes_its_tests(maker: Maker) -> None:
    maker.type("robo create my_robot")
    runs_and_passes(maker, "r1/chatter")
    maker.type("python -m pip install -q --no-index --no-deps --target ../again wheels/robo_zenoh-*.whl")
    assert (maker.project.parent / "again" / "robo" / "share" / "launch" / "robot.yaml").is_file()
    assert "is the package my_robot" in maker.type("robo create other", fails=True)

    git = "git -c user.name=Me -c user.email=me@example.org -c init.defaultBranch=main"
    maker.type(f"{git} init --quiet && {git} add --all && {git} commit --quiet --message all")
    wish = "robo create --node gripper --publishes grip:my_robot/Grip --subscribes chatter:std/String --message Grip"
    listed = maker.type(f"{wish} --dry-run")
    assert maker.type("git status --porcelain") == ""
    assert len(maker.type(f"cd launch && {wish}").splitlines()) == len(listed.splitlines())
    changes = maker.type("git --no-pager diff --numstat").splitlines()
    assert [line.split()[1:] for line in changes] == [
        ["0", "config/robot.yaml"], ["0", "launch/robot.yaml"], ["0", "my_robot/messages.py"]
    ]  # fmt: skip
    runs_and_passes(maker, "r1/grip")
    assert "gripper is there already" in maker.type("robo create --node gripper", fails=True)

    offline = "--quiet --no-index --no-deps --no-build-isolation"
    maker.type(f"python -m pip install {offline} .")
    try:
        assert "my_robot:robot.yaml: fine" in maker.type("cd / && robo check my_robot:robot.yaml")
    finally:
        maker.type("python -m pip uninstall --quiet --yes my_robot")


def test_who_calls_it_bare_is_asked(maker: Maker) -> None:
    if shutil.which("script") is None:
        pytest.skip("there is no program script here, which makes terminals")
    assert "only on a terminal" in maker.type("robo create < /dev/null", fails=True)
    answers = r"json\nmy_robot\nMy \"own\" robot\ngripper\ngrip:std/Bool\nMIT\n"
    # A terminal of its own that types the answers: a mistake among them is asked for again.
    said = maker.type(f"printf '{answers}' | script --quiet --return --command 'robo create' /dev/null")
    assert "Python has a module of this name" in said
    assert 'description = "My \\"own\\" robot"' in (maker.project / "pyproject.toml").read_text()
    assert "grip = Publisher(Bool" in (maker.project / "my_robot" / "gripper.py").read_text()


def test_a_dry_run_lists_the_files_and_writes_none(maker: Maker) -> None:
    listed = maker.type("robo create my_robot --dry-run")
    assert not maker.project.exists()
    made = maker.type("robo create my_robot")
    assert set(listed.splitlines()) <= set(made.splitlines())
    assert {line for line in listed.splitlines() if not (maker.project.parent / line).is_file()} == set()
