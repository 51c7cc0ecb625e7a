"""Parameters and services of a running robot, as `robo param` and `robo service` show them."""

import json
import time
from pathlib import Path
from typing import Any

import pytest
import yaml

from robo.testing import Launch
from tests.support import PATIENCE, robo, run_robo

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
twist_mux:
  ros__parameters:
    topics:
      autonomy: {topic: cmd_vel_nav, priority: 10}
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


def test_parameters_of_a_running_robot(launch: Launch, tmp_path: Path) -> None:
    (tmp_path / "classic.yaml").write_text(ROS_FILE)
    robot = launch("robot.yaml", demo="arc", folder=tmp_path, params_file="classic.yaml")
    endpoint = robot.endpoint
    listed = json.loads(ask(endpoint, "param", "list", "--json"))
    assert listed["/r1/velocity_controller"]["linear_velocity"] == 0.25
    assert listed["/r1/position_tracker"]["log_rate"] == 5.0
    assert listed["/r1/safety_monitor"]["min_distance"] == 0.2

    robot.wait_for("cmd_vel_raw")
    assert "linear_velocity = -0.1" in ask(
        endpoint, "param", "set", "/r1/velocity_controller", "linear_velocity", "-0.1"
    )
    robot.wait_for("cmd_vel_raw", lambda twist: twist.linear.x == pytest.approx(-0.1), new=True)

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
    again = launch("robot.yaml", demo="arc", folder=tmp_path, params_file="dump.yaml")
    assert ask(again.endpoint, "param", "dump", "--all") == dumped.read_text()


def test_changes_are_watched(launch: Launch) -> None:
    endpoint = launch("robot.yaml", "control", demo="arc").endpoint
    with robo("param", "watch", "--json", "--connect", endpoint) as watch:
        for _ in range(200):  # until it watches
            rate = f"{10 + time.monotonic() % 1:.6f}"
            ask(endpoint, "param", "set", "velocity_controller", "publish_rate", rate)
            if watch.output:
                break
        change: dict[str, Any] = json.loads(watch.output.splitlines()[0])
        assert (change["node"], change["name"]) == ("/r1/velocity_controller", "publish_rate")


def test_a_node_that_hangs_is_named(launch: Launch, tmp_path: Path) -> None:
    (tmp_path / "m.yaml").write_text(
        "groups:\n  g:\n    namespace: r1\n    nodes:\n"
        "      safety_monitor: {service: robo_services.safety_monitor, watchdog: 0}\n"
        "      velocity_controller: {service: robo_services.velocity_controller}\n"
    )
    robot = launch(tmp_path / "m.yaml")
    endpoint = robot.endpoint
    robot.pause("safety_monitor")
    begin = time.monotonic()
    error = refused(endpoint, "param", "get", "safety_monitor", "rate", "--timeout", "0.5")
    # After 2 s Zenoh takes a process that hangs for gone.
    assert "/r1/safety_monitor did not answer within 0.5 s" in error or "there is no node safety_monitor" in error
    listed = run_robo("param", "list", "--connect", endpoint)
    assert "/r1/velocity_controller" in listed.stdout
    assert "/r1/safety_monitor did not answer" in listed.stderr or "/r1/safety_monitor" not in listed.stdout
    assert time.monotonic() - begin < PATIENCE


def test_services_of_a_running_robot(launch: Launch) -> None:
    robot = launch("robot.yaml", demo="arc")
    endpoint = robot.endpoint
    listed = [json.loads(line) for line in ask(endpoint, "service", "list", "--json").splitlines()]
    assert {one["key"] for one in listed} == {
        "r1/emergency_stop", "r1/reset_emergency_stop", "r1/reset", "r1/reset_distance",
    }  # fmt: skip
    assert ask(endpoint, "service", "type", "r1/reset").strip() == "std/Trigger"
    assert "std/Trigger_Request {}" in ask(endpoint, "service", "info", "r1/reset")
    assert json.loads(ask(endpoint, "service", "call", "r1/emergency_stop", "--json"))["success"]
    robot.wait_for_line("stop: emergency stop, until reset_emergency_stop is called")
    robot.clear()
    assert all(twist.linear.x == 0 for twist in robot.wait_for_count("cmd_vel", 20))
    ask(endpoint, "service", "call", "r1/reset_emergency_stop")
    robot.wait_for("cmd_vel", lambda twist: twist.linear.x > 0.1, new=True)
    assert "success: True" in ask(endpoint, "service", "call", "r1/reset_distance")
    assert "success: True" in ask(endpoint, "service", "call", "r1/reset")
    assert "has no field 'x'" in refused(endpoint, "service", "call", "r1/reset", "{x: 1}")
    assert "did you mean r1/reset?" in refused(endpoint, "service", "call", "r1/rest")
    assert "a request is a map" in refused(endpoint, "service", "call", "r1/reset", "7")
    robot.pause("position_tracker")
    slow = refused(endpoint, "service", "call", "r1/reset_distance", "--timeout", "0.3")
    # After 2 s Zenoh takes a process that hangs for gone.
    gone = ("nobody serves r1/reset_distance", "r1/reset_distance: its server went away")
    assert any(text in slow for text in ("r1/reset_distance did not answer within 0.3 s", *gone)), slow
