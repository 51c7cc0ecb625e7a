"""No value that a shipped node accepts ends one of its threads."""

import math
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh

from robo import Node, ParameterError
from robo.node.contract import contract_of
from robo.parameters.hints import ParameterInfo
from robo_services.bag_player import BagPlayer
from robo_services.calibrate_base import CalibrateBase
from robo_services.camera import Camera
from robo_services.carmen_player import CarmenPlayer
from robo_services.dashboard import Dashboard
from robo_services.diagnostic_aggregator import DiagnosticAggregator
from robo_services.diff_drive_controller import DiffDriveController
from robo_services.diff_drive_sim import DiffDriveSim
from robo_services.ekf_filter import EkfFilter
from robo_services.emulated_board import EmulatedBoard
from robo_services.emulated_lidar import EmulatedLidar
from robo_services.flight_recorder import FlightRecorder
from robo_services.joy import Joy
from robo_services.ld_lidar import LdLidar
from robo_services.mujoco_sim import MujocoSim
from robo_services.nmea_gps import NmeaGps
from robo_services.position_tracker import PositionTracker
from robo_services.recorder import Recorder
from robo_services.robot_state_publisher import RobotStatePublisher
from robo_services.safety_monitor import SafetyMonitor
from robo_services.serial_base import SerialBase
from robo_services.static_transform_publisher import StaticTransformPublisher
from robo_services.teleop_joy import TeleopJoy
from robo_services.teleop_keyboard import TeleopKeyboard
from robo_services.twist_mux import TwistMux
from robo_services.velocity_controller import VelocityController
from robo_services.velocity_smoother import VelocitySmoother
from robo_services.waypoint_follower import WaypointFollower
from tests import bags
from tests.support import eventually

SHIPPED = [
    BagPlayer,
    CalibrateBase,
    Camera,
    CarmenPlayer,
    Dashboard,
    DiagnosticAggregator,
    DiffDriveController,
    DiffDriveSim,
    EkfFilter,
    EmulatedBoard,
    EmulatedLidar,
    FlightRecorder,
    Joy,
    LdLidar,
    MujocoSim,
    NmeaGps,
    PositionTracker,
    Recorder,
    RobotStatePublisher,
    SafetyMonitor,
    SerialBase,
    StaticTransformPublisher,
    TeleopJoy,
    TeleopKeyboard,
    TwistMux,
    VelocityController,
    VelocitySmoother,
    WaypointFollower,
]

EXTRAS = {
    Camera: "av",
    Dashboard: "websockets",
    LdLidar: "serial",
    MujocoSim: "mujoco",
    NmeaGps: "pynmea2",
    SerialBase: "serial",
}
"""What nodes need that may not be installed."""


def ends(info: ParameterInfo) -> Iterator[float]:
    """The least and the largest value that a parameter's declaration lets through, and the nearest ones to 0."""
    limits = {key: float(value) for key, value in info.constraints.items() if key != "pattern"}
    whole = info.type == "int"
    yield limits.get("ge", math.nextafter(limits["gt"], math.inf) if "gt" in limits else -(2**63) if whole else -1e308)
    yield limits.get("le", math.nextafter(limits["lt"], 0) if "lt" in limits else 2**63 - 1 if whole else 1e308)
    if not whole:
        yield from (5e-324, 1e-300, 1e-12)


def ends_of(cls: type[Node], *, read_only: bool) -> list[tuple[ParameterInfo, float]]:
    numbers = [i for i in contract_of(cls).parameters if i.type in ("int", "float") and i.read_only == read_only]
    return [(info, int(value) if info.type == "int" else value) for info in numbers for value in ends(info)]


@pytest.fixture
def given(tmp_path: Path) -> Iterator[dict[type[Node], dict[str, object]]]:
    """What nodes need to run at all."""
    screen, terminal = os.openpty()
    pad = tmp_path / "pad"
    os.mkfifo(pad)
    (tmp_path / "log").write_text("ODOM 1 2 0 0 0 0 100.0 robot 0.1\nODOM 1 2 0 0 0 0 100.2 robot 0.2\n")
    bags.drive(tmp_path / "drive.mcap", count=10)
    yield {
        BagPlayer: {"file": str(tmp_path / "drive.mcap"), "delay": 3600},
        CarmenPlayer: {"log": str(tmp_path / "log"), "delay": 3600},
        FlightRecorder: {"folder": str(tmp_path / "files"), "ring_folder": str(tmp_path / "ring")},
        EmulatedLidar: {"port": str(tmp_path / "lidar")},
        EmulatedBoard: {"link": str(tmp_path / "board")},
        Joy: {"device": str(pad)},
        LdLidar: {"port": str(tmp_path / "none")},
        NmeaGps: {"port": str(tmp_path / "none")},
        Recorder: {"folder": str(tmp_path / "recordings"), "compression": "none"},
        RobotStatePublisher: {"robot_description": '<robot name="r"><link name="base_link"/></robot>'},
        SerialBase: {"port": str(tmp_path / "no_board")},
        TeleopKeyboard: {"terminal": os.ttyname(terminal)},
    }
    os.close(screen)
    os.close(terminal)


def runs(node: Node) -> None:
    """It runs callbacks, and none of them has raised."""
    ticked: list[bool] = []
    timer = node.create_timer(0.001, lambda: ticked.append(True))
    eventually(lambda: len(ticked) >= 2 or node.stopping, "callbacks run")
    timer.stop(0)
    assert (node.exit_code, node.status.callback_errors) == (0, 0)


@pytest.mark.parametrize("cls", SHIPPED)
def test_no_value_that_is_accepted_while_it_runs_ends_a_thread(
    robo_session: zenoh.Session, given: dict[type[Node], dict[str, object]], cls: type[Node]
) -> None:
    if module := EXTRAS.get(cls):
        pytest.importorskip(module, reason="an extra that is not installed")
    with cls(session=robo_session, parameters=given.get(cls)) as node:
        for info, value in ends_of(cls, read_only=False):
            try:
                node.set_parameters({info.name: value})
            except ParameterError:
                continue
            runs(node)
            node.set_parameters({info.name: info.default})
            runs(node)


@pytest.mark.parametrize("cls", SHIPPED)
def test_no_value_that_is_accepted_at_the_start_ends_a_thread(
    robo_session: zenoh.Session, given: dict[type[Node], dict[str, object]], cls: type[Node]
) -> None:
    if module := EXTRAS.get(cls):
        pytest.importorskip(module, reason="an extra that is not installed")
    for info, value in ends_of(cls, read_only=True):
        try:
            node = cls(session=robo_session, parameters={**given.get(cls, {}), info.name: value})
        except ParameterError:
            continue  # it is refused before anything runs
        with node:
            runs(node)
