"""What strict type checkers see of a user's code: nothing in what is right, each mistake in its line."""

import importlib.util
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

pytestmark = pytest.mark.timeout(300)

RIGHT = '''
from collections.abc import Set
from typing import Annotated, assert_type

import robo
from msgspec import Meta
from robo import KEEP_ALL, Client, MessageInfo, Node, Publisher, Unit, service, subscribe, timer
from robo.testing import Clock, Launch, Robot, RunNode
from robo_messages import LaserScan, Message, Point, SetBool, Trigger, message


@message("my_robot/Grip")
class Grip(Message):
    """How wide a gripper is."""

    width: float = 0.0
    """m."""


class Arm(Node):
    """Hold still."""

    class Parameters(robo.Parameters):
        rate: Annotated[float, Meta(gt=0, description="how often"), Unit("Hz")] = 10.0
        frame: str = "base"

    parameters: Parameters
    place = Publisher(Point, "place")
    grip = Publisher(Grip, "grip", depth=KEEP_ALL)
    reset = Client(Trigger.Request, Trigger.Response, "reset")

    def on_start(self) -> None:
        self.seen = 0
        self.widths = self.create_publisher(Grip, "widths")
        self.create_subscription(Grip, "others", self.on_grip)

    def on_grip(self, grip: Grip) -> None:
        self.widths.publish(grip)

    def on_parameters_changing(self, new: Parameters) -> None:
        assert_type(new.rate, float)

    def on_parameters_changed(self, names: Set[str]) -> None:
        self.logger.info("changed: %s", names)

    @subscribe("scan", depth=1)
    def on_scan(self, scan: LaserScan) -> None:
        self.seen += len(scan.ranges)

    @subscribe("place")
    def on_place(self, place: Point, info: MessageInfo) -> None:
        assert_type(info.age, float)

    @service("lights")
    def lights(self, request: SetBool.Request) -> SetBool.Response:
        return SetBool.Response(success=request.data)

    @timer(rate="rate")
    def tick(self) -> None:
        assert_type(self.parameters.rate, float)
        self.place.publish(Point(x=self.parameters.rate))
        self.grip.publish(Grip(width=0.1))
        assert_type(self.reset(Trigger.Request()), Trigger.Response)
        assert_type(self.lights(SetBool.Request()), SetBool.Response)
        self.on_scan(LaserScan())


class Bare(Node):
    @timer(rate=1.0)
    def tick(self) -> None:
        assert_type(self.parameters.use_sim_time, bool)


def test_it_tells(run_node: RunNode, clock: Clock) -> None:
    node = run_node(Arm, rate=5.0)
    clock.advance(0.2)
    assert_type(node.node, Arm)
    assert_type(node.published(Arm.place), list[Point])
    assert node.published("grip")[-1].width == 0.1
    node.send("scan", LaserScan())
    node.set(rate=1.0)
    assert node.call("lights", SetBool.Request(data=True)).success


def test_the_robot(launch: Launch) -> None:
    robot = launch("robot.yaml", use_sim=True)
    assert_type(robot, Robot)
    last = robot.wait_for("place", lambda place: place.x > 0.1, timeout=10.0)
    assert robot.messages("place")[-1] == last
    robot.kill("arm")


if __name__ == "__main__":
    robo.run(Arm)
'''

