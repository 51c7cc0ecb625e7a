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
import asyncio
from collections.abc import Generator, Set
from typing import Annotated, assert_type

import robo
from msgspec import Meta
from robo import KEEP_ALL, ActionClient, Client, GoalCanceled, MessageInfo, Node, Publisher, QoS, Unit
from robo import action, service, subscribe, timer
from robo import LifecycleNode, LifecycleState, TransitionCallbackReturn
from robo.testing import Clock, Launch, Robot, RunNode
from robo_messages import (
    Fibonacci,
    Image,
    LaserScan,
    Message,
    OccupancyGrid,
    Point,
    PointCloud2,
    SetBool,
    Trigger,
    message,
)
from robo_messages.scans import LaserScanArray


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
    goal = Publisher(Point, "goal", qos=QoS.COMMAND, depth=2)
    state = Publisher(Grip, "state", latched=True, priority="data_low", deadline=1.0)
    reset = Client(Trigger.Request, Trigger.Response, "reset")
    count = ActionClient(Fibonacci.Goal, Fibonacci.Result, Fibonacci.Feedback, "fibonacci")

    def on_start(self) -> None:
        self.seen = 0
        self.widths = self.create_publisher(Grip, "widths")
        self.create_subscription(Grip, "others", self.on_grip)
        self.create_publisher(Grip, "more", 3, latched=True).publish(Grip())
        self.create_subscription(Grip, "more", self.on_grip, qos=QoS.LATCHED, lifespan=2.0)

    def on_grip(self, grip: Grip) -> None:
        self.widths.publish(grip)

    def on_parameters_changing(self, new: Parameters) -> None:
        assert_type(new.rate, float)

    def on_parameters_changed(self, names: Set[str]) -> None:
        self.logger.info("changed: %s", names)

    @subscribe("scan", depth=1)
    def on_scan(self, scan: LaserScan) -> None:
        self.seen += len(scan.ranges)

    @subscribe("image")
    def on_image(self, image: Image) -> None:
        self.place.publish(Point(x=float(image.array.mean())))
        assert_type(Image.from_array(image.array[::2], "mono8"), Image)

    @subscribe("points")
    def on_points(self, cloud: PointCloud2) -> None:
        self.place.publish(Point(x=float(cloud.array["x"].max())))
        assert_type(PointCloud2.from_array(cloud.array), PointCloud2)
        assert_type(OccupancyGrid.from_array([[0, 100]], 0.05), OccupancyGrid)

    @subscribe("scan", depth=1)
    def on_array(self, scan: LaserScanArray) -> None:
        scan.ranges = scan.ranges * 2.0
        assert_type(float(scan.ranges.min()), float)

    @subscribe("state", latched=True, lifespan=0.5)
    def on_state(self, grip: Grip) -> None:
        assert_type(QoS.SENSOR_DATA.depth, int)

    @subscribe("place")
    def on_place(self, place: Point, info: MessageInfo) -> None:
        assert_type(info.age, float)

    @service("lights")
    def lights(self, request: SetBool.Request) -> SetBool.Response:
        return SetBool.Response(success=request.data)

    def accept(self, goal: Fibonacci.Goal) -> None:
        if goal.order < 0:
            raise ValueError("nobody counts backwards")

    @action("fibonacci", rate=20.0, policy="queue", accept=accept)
    def fibonacci(self, goal: Fibonacci.Goal) -> Generator[Fibonacci.Feedback, None, Fibonacci.Result]:
        try:
            yield Fibonacci.Feedback([goal.order])
        except GoalCanceled:
            self.seen = 0
        return Fibonacci.Result()

    @action("wait")
    def waits(self, goal: Fibonacci.Goal) -> Generator[Fibonacci.Feedback | None, None, Fibonacci.Result]:
        yield None
        return (yield from self.fibonacci(goal))

    @action("quick")
    def quick(self, goal: Fibonacci.Goal) -> Fibonacci.Result:
        sent = self.count.send_goal(goal, self.on_feedback)
        assert_type(sent.done(), bool)
        assert_type(sent.result(timeout=1.0), Fibonacci.Result)
        return self.count(goal, lambda feedback: self.on_feedback(feedback), timeout=2.0)

    def on_feedback(self, feedback: Fibonacci.Feedback) -> None:
        self.seen = len(feedback.sequence)

    @timer(rate="rate")
    def tick(self) -> None:
        assert_type(self.parameters.rate, float)
        self.place.publish(Point(x=self.parameters.rate))
        self.grip.publish(Grip(width=0.1))
        assert_type(self.reset(Trigger.Request()), Trigger.Response)
        assert_type(self.lights(SetBool.Request()), SetBool.Response)
        self.on_scan(LaserScan())


