"""Parameters and services of a running robot, as `robo param` and `robo service` show them."""

import json
import signal
import time
from pathlib import Path
from typing import Any

import pytest
import yaml

from robo.wire.network import Network
from robo.wire.session import close_session, open_session
from tests.support import PATIENCE, Inbox, robo, run_robo

pytestmark = pytest.mark.timeout(120)

ROS_FILE = """\
/**:
  ros__parameters:
    log_rate: 5.0
velocity_controller:
  ros__parameters:
    linear_velocity: 0.25
    angular_velocity: 0.0
    publish_rate: 20.0
safety_monitor:
  ros__parameters:
    min_distance: 0.2
"""


def ask(endpoint: str, *words: str) -> str:
    result = run_robo(*words, "--connect", endpoint)
    assert result.returncode == 0, result.stdout + result.stderr
    assert "Traceback" not in result.stderr
    return result.stdout


def refused(endpoint: str, *words: str) -> str:
    result = run_robo(*words, "--connect", endpoint)
    assert result.returncode in (1, 2)
    assert "Traceback" not in result.stderr
    return result.stderr


def test_parameters_of_a_running_robot(endpoint: str, tmp_path: Path) -> None:
    (tmp_path / "classic.yaml").write_text(ROS_FILE)
    words = ("up", "--robot-name", "r1", "--listen", endpoint)
    with robo(*words, "params_file:=classic.yaml", cwd=str(tmp_path)) as robot:
        robot.wait_for("r1 is ready")
        listed = json.loads(ask(endpoint, "param", "list", "--json"))
        assert listed["/r1/velocity_controller"]["linear_velocity"] == 0.25
        assert listed["/r1/position_tracker"]["log_rate"] == 5.0
        assert listed["/r1/safety_monitor"]["min_distance"] == 0.2

        session = open_session(Network(mode="client", connect=(endpoint,)))
        commands = Inbox(session, "r1/cmd_vel_raw")
        commands.wait_for(1)
        assert "linear_velocity = -0.1" in ask(
            endpoint, "param", "set", "/r1/velocity_controller", "linear_velocity", "-0.1"
        )
        commands.wait_until(lambda ms: ms[-1]["linear"]["x"] == pytest.approx(-0.1), "the command follows")
        close_session(session)

        error = refused(endpoint, "param", "set", "velocity_controller", "linear_velocity", "99")
        assert "linear_velocity = 99: expected float <= 5.0 (forward velocity, m/s; -5 to 5)" in error
        several = ("linear_velocity:=0.3", "angular_velocity:=99")
        assert "angular_velocity = 99" in refused(endpoint, "param", "set", "velocity_controller", *several)
        assert ask(endpoint, "param", "get", "velocity_controller", "linear_velocity").strip() == "-0.1"
        assert "world is read-only" in refused(endpoint, "param", "set", "diff_drive_sim", "world", "x.yaml")
        assert "did you mean position_tracker?" in refused(endpoint, "param", "get", "position_traker", "x")
        assert "did you mean log_rate?" in refused(endpoint, "param", "get", "position_tracker", "log_rte")

        explained = ask(endpoint, "param", "explain", "velocity_controller", "linear_velocity")
        assert [line.split()[-1] for line in explained.splitlines()[1:]] == ["default", "classic.yaml:6:5", "running"]
        described = json.loads(ask(endpoint, "param", "describe", "velocity_controller", "publish_rate", "--json"))
        assert described[0]["unit"] == "Hz"

        (tmp_path / "more.yaml").write_text("velocity_controller: {linear_velocity: 0.1, publish_rate: 30}\n")
        loaded = ask(endpoint, "param", "load", "velocity_controller", str(tmp_path / "more.yaml"))
        assert "linear_velocity = 0.1" in loaded
        assert "publish_rate = 30.0" in loaded
        dumped = tmp_path / "dump.yaml"
        ask(endpoint, "param", "dump", "--all", "-o", str(dumped))
        tree = yaml.safe_load(dumped.read_text())
        assert tree["/r1/velocity_controller"]["ros__parameters"]["linear_velocity"] == 0.1
        robot.interrupt()
        robot.wait()
    with robo(*words, "params_file:=dump.yaml", cwd=str(tmp_path)) as robot:
        robot.wait_for("r1 is ready")
        assert ask(endpoint, "param", "dump", "--all") == dumped.read_text()


