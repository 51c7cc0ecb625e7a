"""Linters, formatters and type checkers accept what `robo create` makes, whatever it was asked for."""

import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, given, reject, settings
from hypothesis import strategies as st

from robo.create.addition import added
from robo.create.asked import Asked, contents
from robo.create.files import write
from robo.create.project import find_project
from robo.create.render import PackagePlan, package_files
from robo.errors import UsageError

MESSAGES = ("Grip", "Imu", "Node", "GPS", "B2b")
TYPES = (
    "std/String", "std/Bool", "sensor/LaserScan", "sensor/Imu", "system/Clock", "nav/Path", "geometry/Twist",
    "geometry/PoseWithCovariance", *(f"my_robot/{name}" for name in MESSAGES),
)  # fmt: skip
SERVICES = ("std/Trigger", "std/Empty", "std/SetBool")

snake = st.from_regex(r"[a-z][a-z0-9]{0,5}(_[a-z0-9]{1,9}){0,2}", fullmatch=True)
topic = st.from_regex(r"(/|~/)?[A-Za-z_][A-Za-z0-9_]{0,20}(/[A-Za-z_][A-Za-z0-9_]{0,20}){0,2}", fullmatch=True)
tricky = st.sampled_from(
    ["start", "timer", "class", "status", "/clock", "~/state", "x/state", "Publisher", "count", "print", "x" * 60]
)


@st.composite
def asked(draw: st.DrawFn) -> Asked:
    """What a user may ask for."""
    nodes = draw(st.lists(st.one_of(snake, st.sampled_from(["imu", "gps", "timer"])), min_size=1, max_size=2))

    def ends(types: tuple[str, ...]) -> tuple[str, ...]:
        one = st.tuples(st.sampled_from(nodes), st.one_of(topic, tricky), st.sampled_from(types)).map(":".join)
        return tuple(draw(st.lists(one, max_size=3)))

    return Asked(
        nodes=tuple(nodes), publishes=ends(TYPES), subscribes=ends(TYPES), services=ends(SERVICES), messages=MESSAGES
    )


def run(tool: str, *words: str, folder: Path) -> None:
    """Run a tool in a package; it has nothing to say."""
    if find_spec(tool) is None:
        pytest.skip(f"there is no {tool} here; the extra test has it")
    done = subprocess.run([sys.executable, "-m", tool, *words], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def make(folder: Path, name: str, wish: Asked) -> None:
    """Write a package."""
    found = contents(wish, name)
    write(folder, package_files(PackagePlan(name, "A robot", None, found.nodes, found.messages)))


# Without shrinking: each try runs two programs.
@settings(
    max_examples=25,
    derandomize=True,
    phases=[Phase.generate],
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
)
@given(asked())
def test_the_linter_and_the_formatter_accept_any_package(wish: Asked) -> None:
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        try:
            make(folder, "my_robot", wish)
        except UsageError:
            reject()
        run("ruff", "check", "--no-cache", folder=folder)
        run("ruff", "format", "--check", "--no-cache", folder=folder)


EVERYTHING = Asked(
    nodes=("talker", "timer", "listener", "server", "long_name_of_a_node_that_does_many_jobs"),
    publishes=(
        "talker:chatter:std/String", "talker:flag:std/Bool", "talker:front/scan:sensor/LaserScan",
        "timer:status:system/Clock", "timer:timer:my_robot/Node", "timer:gps:my_robot/GPS",
        f"long_name_of_a_node_that_does_many_jobs:{'x' * 60}:geometry/PoseWithCovariance",
    ),
    subscribes=(
        "listener:chatter:std/String", "listener:start:sensor/Imu", "listener:own/start:my_robot/Imu",
        f"long_name_of_a_node_that_does_many_jobs:{'y' * 60}:geometry/PoseWithCovariance",
    ),
    services=(
        "server:close:std/Trigger", "server:reset:std/Empty", "timer:on:std/SetBool",
        f"long_name_of_a_node_that_does_many_jobs:{'z' * 60}:std/SetBool",
    ),
    messages=MESSAGES,
)  # fmt: skip
"""Each kind of end, and each kind of name that code has to give way to."""


@pytest.mark.parametrize("wish", [Asked(nodes=("talker",)), EVERYTHING], ids=["first", "everything"])
def test_the_tools_accept_a_package(wish: Asked, tmp_path: Path) -> None:
    make(tmp_path, "my_robot", wish)
    run("ruff", "check", "--no-cache", folder=tmp_path)
    run("ruff", "format", "--check", "--no-cache", folder=tmp_path)
    run("mypy", "--strict", "--cache-dir", str(tmp_path / ".mypy_cache"), folder=tmp_path)
    run("robo", "check", "launch/robot.yaml", folder=tmp_path)


def test_the_tools_accept_a_package_that_has_grown(tmp_path: Path) -> None:
    make(tmp_path, "my_robot", Asked(nodes=("first",), messages=("One",)))
    project = find_project(tmp_path)
    assert project is not None
    for wish in (Asked(messages=("Two",)), EVERYTHING):
        files = project.files()
        addition = added("my_robot", project.sources, contents(wish, "my_robot"), files, ())
        assert addition.problems == ()
        changes = {tmp_path / path: (files[path], text) for path, text in addition.changed.items()}
        write(tmp_path, addition.new, changes)
    run("ruff", "check", "--no-cache", folder=tmp_path)
    run("ruff", "format", "--check", "--no-cache", folder=tmp_path)
    run("mypy", "--strict", "--cache-dir", str(tmp_path / ".mypy_cache"), folder=tmp_path)
    run("robo", "check", "launch/robot.yaml", folder=tmp_path)