class Patient(Node):
    place = Publisher(Point, "place")
    reset = Client(Trigger.Request, Trigger.Response, "reset")

    def on_start(self) -> None:
        self.create_timer(0.1, self.look)
        self.create_timer(0.1, self.glance, turn="look")
        self.create_subscription(LaserScan, "scan", self.on_scan)
        self.create_service(SetBool.Request, SetBool.Response, "lights", self.lights)
        self.create_service(SetBool.Request, SetBool.Response, "lamp", self.lamp)

    @subscribe("scan", depth=1)
    async def on_scan(self, scan: LaserScan) -> None:
        await asyncio.sleep(scan.scan_time)

    @subscribe("place", turn="place")
    async def on_place(self, place: Point, info: MessageInfo) -> None:
        assert_type(info.age, float)

    @service("lights")
    async def lights(self, request: SetBool.Request) -> SetBool.Response:
        assert_type(await self.reset.call_async(Trigger.Request(), timeout=1.0), Trigger.Response)
        return SetBool.Response(success=request.data)

    @service("lamp", turn="lamp")
    def lamp(self, request: SetBool.Request) -> SetBool.Response:
        return SetBool.Response(success=request.data)

    @timer(rate=1.0, turn="look")
    async def look(self) -> None:
        assert_type(await self.lights(SetBool.Request()), SetBool.Response)
        await self.on_scan(LaserScan())

    def glance(self) -> None:
        pass

    async def main(self) -> None:
        await self.look()


class Bare(Node):
    @timer(rate=1.0)
    def tick(self) -> None:
        assert_type(self.parameters.use_sim_time, bool)


class Camera(LifecycleNode):
    picture = Publisher(Grip, "picture")

    def on_configure(self) -> None:
        assert_type(self.state_before, LifecycleState)

    def on_activate(self) -> TransitionCallbackReturn:
        return TransitionCallbackReturn.FAILURE

    def on_error(self) -> TransitionCallbackReturn | None:
        return super().on_error()

    @timer(rate=1.0)
    def rest(self) -> None:
        assert_type(self.change_state("deactivate"), TransitionCallbackReturn)
        assert_type(self.lifecycle_state.label, str)


def test_it_rests(run_node: RunNode) -> None:
    camera = run_node(Camera, autostart=False)
    assert_type(camera.change_state("configure"), bool)


def test_it_tells(run_node: RunNode, clock: Clock) -> None:
    node = run_node(Arm, rate=5.0)
    clock.advance(0.2)
    assert_type(node.node, Arm)
    assert_type(node.published(Arm.place), list[Point])
    assert node.published("grip")[-1].width == 0.1
    node.send("scan", LaserScan())
    node.set(rate=1.0)
    assert node.call("lights", SetBool.Request(data=True)).success
    goal = node.send_goal("fibonacci", Fibonacci.Goal(3))
    assert goal.cancel() and goal.status.is_terminal


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
from collections.abc import Generator

import robo
from robo import ActionClient, Client, LifecycleNode, MessageInfo, Node, Publisher, action, service, subscribe, timer
from robo.testing import Clock, Launch, RunNode
from robo_messages import Fibonacci, LaserScan, Point, SetBool, Trigger, Twist


class Arm(Node):
    class Parameters(robo.Parameters):
        rate: float = 10.0

    parameters: Parameters
    place = Publisher(Point, "place")
    reset = Client(Trigger.Request, Trigger.Response, "reset")
    number = Publisher(int, "number")  # wrong
    urgent = Publisher(Point, "urgent", priority="urgent")  # wrong
    short = Publisher(Point, "short", lifespan=1.0)  # wrong
    count = ActionClient(Fibonacci.Goal, Fibonacci.Result, Fibonacci.Feedback, "fibonacci")
    counts = ActionClient(Fibonacci.Goal, Fibonacci.Result, int, "fibonacci")  # wrong

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

    @action("fibonacci")
    def fibonacci(self, goal: Fibonacci.Goal) -> Generator[Fibonacci.Feedback, None, Fibonacci.Result]:
        yield Fibonacci.Feedback(goal.orders)  # wrong
        yield Twist()  # wrong
        return Fibonacci.Feedback()  # wrong

    @action("number")  # wrong
    def counted(self, goal: Fibonacci.Goal) -> int:
        return goal.order

    @action("number", policy="all")  # wrong
    def counting(self, goal: Fibonacci.Goal) -> Fibonacci.Result:
        return Fibonacci.Result()

    def on_feedback(self, feedback: Twist) -> None:
        print(feedback)

    @timer(rate="rate")
    def tick(self) -> None:
        self.count(Fibonacci.Goal(), self.on_feedback)  # wrong
        self.count.send_goal(Twist())  # wrong
        print(self.count(Fibonacci.Goal()).sequenc)  # wrong
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
    async def counts(self) -> int:
        return 1

    @timer(rate=1.0, turn=1)  # wrong
    async def waits(self) -> None:
        await self.reset.call_async(SetBool.Request())  # wrong
        print((await self.reset.call_async(Trigger.Request())).mesage)  # wrong
        await self.switch(True)  # wrong

    @service("switch")
    async def switch(self, request: SetBool.Request) -> SetBool.Response:
        return SetBool.Response(success=request.dat)  # wrong

    @subscribe("scan")  # wrong
    async def reads(self) -> None:
        pass


class Camera(LifecycleNode):
    def on_configure(self) -> bool:  # wrong
        return True

    def on_activate(self, state: int) -> None:  # wrong
        self.change_state(3)  # wrong


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
