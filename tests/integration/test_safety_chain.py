"""The reference robot's control chain as nodes of one process: time and obstacles are the test's."""

import math
from itertools import pairwise

import msgpack
import pytest
import zenoh

from robo.wire.discovery import wait_for_nodes
from robo_services import safety_monitor
from robo_services.diff_drive_sim import DiffDriveSim
from robo_services.safety_monitor import SafetyMonitor
from robo_services.velocity_controller import VelocityController
from tests.support import Inbox, eventually


def speed(message: dict[str, dict[str, float]]) -> float:
    return math.hypot(message["linear"]["x"], message["linear"]["y"])


def scan(ahead: float) -> bytes:
    ranges = [math.inf] * 360
    ranges[180] = ahead
    payload: bytes = msgpack.packb(
        {"angle_min": -math.pi, "angle_increment": math.tau / 360, "range_max": 10.0, "ranges": ranges}
    )
    return payload


def test_the_controller_ramps_up_and_leaves_a_standing_robot(session: zenoh.Session, other: zenoh.Session) -> None:
    inbox = Inbox(other, "r1/cmd_vel")
    with VelocityController(namespace="r1", parameters={"publish_rate": 100, "linear_velocity": 0.2}, session=session):
        inbox.wait_until(lambda ms: len(ms) > 3 and speed(ms[-1]) == 0.2, "full speed")
        speeds = [speed(m) for m in inbox.messages]
        assert all(b - a <= 0.01 + 1e-9 for a, b in pairwise(speeds))
        assert inbox.messages[-1]["angular"]["z"] == 0.2
    inbox.wait_until(lambda ms: speed(ms[-1]) == 0.0, "a last zero")


def test_the_monitor_passes_slows_stops_and_fails_closed(session: zenoh.Session, other: zenoh.Session) -> None:
    with SafetyMonitor(namespace="r1", parameters={"scan_timeout": 0.3, "command_timeout": 0.3}, session=session):
        out, state = Inbox(other, "r1/cmd_vel"), Inbox(other, "r1/safety_state")
        assert not wait_for_nodes(other, ["/r1/safety_monitor"], 40)

        def feed(ahead: float | None, x: float | None = 0.4) -> None:
            if ahead is not None:
                other.put("r1/scan", scan(ahead))
            if x is not None:
                other.put("r1/cmd_vel_raw", msgpack.packb({"linear": {"x": x}}))

        def reaches(wanted: float, ahead: float | None, x: float | None = 0.4) -> None:
            out.forget()

            def there() -> bool:
                feed(ahead, x)
                return bool(out.samples) and abs(speed(out.messages[-1]) - wanted) < 1e-6

            eventually(there, f"{wanted} m/s with {ahead} m ahead and {x} m/s commanded")

        state.wait_until(lambda ms: "no laser scan so far" in ms[-1]["message"], "it says why it stands")
        assert speed(out.wait_for(1)[-1]) == 0.0
        reaches(0.4, 5.0)
        reaches(0.2, 0.4)
        reaches(0.0, 0.2)
        reaches(0.4, 5.0)
        reaches(0.0, 5.0, math.nan)
        state.wait_until(lambda ms: ms[-1]["values"][1]["value"] == "invalid_command", "it names the NaN")
        reaches(0.4, 5.0)
        reaches(0.0, None)  # the laser has died
        state.wait_until(lambda ms: ms[-1]["values"][1]["value"] == "stale_scan", "it names the laser")
        reaches(0.4, 5.0)
        reaches(0.0, 5.0, None)  # whoever commands has died
        state.wait_until(lambda ms: ms[-1]["values"][1]["value"] == "stale_command", "it names the silence")


