"""Every example of every `--help` works as printed: on a robot that runs, or on a desk without one."""

import re
import shutil
from collections.abc import Iterator
from contextlib import closing, suppress
from typing import Any

import pytest
from typer.main import get_command

from robo.cli.app import app
from robo.cli.launch import run
from robo.process import health
from robo.security.keystore import Keystore
from robo.security.rights import Role
from tests import bags, replays
from tests.extras import HAS_RAY
from tests.pages import ROOT
from tests.support import INTERRUPTED, Desk, Running, eventually, is_endless

pytestmark = pytest.mark.timeout(300)


def examples_of(command: Any, path: tuple[str, ...] = ()) -> dict[tuple[str, ...], list[str]]:
    """The examples below the help of each verb."""
    if hasattr(command, "list_commands"):
        found: dict[tuple[str, ...], list[str]] = {}
        for name in command.list_commands(None):
            found |= examples_of(command.get_command(None, name), (*path, name))
        return found
    text = _OF_THEIR_OWN.get(path, command.epilog or "")
    return {path: [line.strip() for line in re.split("xamples:\n", text)[-1].splitlines() if line.strip()]}


_OF_THEIR_OWN: dict[tuple[str, ...], str] = {("run",): run.USAGE, ("health",): health.EXAMPLES}
"""Help of verbs that do without the library of the command line."""
EXAMPLES = examples_of(get_command(app))
NOT_RUN = {
    ("keeper",): "it needs a container engine; tests/integration/test_keeper.py has one of its own",
    ("bridge", "ros2"): "it needs ROS's router; tests/e2e/test_ros2_bridge.py has what is one",
    ("service", "status"): "it needs systemd; tests/e2e/test_systemd.py has one of its own",
    (
        "view",
        "rerun",
    ): "it needs Rerun; tests/integration/test_rerun.py writes files where it is installed",
}
_KEYSTORES = (
    "init", "add", "list", "renew", "revoke", "allow", "deny", "explain", "check", "bundle",
)  # fmt: skip
ALONE = {("up",), ("router",), ("run",)}
"""Verbs that are tried where no robot runs."""
NO_MATTER = {
    ("check",), ("create",), ("replay-test",), ("schema",), ("test",), ("export", "compose"), ("export", "dockerfile"),
    ("export", "systemd"), ("service", "install"), ("service", "remove"),
    ("node", "show"), ("map",), ("interface", "import"),
    *(("batch", verb) for verb in ("run", "replay", "replay-test", "call")),
    *(("security", verb) for verb in _KEYSTORES),
    *(("bag", verb) for verb in ("info", "check", "cut", "filter", "merge", "diff", "recover", "convert", "plot")),
}  # fmt: skip
"""Verbs that look at no network."""

NODE = '''
from collections.abc import Generator

from robo import Node, action, service
from robo_messages import Fibonacci, SetBool


class MyNode(Node):
    """Switch the lights."""

    @service("lights")
    def lights(self, request: SetBool.Request) -> SetBool.Response:
        return SetBool.Response(message="on" if request.data else "off")

    @action("fibonacci", policy="queue")
    def fibonacci(self, goal: Fibonacci.Goal) -> Generator[Fibonacci.Feedback, None, Fibonacci.Result]:
        for number in range(goal.order):
            yield Fibonacci.Feedback([number])
        return Fibonacci.Result()
'''
MANAGED = '''
from robo import LifecycleNode


class Gripper(LifecycleNode):
    """Grip."""
'''
GRIPPER = '''
from robo_messages import Message, message


@message("my_robot/Gripper")
class Gripper(Message):
    """A gripper's state."""

    width: float = 0.0
    """m."""
'''
SCORES = """
from robo import bag
from robo.batch import Run


def length(run: Run) -> dict[str, float]:
    with bag.open(run.recording) as recording:
        return {"length": recording.duration}
"""
BATCH = """
run: replay
recordings: recordings/*.mcap
nodes: position_tracker
sweep: {position_tracker.max_distance: [10, 20]}
"""
MANIFEST = """
include: {file: robot.yaml, args: {flight_recorder: true}}
groups:
  mine:
    namespace: ${robot_name}
    nodes:
      my_node: {service: my_package.my_node}
      gripper: {service: my_package.gripper}
"""
TWO_HOSTS = """
groups:
  base:
    hosts: base
    include: robot.yaml
  arm:
    hosts: arm
    namespace: ${robot_name}
    nodes:
      my_node: {service: my_package.my_node}
"""
RECORD = '{"key": "r9/odom", "type": "nav/Odometry", "time": 1, "sequence_number": 1, "message": {}}\n'


