"""Robots of tests: real processes, started by the plugin, and what is said and done where they fail."""

import os
import re
import signal
import subprocess
import sys

import psutil
import pytest

from robo.errors import NodeNotFound, ParameterError
from robo.testing import Launch, LaunchFailed
from robo_messages import Odometry, String, Trigger
from tests.support import eventually

pytest_plugins = ["pytester"]

ARM = """
import os, subprocess, sys, time

from robo import Node, Publisher, subscribe, timer
from robo_messages import String


class Arm(Node):
    done = Publisher(String, "done")
    helper = None

    @timer(rate=20.0)
    def tell(self) -> None:
        self.done.publish(String("at rest"))

    @subscribe("order")
    def on_order(self, order: String) -> None:
        self.logger.info("told to %s", order.data)
        if order.data == "die":
            raise SystemExit("the arm is broken")
        if order.data == "hang":
            while True:
                time.sleep(0.01)
        if order.data == "fork":
            pid = os.fork()
            if not pid:
                os.setsid()
                time.sleep(987)
            self.logger.info("child %d", pid)
            self.done.publish(String("forked"))
        if order.data in ("spawn", "help"):
            child = subprocess.Popen(["sleep", "988"])
            self.logger.info("child %d", child.pid)
            self.helper = child if order.data == "help" else None
            self.done.publish(String("spawned"))

    def on_stop(self) -> None:
        if self.helper is not None:
            self.helper.terminate()
            self.helper.wait()
"""

MANIFEST = """
groups:
  work:
    nodes:
      arm: {service: arm, restart: on-failure}
"""

TESTS = """
from robo.testing import Launch
from robo_messages import String


def test_fine(launch):
    assert launch("arm.yaml").wait_for("done") == String("at rest")


def test_die(launch):
    robot = launch("arm.yaml")
    robot.send("order", String("die"))
    robot.wait_for("log", lambda record: "told to die" in record.msg)
    while not any(one.restarts for one in robot.processes()):
        pass


def test_hang(launch):
    robot = launch("arm.yaml")
    robot.wait_for("done")
    robot.send("order", String("hang"))
    robot.wait_for("done", lambda done: done.data == "moved", timeout=1.0)


def test_fork(launch):
    robot = launch("arm.yaml")
    robot.send("order", String("fork"))
    robot.wait_for("done", lambda done: done.data == "forked")


def test_spawn(launch):
    robot = launch("arm.yaml")
    robot.send("order", String("spawn"))
    robot.wait_for("done", lambda done: done.data == "spawned")
    assert robot.processes()[0].restarts == 0


def test_die_of_many(launch):
    robot = launch("arm.yaml")
    robot.send("order", String("spawn"))
    robot.wait_for("done", lambda done: done.data == "spawned")
    robot.send("order", String("die"))
    robot.wait_for("log", lambda record: "told to die" in record.msg)
    while not any(one.restarts for one in robot.processes()):
        pass


def test_help(launch):
    robot = launch("arm.yaml")
    robot.send("order", String("help"))
    robot.wait_for("done", lambda done: done.data == "spawned")


def test_kill(launch):
    robot = launch("arm.yaml")
    robot.send("order", String("spawn"))
    robot.wait_for("done", lambda done: done.data == "spawned")
    robot.kill("arm")
"""

SAID = {
    "die": [r"NodeDied: arm has died: exit code 1\n(.*\n)*?.*the arm is broken", "if that is meant: launch"],
    "hang": [
        r"AssertionError: no such message on done within 1 s: \d+ others came",
        "robot r1",
        r"arm:\n(.*\n)*?.*INFO told to hang",
        r"last messages:\n(.*\n)*?.*done, message \d+: \{.data.:.at rest.\}",
    ],
    "fork": [
        r"Leak: arm.yaml: nodes have left behind\n"
        r"E +arm: the process \d+: \S+python\S* -m robo.process.node arm /arm\n",
        r"INFO told to fork\n(.*\n)*?.*INFO child \d+",
    ],
    "spawn": [
        r"Leak: arm.yaml: nodes have left behind\nE +arm: the process \d+: sleep 988\n",
        r"INFO told to spawn\n(.*\n)*?.*INFO child \d+",
    ],
    "die of many": [
        r"NodeDied: arm has died: exit code 1\n(.*\n)*?.*the arm is broken\n(.*\n)*?"
        r"E +Leak: arm.yaml: nodes have left behind\nE +arm: the process \d+: sleep 988\n",
    ],
}