def test_a_monitor_that_gets_no_scan_says_what_may_be_done(
    session: zenoh.Session, other: zenoh.Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(safety_monitor, "PATIENCE", 0.1)
    log = Inbox(other, "r1/log")
    with SafetyMonitor(namespace="r1", session=session):
        log.wait_until(
            lambda ms: any("still no laser scan on r1/scan" in m["msg"] for m in ms), "where, and what may be done"
        )


def test_a_base_without_a_laser_drives_and_obeys_the_emergency_stop(
    session: zenoh.Session, other: zenoh.Session
) -> None:
    with SafetyMonitor(namespace="r1", parameters={"laser": False}, session=session):
        out = Inbox(other, "r1/cmd_vel")

        def reaches(wanted: float) -> None:
            out.forget()

            def there() -> bool:
                other.put("r1/cmd_vel_raw", msgpack.packb({"linear": {"x": 0.4}}))
                return bool(out.samples) and speed(out.messages[-1]) == wanted

            eventually(there, f"{wanted} m/s without any scan")

        reaches(0.4)
        assert list(other.get("r1/emergency_stop"))
        reaches(0.0)


def test_the_simulated_robot_stops_before_a_wall(
    session: zenoh.Session, other: zenoh.Session, tmp_path: object
) -> None:
    wall = f"{tmp_path}/wall.yaml"
    with open(wall, "w", encoding="utf-8") as file:
        file.write("walls: [[1.2, -2, 1.2, 2]]\n")
    # So slow that a thread that waits for a busy processor does not bring it nearer than it may come.
    straight = {"linear_velocity": 0.2, "angular_velocity": 0.0, "publish_rate": 20.0}
    odometry, state = Inbox(other, "r1/odom"), Inbox(other, "r1/safety_state")
    with (
        DiffDriveSim(namespace="r1", parameters={"world": wall, "x": 0.4}, session=session),
        SafetyMonitor(namespace="r1", session=session),
        VelocityController(namespace="r1", parameters=straight, remappings={"cmd_vel": "cmd_vel_raw"}, session=session),
    ):

        def stands_at_the_wall() -> bool:
            last = odometry.messages[-1] if odometry.samples else None
            sees = bool(state.messages) and state.messages[-1]["values"][1]["value"] == "obstacle"
            return last is not None and sees and speed(last["twist"]["twist"]) == 0.0

        eventually(stands_at_the_wall, "it has stopped")
        x = odometry.messages[-1]["pose"]["pose"]["position"]["x"]
        # The laser is 0.3 m or more away from the wall, and so the base of radius 0.2 m does not touch it.
        assert 0.7 < x <= 1.2 - 0.29


def test_the_robot_stops_when_its_laser_dies(session: zenoh.Session, other: zenoh.Session) -> None:
    odometry = Inbox(other, "r1/odom")
    elsewhere = {"odom": "~/odom"}
    laser = DiffDriveSim(namespace="r1", name="laser", remappings=elsewhere, session=session)
    with (
        DiffDriveSim(namespace="r1", name="base", parameters={"laser": False}, session=session),
        SafetyMonitor(namespace="r1", session=session),
        VelocityController(namespace="r1", remappings={"cmd_vel": "cmd_vel_raw"}, session=session),
    ):
        laser.start()
        odometry.wait_until(lambda ms: bool(ms) and speed(ms[-1]["twist"]["twist"]) > 0.4, "it drives")
        laser.close()
        odometry.forget()
        odometry.wait_until(lambda ms: bool(ms) and speed(ms[-1]["twist"]["twist"]) == 0.0, "it stands")


def test_a_json_twist_from_a_plain_client_moves_the_robot(session: zenoh.Session, other: zenoh.Session) -> None:
    odometry = Inbox(other, "r1/odom")
    with DiffDriveSim(namespace="r1", session=session), SafetyMonitor(namespace="r1", session=session):
        state = Inbox(other, "r1/safety_state")
        state.wait_until(lambda ms: ms[-1]["values"][1]["value"] == "no_command", "the laser is seen")
        other.put("r1/cmd_vel_raw", '{"linear": {"x": 0.3}}', encoding="application/json")
        odometry.wait_until(lambda ms: ms[-1]["pose"]["pose"]["position"]["x"] > 0.05, "it has moved")
        odometry.wait_until(lambda ms: speed(ms[-1]["twist"]["twist"]) == 0.0, "it stands again")