WRONG = """
import robo
from robo import Client, MessageInfo, Node, Publisher, service, subscribe, timer
from robo.testing import Clock, Launch, RunNode
from robo_messages import LaserScan, Point, SetBool, Trigger, Twist


class Arm(Node):
    class Parameters(robo.Parameters):
        rate: float = 10.0

    parameters: Parameters
    place = Publisher(Point, "place")
    reset = Client(Trigger.Request, Trigger.Response, "reset")
    number = Publisher(int, "number")  # wrong

    @subscribe("scan")
    def on_scan(self, scan: LaserScan) -> None:
        name: str = self.parameters.rate  # wrong
        print(name, self.parameters.rat)  # wrong

    @subscribe("cmd_vel")
    def on_command(self, command: Twist, info: MessageInfo) -> None:
        print(command, info.aeg)  # wrong

    @subscribe("scan")  # wrong
    def nothing(self) -> None:
        pass

    @subscribe("scan")  # wrong
    def no_message(self, scan: int) -> None:
        pass

    @service("lights")
    def lights(self, request: SetBool.Request) -> SetBool.Response:
        return SetBool.Response(success=request.dat)  # wrong

    @service("lamp")  # wrong
    def lamp(self, request: SetBool.Request) -> bool:
        return request.data

    @timer(rate="rate")
    def tick(self) -> None:
        self.place.publish(Twist())  # wrong
        self.reset(SetBool.Request())  # wrong
        print(self.reset(Trigger.Request()).mesage)  # wrong
        self.on_scan(Twist())  # wrong
        self.lights(True)  # wrong
        self.tick(1)  # wrong

    @timer(rate=1.0)  # wrong
    def more(self, than: int) -> None:
        pass

    @timer(rate=1.0)  # wrong
    async def waits(self) -> None:
        pass


def test_it(run_node: RunNode, clock: Clock, launch: Launch) -> None:
    node = run_node(Arm)
    print(node.published(Arm.place)[0].w)  # wrong
    node.node.on_scan(Twist())  # wrong
    node.send("scan", 1)  # wrong
    node.call("lights")  # wrong
    clock.advance("0.1")  # wrong
    run_node(Point)  # wrong
    launch("robot.yaml").kil("arm")  # wrong


Publisher(Point, "p").publish(Twist())  # wrong
robo.run(Arm(name="arm"))  # wrong
"""


def mypy(file: Path) -> dict[int, str]:
    """The lines in which mypy finds a mistake, and what it says."""
    if importlib.util.find_spec("mypy") is None:
        pytest.skip("mypy is not installed; it comes with the extra test")
    command = [sys.executable, "-m", "mypy", "--strict", "--output=json", f"--cache-dir={file.parent}", file.name]
    result = subprocess.run(command, cwd=file.parent, capture_output=True, text=True, check=False)
    assert result.returncode in (0, 1), result.stdout + result.stderr
    found = [json.loads(line) for line in result.stdout.splitlines() if line]
    return {one["line"]: one["message"] for one in found if one["severity"] == "error"}


def pyright(file: Path) -> dict[int, str]:
    """The lines in which pyright finds a mistake, and what it says. This form comes by pip and fetches nothing."""
    program = shutil.which("basedpyright", path=str(Path(sys.executable).parent))
    if program is None:
        pytest.skip("pyright is not installed; basedpyright comes with the extra test")
    folder = file if file.is_dir() else file.parent
    (folder / "pyrightconfig.json").write_text('{"typeCheckingMode": "strict"}')
    command = [program, "--outputjson", "--pythonpath", sys.executable, str(file)]
    result = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert result.returncode in (0, 1), result.stdout + result.stderr
    found = json.loads(result.stdout)["generalDiagnostics"]
    return {one["range"]["start"]["line"] + 1: one["message"] for one in found if one["severity"] == "error"}


Checker = Callable[[Path], dict[int, str]]
both = pytest.mark.parametrize("checker", [mypy, pyright])


@both
def test_code_that_is_right_has_no_mistake(checker: Checker, tmp_path: Path) -> None:
    (tmp_path / "arm.py").write_text(RIGHT)
    assert checker(tmp_path / "arm.py") == {}


@both
def test_each_mistake_is_seen_in_its_line(checker: Checker, tmp_path: Path) -> None:
    (tmp_path / "arm.py").write_text(WRONG)
    found = checker(tmp_path / "arm.py")
    wrong = {number for number, line in enumerate(WRONG.splitlines(), start=1) if re.search("# wrong$", line)}
    assert found.keys() == wrong, found


def test_a_package_that_robo_creates_has_no_mistake(tmp_path: Path) -> None:
    options = ("--node", "gripper", "--publishes", "grip:std/Float64", "--subscribes", "scan:sensor/LaserScan")
    more = ("--service", "close:std/Trigger", "--message", "Grip")
    command = [sys.executable, "-m", "robo", "create", "my_robot", *options, *more]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    assert pyright(tmp_path / "my_robot") == {}
