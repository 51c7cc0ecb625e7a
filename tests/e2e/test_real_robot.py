"""real_robot.yaml with its board played: everything runs but the metal, and whatever happens to the board."""

import math
import os
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from robo.testing import Launch, Robot
from robo_messages import JointState, Odometry, Trigger
from robo_services.drives import DiffDrive
from robo_services.kinematics import Twist2

SPEED, TURN = 0.3, 0.2
"""m/s, and what the demonstration turns with, rad/s."""
DRIVE = DiffDrive(wheel_separation=0.3, wheel_radius=0.05)
BUSY = 0.3
"""A machine that is busy is late by up to this, s."""


def driving(launch: Launch, folder: Path, **options: Any) -> Robot:
    robot = launch(
        "real_robot.yaml", emulate=True, laser=False, demo="arc", port=str(folder / "board"), speed=SPEED, **options
    )
    drives(robot)
    return robot


def drives(robot: Robot) -> None:
    robot.wait_for("odom", lambda odometry: odometry.twist.twist.linear.x > 0.9 * SPEED, new=True)


def stands(robot: Robot) -> JointState:
    """Wait until the wheels truly stand."""
    found: JointState = robot.wait_for("true_wheels", lambda state: max(map(abs, state.velocity)) == 0.0, new=True)
    return found


def rates_of_wheels(robot: Robot) -> list[float]:
    """How fast the wheels truly turn over the next three seconds, rad/s."""
    robot.clear()
    wheels: list[JointState] = robot.wait_for_count("true_wheels", 90)
    first, last = wheels[0], wheels[-1]
    elapsed = last.header.stamp.to_seconds() - first.header.stamp.to_seconds()
    return [(after - before) / elapsed for before, after in zip(first.position, last.position, strict=True)]


def call(robot: Robot, service: str) -> None:
    robot.call(service, Trigger.Request())


def places(robot: Robot, topic: str) -> list[tuple[float, float, float]]:
    """Time, x and y."""
    messages: list[Odometry] = robot.messages(topic)
    return [(m.header.stamp.to_seconds(), m.pose.pose.position.x, m.pose.pose.position.y) for m in messages]


@pytest.mark.timeout(120)
def test_speeds_arrive_and_odometry_is_true(launch: Launch, tmp_path: Path) -> None:
    robot = driving(launch, tmp_path, options=["-p", "emulated_board.garbled:=0.01"])
    begun = time.time()
    wanted = DRIVE.wheels(Twist2(SPEED, TURN))[:2]
    rates: list[list[float]] = []
    # A machine that is busy holds a robot up now and then: one stretch without that is enough.
    while not rates or rates[-1] != pytest.approx(wanted, rel=0.02):
        assert len(rates) < 20, rates
        rates.append(rates_of_wheels(robot))
    robot.set("velocity_controller", linear_velocity=0.0, angular_velocity=0.0)
    stands(robot)
    truth = places(robot, "ground_truth")[-1]
    way = SPEED * (truth[0] - begun)

    def is_true(odometry: Odometry) -> bool:
        place = odometry.pose.pose.position
        return math.hypot(place.x - truth[1], place.y - truth[2]) < 0.01 * way

    robot.wait_for("odom", is_true, new=True)


@pytest.mark.timeout(120)
def test_whatever_happens_to_the_board(launch: Launch, tmp_path: Path) -> None:
    board = ["-p", "emulated_board.power_by_usb:=false"]  # else it is no watchdog that stops it
    robot = driving(launch, tmp_path, may_die=["serial_base"], options=board)
    call(robot, "unplug")
    unplugged = time.time()
    stood = stands(robot)
    assert stood.header.stamp.to_seconds() - unplugged < 0.3 + BUSY, "its own watchdog"
    robot.wait_for_line("stands by its own watchdog")
    call(robot, "replug")
    plugged = time.time()
    moved = robot.wait_for("true_wheels", lambda state: state.velocity[1] > 1.0, new=True)
    assert moved.header.stamp.to_seconds() - plugged < 1.0 + 2 * BUSY
    drives(robot)
    robot.clear()
    call(robot, "reset_board")
    robot.wait_for_line("the board has begun anew")
    drives(robot)
    track = places(robot, "odom")
    for before, after in pairwise(track):  # each has the time at which the board was heard, which may be late
        far = 0.02 + SPEED * (2 * (after[0] - before[0]) + BUSY)
        assert math.hypot(after[1] - before[1], after[2] - before[2]) < far, "a reset is no jump"
    robot.pause("serial_base")  # it hangs
    stands(robot)
    robot.resume("serial_base")
    drives(robot)
    robot.kill("serial_base")
    stands(robot)
    moved = robot.wait_for("true_wheels", lambda state: state.velocity[1] > 1.0, new=True)
    assert moved, "it was started again, and drives on"


def test_a_missing_extra_is_said_before_anything_starts(tmp_path: Path) -> None:
    """pyserial is hidden: a module of its name that is none stands before it."""
    (tmp_path / "sitecustomize.py").write_text("import sys; sys.modules['serial'] = None\n")
    path = os.pathsep.join(filter(None, [str(tmp_path), os.environ.get("PYTHONPATH")]))
    done = subprocess.run(
        [sys.executable, "-m", "robo", "up", "real_robot.yaml", "port:=/dev/ttyUSB7"],
        capture_output=True, text=True, timeout=60, check=False, cwd=tmp_path, env={**os.environ, "PYTHONPATH": path},
    )  # fmt: skip
    assert done.returncode == 1
    assert (
        "serial_base: needs the module serial, which is not installed: pip install 'robo-zenoh[serial]'" in done.stderr
    )
    assert "nothing is started" in done.stderr