def command(*options: str) -> list[str]:
    return [sys.executable, "-m", "pytest", "-p", "no:robo", "-p", "robo.testing.plugin", *options]


def make(pytester: pytest.Pytester, tests: str) -> None:
    (pytester.path / "arm.py").write_text(ARM)
    (pytester.path / "arm.yaml").write_text(MANIFEST)
    pytester.makepyfile(test_arm=tests)


def is_alive(pid: int) -> bool:
    return psutil.pid_exists(pid) and psutil.Process(pid).status() != psutil.STATUS_ZOMBIE


@pytest.mark.parametrize("options", [("-p", "no:xdist"), ("-n", "2")], ids=["in one process", "in two"])
def test_what_robots_do_wrong_is_named_and_does_not_stay(pytester: pytest.Pytester, options: tuple[str, ...]) -> None:
    make(pytester, TESTS)
    ended = subprocess.run(
        command(*options), cwd=pytester.path, capture_output=True, text=True, timeout=120, check=False
    )
    output = ended.stdout
    for patterns in SAID.values():
        for pattern in patterns:
            assert re.search(pattern, output), f"{pattern}\n{output}"
    assert re.search(r"^FAILED test_arm.py::test_hang", output, re.MULTILINE), output
    wrong = ["die", "die_of_many", "fork", "spawn"]
    assert sorted(re.findall(r"^ERROR test_arm.py::test_(\w+)", output, re.MULTILINE)) == wrong, output
    assert "1 failed, 7 passed, 4 errors" in output, output
    children = {int(pid) for pid in re.findall(r"INFO child (\d+)", output)}
    assert len(children) == 3
    assert not any(map(is_alive, children))
    there = {one.pid for one in psutil.process_iter(["cwd"]) if one.info["cwd"] == str(pytester.path)}
    assert there <= {os.getpid()}  # where pytester has gone itself


OF_A_MODULE = """
import pytest
from robo_messages import String


@pytest.fixture(scope="module")
def robot(module_launch):
    return module_launch("arm.yaml")


def test_one(robot):
    robot.wait_for_count("done", 2)


def test_two(robot):
    assert robot.wait_until("arm", lambda arm: arm.state == "ready").restarts == 0
    robot.send("order", String("rest"))
    robot.wait_for_line("told to rest")
    with pytest.raises(AssertionError, match="no line of the run holds 'told to run', within 0.1 s"):
        robot.wait_for_line("told to run", timeout=0.1)
    with pytest.raises(AssertionError, match="0 messages on nothing within 0.1 s, not 3"):
        robot.wait_for_count("nothing", 3, timeout=0.1)
    with pytest.raises(AssertionError, match="it is not so within 0.1 s: arm is ready"):
        robot.wait_until("arm", lambda arm: arm.restarts == 5, timeout=0.1)
    with pytest.raises(AssertionError, match="the run still goes on after 0.1 s"):
        robot.wait_until_over(0.1)
    assert not "shown"


def test_three(robot):
    robot.send("order", String("spawn"))
    robot.wait_for("done", lambda done: done.data == "spawned")
"""


def test_a_robot_of_a_module_is_started_once_and_looked_at_to_its_end(pytester: pytest.Pytester) -> None:
    make(pytester, OF_A_MODULE)
    ended = subprocess.run(
        command("-p", "no:xdist"), cwd=pytester.path, capture_output=True, text=True, timeout=120, check=False
    )
    output = ended.stdout
    assert "1 failed, 2 passed, 1 error" in output, output
    assert re.search(r"assert not .shown.\n(.*\n)*?.*robot r1.*\n(.*\n)*?.*INFO told to rest", output), output
    assert re.search(r"Leak: arm.yaml: nodes have left behind\nE +arm: the process \d+: sleep 988\n", output), output
    assert output.count("- robot r1 -") == 2, "with the test that failed, and with what was left at the end"


