"""What must never move a robot, tried on the reference robot with processes that are killed and paused."""

import math
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from typing import Any

import msgpack
import psutil
import pytest
import zenoh

from robo.wire.network import Network
from robo.wire.session import close_session, open_session
from tests.support import Command, Inbox, eventually, robo, run_robo

COMMAND_TIMEOUT = 0.5
"""Of the base and of the monitor: `cmd_vel_timeout` and `command_timeout`, s."""
SPEED = 0.5
"""m/s."""
BRAKING = SPEED**2 / (2 * 5.0)
"""With the base's deceleration, m."""
SLACK = 0.03
"""Two steps of the base and the way of a command, m."""


class Robot:
    """The reference robot, and a plain client that records its odometry."""

    def __init__(self, command: Command, session: zenoh.Session, endpoint: str) -> None:
        self.command = command
        self.session = session
        self.endpoint = endpoint
        self.odometry = Inbox(session, "r1/odom")
        self.state = Inbox(session, "r1/safety_state")

    def process(self, node: str) -> psutil.Process:
        return self.command.child(f"robo_services.{node}")

    def speed(self) -> float:
        return speed_of(self.odometry.messages[-1])

    def drives(self) -> None:
        self.odometry.forget()
        self.odometry.wait_until(lambda ms: speed_of(ms[-1]) > 0.9 * SPEED, "it drives")

    def stands(self) -> None:
        self.odometry.wait_until(lambda ms: speed_of(ms[-1]) == 0.0, "it stands")

    def call(self, service: str) -> str:
        for reply in self.session.get(f"r1/{service}", payload=msgpack.packb({}), timeout=5.0):
            if reply.ok is not None:
                return str(msgpack.unpackb(reply.ok.payload.to_bytes())["message"])
        raise AssertionError(f"{service} did not answer")

    def wait_for_state(self, condition: Callable[[dict[str, str]], bool], what: str, timeout: float = 15.0) -> None:
        self.state.wait_until(lambda ms: condition({v["key"]: v["value"] for v in ms[-1]["values"]}), what, timeout)


def speed_of(odometry: dict[str, Any]) -> float:
    return math.hypot(odometry["twist"]["twist"]["linear"]["x"], odometry["twist"]["twist"]["linear"]["y"])


def sent(odometry: dict[str, Any]) -> float:
    stamp: dict[str, int] = odometry["header"]["stamp"]
    return stamp["sec"] + stamp["nanosec"] * 1e-9


def driven(messages: list[dict[str, Any]]) -> float:
    """The length of the way, m."""
    places = [m["pose"]["pose"]["position"] for m in messages]
    return sum(math.hypot(b["x"] - a["x"], b["y"] - a["y"]) for a, b in pairwise(places))


@contextmanager
def driving_robot(endpoint: str, *more: str) -> Iterator[Robot]:
    with robo("up", "--robot-name", "r1", "--listen", endpoint, *more) as command:
        command.wait_for("is ready")
        session = open_session(Network(mode="client", connect=(endpoint,)))
        try:
            robot = Robot(command, session, endpoint)
            robot.drives()
            yield robot
        finally:
            close_session(session)


@contextmanager
def paused(*processes: psutil.Process) -> Iterator[None]:
    for process in processes:
        process.suspend()
    try:
        yield
    finally:
        for process in processes:
            process.resume()


def kill(robot: Robot) -> None:
    robot.process("safety_monitor").kill()


def segfault(robot: Robot) -> None:
    robot.process("safety_monitor").send_signal(signal.SIGSEGV)


def restart(robot: Robot) -> None:
    robo_command("restart", "safety_monitor", robot)


def restart_group(robot: Robot) -> None:
    robo_command("restart", "control", robot)


def hang(robot: Robot) -> None:
    robot.process("safety_monitor").suspend()


def robo_command(verb: str, name: str, robot: Robot) -> None:
    with robo(verb, name, "--robot-name", "r1", "--connect", robot.endpoint) as command:
        assert command.wait(30) == 0, command.output


