"""A part of the robot fails at full speed: its wheels stand in time, and somebody says why.

What each fault asks for, of a base that drives 1 m/s ahead: whoever commands, or lets the robot see, is killed, stopped
or cut off from the network.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest

from robo.testing import Launch, Robot
from robo.testing.heard import Heard
from robo.wire.network import Network
from robo.wire.session import close_session, open_session
from robo_messages import Odometry
from tests.support import PATIENCE, eventually, robo

pytestmark = pytest.mark.timeout(120)

SPEED = 1.0
"""m/s."""
CMD_VEL_TIMEOUT = 0.5
"""Of the base, s."""
ALLOWED = CMD_VEL_TIMEOUT + 0.2
"""From a fault to wheels that stand, s."""
SLACK = 0.3
"""What a busy machine may take to carry the fault out, and to give nodes their turns, s."""

WORLD = "walls:\n  - [-5, -20, 400, -20]\n  - [-5, 20, 400, 20]\n  - [-5, -20, -5, 20]\n"
FAST = [
    *("-p", f"velocity_controller.linear_velocity:={SPEED}", "-p", "velocity_controller.angular_velocity:=0.0"),
    *("-p", "position_tracker.max_distance:=1000"),
]


@pytest.fixture
def robot(launch: Launch, tmp_path: Path) -> Robot:
    (tmp_path / "wide.yaml").write_text(WORLD)
    started = launch("robot.yaml", demo="arc", world=str(tmp_path / "wide.yaml"), options=FAST)
    started.wait_for("odom", lambda odometry: odometry.twist.twist.linear.x > 0.98 * SPEED)
    return started


@contextmanager
def odometry(endpoint: str) -> Iterator[Heard]:
    """What a client of a router hears of it."""
    session = open_session(Network(mode="client", connect=(endpoint,)))
    try:
        yield Heard(session, "r1/odom")
    finally:
        close_session(session)


def is_alive(process: psutil.Process) -> bool:
    return process.is_running() and process.status() != psutil.STATUS_ZOMBIE


def kill(robot: Robot, node: str) -> None:
    robot.kill(node)


def stop(robot: Robot, node: str) -> None:
    robot.pause(node)


def cut(robot: Robot, node: str) -> None:
    robot.cut(node)


def stood(robot: Robot, begin: float) -> float | None:
    """How long after `begin` the wheels stood first, s, by the base's own stamps; None where they have not yet."""
    messages: list[Odometry] = robot.messages("odom")
    for message in messages:
        sent = message.header.stamp.to_nanoseconds() * 1e-9
        if sent >= begin and message.twist.twist.linear.x == 0.0:
            return sent - begin
    return None


def says(robot: Robot, topic: str, text: str) -> bool:
    """Whether a state has said so."""
    return any(text in state.message for state in robot.messages(topic))


@pytest.mark.parametrize("fault", [kill, stop, cut])
@pytest.mark.parametrize(
    ("node", "topic", "reason"),
    [
        ("velocity_controller", "mux_state", "nobody commands"),
        ("twist_mux", "safety_state", "the last command is "),
        ("velocity_smoother", "safety_state", "the last command is "),
        ("safety_monitor", "", "safety_monitor"),
        ("diff_drive_sim", "safety_state", "the last laser scan is "),
    ],
)
def test_the_wheels_stand_in_time(
    robot: Robot, node: str, topic: str, reason: str, fault: Callable[[Robot, str], None]
) -> None:
    robot.clear()
    begin = time.time()
    fault(robot, node)
    if node == "diff_drive_sim":  # whose wheels are its own; cut off or stopped it is for others to see
        robot.wait_for("cmd_vel", lambda twist: twist.linear.x == 0.0)
    else:
        eventually(lambda: stood(robot, begin) is not None, "the base stands")
        assert (stood(robot, begin) or 0.0) <= ALLOWED + SLACK
    if fault is kill:  # it may be back before anybody misses its word
        robot.wait_for_line(f"{node} was killed by SIGKILL")
        return
    if topic:
        eventually(lambda: says(robot, topic, reason), f"{topic} says why")
    else:
        robot.wait_for_line(f"{reason} ")
    (robot.resume if fault is stop else robot.mend)(node)


def test_a_base_that_was_cut_off_stands_by_itself(robot: Robot) -> None:
    robot.clear()
    begin = time.time()
    robot.cut("diff_drive_sim")
    robot.wait_for("cmd_vel", lambda twist: twist.linear.x == 0.0)
    time.sleep(max(0.0, begin + ALLOWED + SLACK - time.time()))  # nothing comes from it that could be awaited
    robot.clear()
    robot.mend("diff_drive_sim")
    first = robot.wait_for("odom", lambda _: True)
    assert first.twist.twist.linear.x < SPEED / 2, "it has stood, or is just starting again"


def test_a_laser_that_falls_silent_stops_it(robot: Robot) -> None:
    robot.clear()
    begin = time.time()
    robot.set("diff_drive_sim", laser=False)
    eventually(lambda: stood(robot, begin) is not None, "the base stands")
    assert (stood(robot, begin) or 0.0) <= ALLOWED + SLACK
    eventually(lambda: says(robot, "safety_state", "the last laser scan is "), "the state says why")


def test_a_killed_router_needs_no_stop_and_a_killed_supervisor_ends_all(endpoint: str, tmp_path: Path) -> None:
    """Nodes of one host are linked directly. Without their supervisor they are no robot any more."""
    (tmp_path / "wide.yaml").write_text(WORLD)
    words = ("up", "robot.yaml", "demo:=arc", f"world:={tmp_path}/wide.yaml", *FAST, "--robot-name", "r1")
    with robo(*words, "--listen", endpoint) as run:
        run.wait_for("r1 is ready")
        with odometry(endpoint) as heard:
            heard.wait_for("r1/odom", lambda one: one.twist.twist.linear.x > 0.98 * SPEED, PATIENCE)
        begin = time.time_ns()
        run.child("robo.process.router").kill()
        run.wait_for("starting it again")
        with odometry(endpoint) as heard:
            heard.wait_for("r1/odom", lambda one: one.header.stamp.to_nanoseconds() > begin, PATIENCE)
            assert {one.twist.twist.linear.x > 0.9 * SPEED for one in heard.messages("r1/odom")} == {True}
        nodes = [child for child in run.children() if "robo.process.node" in child.cmdline()]
        assert len(nodes) == 6
        run.process.kill()
        killed = time.monotonic()
        eventually(lambda: not any(map(is_alive, nodes)), "nobody is left who could drive")
        assert time.monotonic() - killed <= ALLOWED + SLACK