def test_changes_are_watched(endpoint: str) -> None:
    with robo("up", "robot.yaml", "control", "--robot-name", "r1", "--listen", endpoint) as robot:
        robot.wait_for("r1 is ready")
        with robo("param", "watch", "--json", "--connect", endpoint) as watch:
            for _ in range(200):  # until it watches
                rate = f"{10 + time.monotonic() % 1:.6f}"
                ask(endpoint, "param", "set", "velocity_controller", "publish_rate", rate)
                if watch.output:
                    break
            change: dict[str, Any] = json.loads(watch.output.splitlines()[0])
            assert (change["node"], change["name"]) == ("/r1/velocity_controller", "publish_rate")


def test_a_node_that_hangs_is_named(endpoint: str, tmp_path: Path) -> None:
    (tmp_path / "m.yaml").write_text(
        "groups:\n  g:\n    namespace: r1\n    nodes:\n"
        "      safety_monitor: {service: robo_services.safety_monitor, watchdog: 0}\n"
        "      velocity_controller: {service: robo_services.velocity_controller}\n"
    )
    with robo("up", str(tmp_path / "m.yaml"), "--robot-name", "r1", "--listen", endpoint) as robot:
        robot.wait_for("r1 is ready")
        robot.child("/r1/safety_monitor").send_signal(signal.SIGSTOP)
        begin = time.monotonic()
        error = refused(endpoint, "param", "get", "safety_monitor", "rate")
        # After 2 s Zenoh takes a process that hangs for gone.
        assert "/r1/safety_monitor did not answer within 0.5 s" in error or "there is no node safety_monitor" in error
        listed = run_robo("param", "list", "--connect", endpoint)
        assert "/r1/velocity_controller" in listed.stdout
        assert "/r1/safety_monitor did not answer" in listed.stderr or "/r1/safety_monitor" not in listed.stdout
        assert time.monotonic() - begin < PATIENCE
        robot.child("/r1/safety_monitor").send_signal(signal.SIGCONT)


def test_services_of_a_running_robot(endpoint: str) -> None:
    with robo("up", "--robot-name", "r1", "--listen", endpoint) as robot:
        robot.wait_for("r1 is ready")
        listed = [json.loads(line) for line in ask(endpoint, "service", "list", "--json").splitlines()]
        assert {one["key"] for one in listed} == {
            "r1/emergency_stop", "r1/reset_emergency_stop", "r1/reset", "r1/reset_distance",
        }  # fmt: skip
        assert ask(endpoint, "service", "type", "r1/reset").strip() == "std/Trigger"
        assert "std/Trigger_Request {}" in ask(endpoint, "service", "info", "r1/reset")
        assert json.loads(ask(endpoint, "service", "call", "r1/emergency_stop", "--json"))["success"]
        robot.wait_for("stop: emergency stop, until reset_emergency_stop is called")
        session = open_session(Network(mode="client", connect=(endpoint,)))
        commands = Inbox(session, "r1/cmd_vel")
        assert all(m["linear"]["x"] == 0 for m in commands.wait_for(20))
        ask(endpoint, "service", "call", "r1/reset_emergency_stop")
        commands.forget()
        commands.wait_until(lambda ms: ms[-1]["linear"]["x"] > 0.1, "it drives again")
        close_session(session)
        assert "success: True" in ask(endpoint, "service", "call", "r1/reset_distance")
        assert "success: True" in ask(endpoint, "service", "call", "r1/reset")
        assert "has no field 'x'" in refused(endpoint, "service", "call", "r1/reset", "{x: 1}")
        assert "did you mean r1/reset?" in refused(endpoint, "service", "call", "r1/rest")
        assert "a request is a map" in refused(endpoint, "service", "call", "r1/reset", "7")
        robot.child("/r1/position_tracker").send_signal(signal.SIGSTOP)
        slow = refused(endpoint, "service", "call", "r1/reset_distance", "--timeout", "0.3")
        # After 2 s Zenoh takes a process that hangs for gone.
        gone = ("nobody serves r1/reset_distance", "r1/reset_distance: its server went away")
        assert any(text in slow for text in ("r1/reset_distance did not answer within 0.3 s", *gone)), slow
        robot.child("/r1/position_tracker").send_signal(signal.SIGCONT)