@pytest.mark.parametrize("end", [kill, segfault, restart, restart_group, hang])
def test_an_emergency_stop_outlives_the_monitor(endpoint: str, end: Callable[[Robot], None]) -> None:
    with driving_robot(endpoint) as robot:
        robot.call("emergency_stop")
        robot.stands()
        before = robot.process("safety_monitor").pid
        robot.odometry.forget()
        robot.state.forget()
        end(robot)
        robot.wait_for_state(lambda s: s["reason"] == "emergency_stop", "the next monitor knows of it", 40)
        eventually(lambda: robot.process("safety_monitor").pid != before, "it is another process")
        # The controller drives at once where it is let; two more seconds show that it is not.
        seen = len(robot.odometry.messages)
        robot.odometry.wait_for(seen + 100)
        assert driven(robot.odometry.messages) == 0.0
        assert "released" in robot.call("reset_emergency_stop")
        robot.drives()


def test_commands_that_waited_in_a_paused_monitor_are_old(endpoint: str) -> None:
    for pause in (0.6, 1.0, 2.0):
        with driving_robot(endpoint) as robot:
            monitor = robot.process("safety_monitor")
            with paused(monitor):
                time.sleep(pause / 2)  # commands pile up
                robot.process("velocity_controller").kill()
                time.sleep(pause / 2)
                robot.odometry.forget()
            robot.wait_for_state(lambda s: s["action"] == "stop", "it says that it stops")
            robot.odometry.wait_for(75)  # it may stand at first and then obey what it finds
            robot.stands()
            # What the controller said last was said half the pause before.
            allowed = max(0.0, COMMAND_TIMEOUT - pause / 2) * SPEED + BRAKING + SLACK
            assert driven(robot.odometry.messages) <= allowed


def test_commands_that_waited_in_a_paused_base_are_old(endpoint: str) -> None:
    for pause in (0.3, 1.0, 2.0):
        with driving_robot(endpoint) as robot:
            base, monitor = robot.process("diff_drive_sim"), robot.process("safety_monitor")
            controller = robot.process("velocity_controller")
            with paused(base):
                time.sleep(0.15)  # commands pile up; without a scan for longer the monitor would stop
                with paused(monitor, controller):
                    time.sleep(pause)
                    robot.odometry.forget()
                    resumed = time.time()
                    base.resume()
                    robot.odometry.wait_for(75)  # it may stand at first and then obey what it finds
                    robot.stands()
                    allowed = max(0.0, COMMAND_TIMEOUT - pause) * SPEED + BRAKING + SLACK
                    # The first odometry after the pause has the motion of the pause itself.
                    after = [m for m in robot.odometry.messages if sent(m) >= resumed]
                    assert driven(after) <= allowed, [(sent(m) - resumed, speed_of(m)) for m in after]


def test_timeouts_of_monitor_and_base_do_not_add_up(endpoint: str) -> None:
    with driving_robot(endpoint) as robot:
        monitor, controller = robot.process("safety_monitor"), robot.process("velocity_controller")
        robot.odometry.forget()
        controller.kill()
        time.sleep(0.4)
        with paused(monitor):
            robot.stands()
            assert driven(robot.odometry.messages) <= COMMAND_TIMEOUT * SPEED + BRAKING + SLACK


@pytest.mark.parametrize("rate", [10, 200, 1000])
def test_a_stranger_moves_nothing_and_is_named(endpoint: str, rate: int) -> None:
    with driving_robot(endpoint) as robot:
        robot.call("emergency_stop")
        robot.stands()
        robot.odometry.forget()
        robot.state.forget()
        leave = threading.Event()
        payload = msgpack.packb({"linear": {"x": SPEED}})

        def drive() -> None:
            while not leave.wait(1.0 / rate):
                robot.session.put("r1/cmd_vel", payload)

        stranger = threading.Thread(target=drive)
        stranger.start()
        try:
            robot.wait_for_state(lambda s: s.get("rival") == "a plain Zenoh client", "the state names it")
            robot.command.wait_for("left out messages of a plain Zenoh client on r1/cmd_vel")
            for command, words in (
                (("why", "diff_drive_sim"), "leaves out messages of a plain Zenoh client on r1/cmd_vel"),
                (("topic", "info", "r1/cmd_vel"), "leaves out messages of a plain Zenoh client on r1/cmd_vel"),
                (("doctor",), "leaves out messages of a plain Zenoh client on r1/cmd_vel"),
            ):
                told = run_robo(*command, "--connect", endpoint).stdout
                assert words in told, told
            robot.odometry.wait_for(len(robot.odometry.messages) + 50)
        finally:
            leave.set()
            stranger.join()
        assert driven(robot.odometry.messages) == 0.0