def test_a_run_that_is_killed_takes_its_robots_along(pytester: pytest.Pytester) -> None:
    make(
        pytester,
        "import time\n\ndef test_it(launch):\n    robot = launch('arm.yaml')\n"
        "    print('here', *(one.pid for one in robot.processes()), flush=True)\n    time.sleep(987)\n",
    )
    with subprocess.Popen(
        command("-s", "-p", "no:xdist"), cwd=pytester.path, stdout=subprocess.PIPE, text=True, bufsize=1
    ) as run:
        assert run.stdout is not None
        line = next(line for line in run.stdout if "here" in line)
        pids = [int(pid) for pid in re.findall(r"here (\d+)", line)]
        children = [one.pid for one in psutil.Process(run.pid).children(recursive=True)]
        assert pids
        assert set(pids) <= set(children)
        os.kill(run.pid, signal.SIGKILL)
    eventually(lambda: not any(map(is_alive, children)), "the robot has ended")


def test_a_robot_can_be_watched_asked_and_set(launch: Launch) -> None:
    robot = launch(
        "simulation.yaml", robot_name="r2", demo="arc", options=["-p", "velocity_controller.linear_velocity:=0.3"]
    )
    there = robot.wait_for("odom", lambda odometry: odometry.pose.pose.position.x > 0.05)
    assert isinstance(there, Odometry)
    assert robot.get("velocity_controller", "linear_velocity") == 0.3
    robot.set("/r2/velocity_controller", linear_velocity=0.1)
    assert robot.get("velocity_controller", "linear_velocity") == 0.1
    with pytest.raises(ParameterError, match="linear_velocity"):
        robot.set("velocity_controller", linear_velocity=99.0)
    assert robot.call("reset", Trigger.Request()).success
    robot.clear()
    robot.wait_for("odom", lambda odometry: odometry.pose.pose.position.x < 0.05)
    assert all(isinstance(one, Odometry) for one in robot.messages("odom"))
    with pytest.raises(AssertionError, match=r"no such message on odo within 0.1 s: none came; did you mean r2/odom"):
        robot.wait_for("odo", timeout=0.1)
    with pytest.raises(NodeNotFound, match="did you mean velocity_controller"):
        robot.kill("velocity_control")


def test_nodes_are_killed_paused_and_cut_off(launch: Launch) -> None:
    robot = launch("robot.yaml", demo="arc")
    robot.pause("position_tracker")
    robot.resume("position_tracker")
    robot.kill("position_tracker")
    robot.wait_until_ready()
    assert [one.restarts for one in robot.processes() if one.name.label == "position_tracker"] == [1]
    robot.kill("velocity_controller")
    with pytest.raises(LaunchFailed, match=r"velocity_controller is failed, was killed by SIGKILL"):
        robot.wait_until_ready()
    robot.clear()
    robot.cut("diff_drive_sim")
    robot.wait_for("safety_state", lambda state: "laser scan is" in state.message)
    robot.clear()
    robot.mend("diff_drive_sim")
    robot.wait_for("odom")


def test_what_does_not_start_says_why(launch: Launch) -> None:
    with pytest.raises(LaunchFailed, match=r"there is no manifest 'rowboat.yaml'"):
        launch("rowboat.yaml")
    with pytest.raises(LaunchFailed, match="no argument 'use_sin'; did you mean use_sim"):
        launch("robot.yaml", use_sin=True)


def test_a_message_may_be_sent(launch: Launch) -> None:
    robot = launch("robot.yaml", "tracking", robot_name="r1")
    robot.send("odom", Odometry())
    robot.wait_for("current_position")
    robot.send("note", String("of no type that the robot has"))
    assert robot.wait_for("note").data == "of no type that the robot has"