class Lab:
    """A desk with all files that examples name, and a robot on it where one is wanted."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._runs = False
        folder = desk.folder
        shutil.copytree(ROOT / "launch", folder / "launch")
        shutil.copytree(ROOT / "config", folder / "config")
        shutil.copy(next((ROOT / "robo" / "share" / "logs").glob("*.log.gz")), folder / "run.log.gz")
        for name, text in {
            "my_package/__init__.py": "",
            "my_package/my_node.py": NODE,
            "my_package/gripper.py": MANAGED,
            "my_robot/__init__.py": "",
            "my_robot/messages.py": GRIPPER,
            "launch/mine.yaml": MANIFEST,
            "two_hosts.yaml": TWO_HOSTS,
            "gripper/pyproject.toml": "[project]\nname = 'gripper'\n",
            "gripper/tests/test_gripper.py": "def test_gripper() -> None:\n    pass\n",
            "my_robot/scores.py": SCORES,
            "batch.yaml": BATCH,
            "tolerances.yaml": "time: 0.005\n",
            "src/my_interfaces/msg/Grip.msg": "float64 width   # m\n",
            "params.yaml": "waypoint_follower: {ros__parameters: {speed: 0.3}}\n",
        }.items():
            (folder / name).parent.mkdir(exist_ok=True, parents=True)
            (folder / name).write_text(text)
        (folder / "bin").mkdir()
        for program in ("jq", "dot"):  # where there is none, one that passes on what it reads
            if shutil.which(program) is None:
                (folder / "bin" / program).write_text("#!/bin/sh\nexec cat\n")
                (folder / "bin" / program).chmod(0o755)

    def robot(self, *, runs: bool) -> None:
        """See to it that the robot runs, or that it does not."""
        if runs and not self._runs:
            code, said = self._desk.run("robo up mine.yaml --robot-name r1 -d --wait")
            assert code == 0, said
        elif not runs and self._runs:
            code, said = self._desk.run("robo down --all")
            assert code == 0, said
        self._runs = runs

    def lay_out_recordings(self, verb: str) -> None:
        """Have the recordings that a verb's examples name, as if nothing had been done with them before."""
        folder = self._desk.folder
        (folder / "recordings").mkdir(exist_ok=True)
        for file in ("drive.mcap", "again.mcap", "other.mcap", "recordings/drive.mcap"):
            (folder / file).unlink(missing_ok=True)
            bags.drive(folder / file)
        (folder / "cut.mcap").write_bytes((folder / "drive.mcap").read_bytes()[:-1000])
        if verb == "replay-test":
            self._make_reference()
        elif verb == "record":  # which makes it itself
            (folder / "drive.mcap").unlink()

    def lay_out_keystore(self, verb: str) -> None:
        """Have the keystore that a verb's examples use, as if nothing had been done with it before."""
        for name in ("security", "site"):
            shutil.rmtree(self._desk.folder / name, ignore_errors=True)
        if verb != "init":
            store = Keystore(self._desk.folder / "security")
            store.init("robo")
            people: dict[str, Role] = {"site": "router", "r1": "robot", "ann": "operator", "eve": "viewer"}
            for name, role in people.items():
                store.add(name, role, (), 30)
            store.change("r1", "publish", "fleet/positions", allow=True)

    def type(self, line: str) -> None:
        """Type a line as an example has it, and see it do what it does."""
        if re.search(r"robo down\b", line):
            self._runs = False
        try:
            self._type(line)
        finally:
            if re.search(r"robo stop\b|cmd_vel_key|robo up .*-d\b", line):  # others find all of it as it was
                self._runs = True
                self.robot(runs=False)

    def _type(self, line: str) -> None:
        if match := re.search(r"--run (\S+)", line):
            self._name_a_run(match[1])
        if "< log.jsonl" in line:  # which another example writes
            (self._desk.folder / "log.jsonl").write_text(RECORD)
        beside = None
        if "--wait-for-subscriber" in line:  # there may be others: a flight recorder hears all
            beside = self._desk.start("robo topic echo r1/chatter")
            beside.wait_for("waiting for r1/chatter", 60)
        # What goes on for long is left earlier.
        endless = is_endless(line) or re.search(r"--duration \d\d", line) is not None
        terminal = self._desk.start(f'PATH="$PWD/bin:$PATH"; {line}')
        if endless:
            self._leave(terminal, line)
        code = terminal.wait(60)
        said = terminal.output
        assert code in ((0, *INTERRUPTED) if endless else (0,)), f"{line} ended with {code}\n{said}"
        assert "Traceback" not in said, f"{line}\n{said}"
        assert "FATAL" not in said, f"{line}\n{said}"
        if beside is not None:
            beside.wait_for("data: hello")
            beside.interrupt()
            beside.wait()

    def _leave(self, terminal: Running, line: str) -> None:
        """Press Ctrl-C once it has done something."""
        words = line.rpartition("&&")[2]
        file = re.search(r"> (\S+)$", words)
        if file is not None:
            target = self._desk.folder / file[1]
            eventually(lambda: target.exists() and target.stat().st_size > 0, f"{line}: something in {target}")
        elif re.search(r"robo up\b", words):
            terminal.wait_for("is ready", 60)
        elif "topic pub" in words:
            terminal.wait_for("published ", 60)
        elif re.search(r"robo run\b", words):
            eventually(lambda: "/" in self._desk.run("robo node list")[1], f"{line}: a node")
        else:
            with suppress(AssertionError):  # a filter may have nothing to pass on
                terminal.wait_for("", 5 if "select(" in words else 60)
        terminal.interrupt()

    def _make_reference(self) -> None:
        """Record a drive, with what the tracker says of it."""
        drive = self._desk.folder / "drive.mcap"
        drive.unlink()
        replays.odometry(drive)
        code, said = self._desk.run(f"robo replay-test {drive} --node position_tracker --accept")
        assert code == 0, said
        shutil.copy(drive, drive.with_name("reference.mcap"))

    def _name_a_run(self, name: str) -> None:
        """Have a run of this name, with the logs of one that was."""
        runs = sorted(path.parent for path in (self._desk.folder / ".state").rglob("run.json"))
        if not (wanted := runs[0].parent / name).exists():
            shutil.copytree(runs[0], wanted)


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    with closing(Desk(tmp_path_factory.mktemp("desk"))) as desk:
        made = Lab(desk)
        yield made
        made.robot(runs=False)


def test_every_verb_has_examples() -> None:
    assert [" ".join(path) for path, lines in EXAMPLES.items() if not lines] == []
    own = {path: [line for line in lines if "robo " not in line] for path, lines in EXAMPLES.items()}
    assert {path: lines for path, lines in own.items() if lines} == {}


@pytest.mark.parametrize("path", EXAMPLES, ids=" ".join)
def test_the_examples_of_a_verb_work(lab: Lab, path: tuple[str, ...]) -> None:
    if path in NOT_RUN:
        pytest.skip(NOT_RUN[path])
    if path[0] == "batch" and not HAS_RAY:
        pytest.skip("Ray is not installed: pip install 'robo-zenoh[ray]'")
    if path[0] in ("bag", "batch", "map", "replay-test"):
        lab.lay_out_recordings(path[-1])
    if path[0] in ("security", "router") or any("--security" in line for line in EXAMPLES[path]):
        lab.lay_out_keystore(path[-1])
    for line in EXAMPLES[path]:
        if path not in NO_MATTER:
            lab.robot(runs=path not in ALONE)
        lab.type(line)
