"""What must never move a robot, tried on the reference robot with processes that are killed and paused."""

import math
import os
import signal
import threading
import time
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import msgpack
import pytest

from robo.testing import Launch, Robot
from robo_messages import Odometry, Trigger
from tests.support import run_robo

COMMAND_TIMEOUT = 0.5
"""Of the base and of the monitor: `cmd_vel_timeout` and `command_timeout`, s."""
SPEED = 0.5
"""m/s."""
BRAKING = SPEED**2 / (2 * 5.0)
"""With the base's deceleration, m."""
SLACK = 0.08
"""Two steps of the base, the way of a command through the chain, and what a busy machine takes for a fault, m."""


def driving(launch: Launch, **options: Any) -> Robot:
    """The reference robot, once it drives."""
    robot = launch("robot.yaml", demo="arc", **options)
    drives(robot)
    return robot


def drives(robot: Robot) -> None:
    robot.wait_for("odom", lambda odometry: speed_of(odometry) > 0.9 * SPEED, new=True)


def stands(robot: Robot) -> None:
    robot.wait_for("odom", lambda odometry: speed_of(odometry) == 0.0, new=True)


def wait_for_state(robot: Robot, condition: Callable[[dict[str, str]], bool], *, new: bool = False) -> None:
    """Wait for what the monitor says, of what it says since `clear`, or from now on."""
    robot.wait_for("safety_state", lambda state: condition({value.key: value.value for value in state.values}), new=new)


def more_odometry(robot: Robot, count: int) -> None:
    robot.wait_for_count("odom", len(robot.messages("odom")) + count)


def call(robot: Robot, service: str) -> str:
    message: str = robot.call(service, Trigger.Request()).message
    return message


def speed_of(odometry: Odometry) -> float:
    return math.hypot(odometry.twist.twist.linear.x, odometry.twist.twist.linear.y)


def sent(odometry: Odometry) -> float:
    return odometry.header.stamp.to_nanoseconds() * 1e-9


def driven(messages: list[Odometry]) -> float:
    """The length of the way, m."""
    places = [message.pose.pose.position for message in messages]
    return sum(math.hypot(b.x - a.x, b.y - a.y) for a, b in pairwise(places))


def kill(robot: Robot) -> None:
    robot.kill("safety_monitor")


def segfault(robot: Robot) -> None:
    pid = robot.process("safety_monitor").pid
    assert pid is not None
    os.kill(pid, signal.SIGSEGV)


def restart(robot: Robot) -> None:
    robo_command("restart", "safety_monitor", robot)


def restart_group(robot: Robot) -> None:
    robo_command("restart", "control", robot)


def restart_all(robot: Robot) -> None:
    for group in ("base", "tracking", "control"):
        robo_command("restart", group, robot)


def hang(robot: Robot) -> None:
    robot.pause("safety_monitor")


def robo_command(verb: str, name: str, robot: Robot) -> None:
    done = run_robo(verb, name, "--robot-name", "r1", "--connect", robot.endpoint)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("end", [kill, segfault, restart, restart_group, restart_all, hang])
def test_an_emergency_stop_outlives_the_monitor(launch: Launch, end: Callable[[Robot], None]) -> None:
    robot = driving(launch, may_die=["safety_monitor"])
    call(robot, "emergency_stop")
    stands(robot)
    before = robot.process("safety_monitor").pid
    robot.clear()
    end(robot)
    robot.wait_until("safety_monitor", lambda monitor: monitor.pid not in (before, None))
    wait_for_state(robot, lambda state: state["reason"] == "emergency_stop", new=True)
    # The controller drives at once where it is let; two more seconds show that it is not.
    more_odometry(robot, 100)
    assert not any(map(speed_of, robot.messages("odom")))
    assert "released" in call(robot, "reset_emergency_stop")
    drives(robot)


@pytest.mark.parametrize("pause", [0.6, 1.0, 2.0])
def test_commands_that_waited_in_a_paused_monitor_are_old(launch: Launch, pause: float) -> None:
    robot = driving(launch)
    robot.pause("safety_monitor")
    time.sleep(pause / 2)  # commands pile up
    robot.kill("velocity_controller")
    time.sleep(pause / 2)
    robot.clear()
    robot.resume("safety_monitor")
    wait_for_state(robot, lambda state: state["action"] == "stop")
    more_odometry(robot, 75)  # it may stand at first and then obey what it finds
    stands(robot)
    # What the controller said last was said half the pause before.
    allowed = max(0.0, COMMAND_TIMEOUT - pause / 2) * SPEED + BRAKING + SLACK
    assert driven(robot.messages("odom")) <= allowed


@pytest.mark.parametrize("pause", [0.3, 1.0, 2.0])
def test_commands_that_waited_in_a_paused_base_are_old(launch: Launch, pause: float) -> None:
    robot = driving(launch)
    robot.pause("diff_drive_sim")
    time.sleep(0.15)  # commands pile up; without a scan for longer the monitor would stop
    robot.pause("safety_monitor")
    robot.pause("velocity_controller")
    time.sleep(pause)
    robot.clear()
    resumed = time.time()
    robot.resume("diff_drive_sim")
    robot.wait_for_count("odom", 75)  # it may stand at first and then obey what it finds
    stands(robot)
    allowed = max(0.0, COMMAND_TIMEOUT - pause) * SPEED + BRAKING + SLACK
    # The first odometry after the pause has the motion of the pause itself.
    after = [message for message in robot.messages("odom") if sent(message) >= resumed]
    assert driven(after) <= allowed, [(sent(message) - resumed, speed_of(message)) for message in after]


def test_timeouts_of_monitor_and_base_do_not_add_up(launch: Launch) -> None:
    robot = driving(launch)
    robot.clear()
    begin = time.monotonic()
    robot.kill("velocity_controller")
    time.sleep(max(0.0, begin + 0.4 - time.monotonic()))
    robot.pause("safety_monitor")
    stands(robot)
    assert driven(robot.messages("odom")) <= COMMAND_TIMEOUT * SPEED + BRAKING + SLACK


@pytest.mark.parametrize("rate", [10, 200, 1000])
def test_a_stranger_moves_nothing_and_is_named(launch: Launch, rate: int) -> None:
    robot = driving(launch)
    call(robot, "emergency_stop")
    stands(robot)
    robot.clear()
    leave = threading.Event()
    payload = msgpack.packb({"linear": {"x": SPEED}})

    def drive() -> None:
        while not leave.wait(1.0 / rate):
            robot.session.put("r1/cmd_vel", payload)

    stranger = threading.Thread(target=drive)
    stranger.start()
    try:
        wait_for_state(robot, lambda state: state.get("rival") == "a plain Zenoh client")
        robot.wait_for_line("left out messages of a plain Zenoh client on r1/cmd_vel")
        for command, words in (
            (("why", "diff_drive_sim"), "leaves out messages of a plain Zenoh client on r1/cmd_vel"),
            (("topic", "info", "r1/cmd_vel"), "leaves out messages of a plain Zenoh client on r1/cmd_vel"),
            (("doctor",), "leaves out messages of a plain Zenoh client on r1/cmd_vel"),
        ):
            told = run_robo(*command, "--connect", robot.endpoint).stdout
            assert words in told, told
        more_odometry(robot, 50)
    finally:
        leave.set()
        stranger.join()
    assert driven(robot.messages("odom")) == 0.0
