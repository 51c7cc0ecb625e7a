"""Robots as users start them: real processes, a terminal's signals, plain Zenoh clients."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgpack
import psutil
import pytest
import zenoh

from robo.wire.network import Network
from robo.wire.session import close_session, open_session
from tests.support import Inbox, eventually, robo, run_robo

pytestmark = pytest.mark.timeout(120)


@contextmanager
def client(endpoint: str) -> Iterator[zenoh.Session]:
    """A plain client, which waits for the robot's router."""
    session = open_session(Network(mode="client", connect=(endpoint,)))
    try:
        yield session
    finally:
        close_session(session)


def test_the_reference_robot_comes_alive_and_stops_cleanly(endpoint: str, tmp_path: Path) -> None:
    with robo("up", "--robot-name", "r1", "--listen", endpoint, cwd=str(tmp_path)) as robot, client(endpoint) as plain:
        topics = {
            "r1/cmd_vel": ("geometry/Twist", {"linear", "angular"}),
            "r1/odom": ("nav/Odometry", {"header", "child_frame_id", "pose", "twist"}),
            "r1/scan": ("sensor/LaserScan", {"header", "angle_min", "ranges", "range_max"}),
            "r1/current_position": ("geometry/Point", {"x", "y", "z"}),
        }
        inboxes = {key: Inbox(plain, key) for key in topics}
        robot.wait_for("r1 is ready: 4 nodes")
        for key, (type_name, fields) in topics.items():
            assert fields <= set(inboxes[key].wait_for(1)[0])
            assert str(inboxes[key].samples[0].encoding) == f"application/msgpack;{type_name}"
        inboxes["r1/current_position"].wait_until(lambda ms: ms[-1]["z"] > 0.1, "it drives")
        children = robot.children()
        assert len(children) == 7  # four nodes, the router, the template of both, and the watchdog
        robot.interrupt()
        assert robot.wait() == 130
        assert "SIGKILL" not in robot.output, "all have ended by themselves"
        assert not [p for p in children if p.is_running() and p.status() != psutil.STATUS_ZOMBIE]
        assert "Traceback" not in robot.output
        assert "safety_monitor" in robot.output


def test_a_real_log_is_tracked_to_the_millimetre(endpoint: str, intel_log: Path) -> None:
    words = ("up", "replay.yaml", f"log:={intel_log}", "rate:=0", "--robot-name", "r1", "--listen", endpoint)
    with robo(*words) as replay, client(endpoint) as plain:
        positions, odometry = Inbox(plain, "r1/current_position"), Inbox(plain, "r1/odom")
        assert replay.wait(60) == 0
        for inbox in (positions, odometry):
            inbox.wait_for(13_700)
        last = positions.messages[-1]
        assert last["z"] == pytest.approx(534.082, abs=0.01)
        assert (last["x"], last["y"]) == pytest.approx((-0.322783, -0.0967671))
        assert len(positions.messages) == len(odometry.messages) == 13_700
        assert "played 13700 odometry and 910 laser records" in replay.output
        assert "skipped 841 odometry records of time 0" in replay.output


def test_the_log_that_ships_is_played_without_any_argument(endpoint: str) -> None:
    result = run_robo("up", "replay.yaml", "rate:=0", "delay:=0", "--listen", endpoint)
    assert result.returncode == 0, result.stdout
    assert "played 320 odometry and 160 laser records" in result.stdout


def test_a_damaged_log_is_played_as_far_as_it_goes(endpoint: str, tmp_path: Path) -> None:
    log = tmp_path / "my.log"
    good = [f"ODOM {i} 0 0 0.5 0 0 {100 + i * 0.1} host {i}" for i in range(100)]
    log.write_text("\n".join([*good[:50], "ODOM 1 2", "FLASER 3 1 x", *good[50:]])[:-4])
    result = run_robo("up", "replay.yaml", f"log:={log}", "rate:=0", "delay:=0", "--listen", endpoint)
    assert result.returncode == 0, result.stdout
    assert "played 99 odometry and 0 laser records" in result.stdout
    assert "line 51 is skipped: ODOM takes 9 values, this line has 2" in result.stdout
    assert "skipped 3 malformed lines: 51-52, 102" in result.stdout
    assert "distance 98.000 m" in result.stdout


def test_two_robots_share_a_network_and_either_may_leave(endpoint: str) -> None:
    with robo("up", "--robot-name", "r1", "--listen", endpoint) as first:
        first.wait_for("r1 is ready")
        with robo("up", "--robot-name", "r2", "--listen", endpoint) as second, client(endpoint) as plain:
            second.wait_for("r2 is ready")
            one, two = Inbox(plain, "r1/odom"), Inbox(plain, "r2/odom")
            one.wait_for(3)
            two.wait_for(3)
            first.interrupt()
            assert first.wait() == 130
            two.forget()
            two.wait_for(3)  # through the second robot's router, which has taken the port over
            result = run_robo("topic", "list", "--connect", endpoint)
            assert "r2/odom" in result.stdout
            assert "r1/scan" not in result.stdout
            assert second.process.poll() is None
            assert "Traceback" not in second.output


def test_a_killed_controller_leaves_a_robot_that_others_can_drive(endpoint: str) -> None:
    with robo("up", "--robot-name", "r1", "--listen", endpoint) as robot, client(endpoint) as plain:
        odometry = Inbox(plain, "r1/odom")
        robot.wait_for("r1 is ready")
        robot.child("velocity_controller").kill()
        robot.wait_for("velocity_controller was killed by SIGKILL")
        odometry.wait_until(lambda ms: _speed(ms[-1]) == 0.0, "it stands without commands")
        before = odometry.messages[-1]["pose"]["pose"]["position"]

        def moved() -> bool:
            plain.put("r1/cmd_vel_raw", '{"linear": {"x": 0.3}}')
            here = odometry.messages[-1]["pose"]["pose"]["position"]
            return bool(abs(here["x"] - before["x"]) + abs(here["y"] - before["y"]) > 0.05)

        eventually(moved, "JSON commands move it")
        for key in ("r1/odom", "r1/scan", "r1/cmd_vel_raw", "r1/cmd_vel"):
            for _ in range(50):
                plain.put(key, b"\xc1garbage")
        robot.wait_for("dropped a malformed message on r1/cmd_vel ")
        eventually(moved, "it still obeys")
        lines = [line for line in robot.output.splitlines() if "malformed message on r1/cmd_vel " in line]
        assert len(lines) == 1
        robot.interrupt()
        assert robot.wait() == 130


def _speed(odometry: dict[str, Any]) -> float:
    x: float = odometry["twist"]["twist"]["linear"]["x"]
    return abs(x)


def test_a_killed_base_makes_the_monitor_stop(endpoint: str) -> None:
    with robo("up", "--robot-name", "r1", "--listen", endpoint) as robot, client(endpoint) as plain:
        commands = Inbox(plain, "r1/cmd_vel")
        robot.wait_for("r1 is ready")
        commands.wait_until(lambda ms: ms[-1]["linear"]["x"] > 0.4, "it drives")
        robot.child("diff_drive_sim").kill()
        commands.forget()
        commands.wait_until(lambda ms: ms[-1]["linear"]["x"] == 0.0, "it is told to stop")


def test_the_router_comes_back_and_data_flow_on(endpoint: str) -> None:
    with robo("up", "--robot-name", "r1", "--listen", endpoint) as robot, client(endpoint) as plain:
        positions = Inbox(plain, "r1/current_position")
        robot.wait_for("r1 is ready")
        positions.wait_for(1)
        robot.child("robo.process.router").kill()
        robot.wait_for("starting it again")
        positions.forget()
        positions.wait_for(3)


def test_a_node_that_cannot_start_is_named_again_at_the_end(endpoint: str, tmp_path: Path) -> None:
    manifest = tmp_path / "m.yaml"
    manifest.write_text(
        "groups:\n  g:\n    nodes:\n"
        "      player: {service: robo_services.carmen_player, params: {log: nowhere.log}}\n"
        "      after: {service: robo_services.position_tracker, needs: {player: ready}}\n"
    )
    result = run_robo("up", str(manifest), "--listen", endpoint)
    assert result.returncode == 1
    assert "after is not started: it needs player" in result.stdout
    assert "player failed: exit code 1" in result.stdout
    assert "nowhere.log" in result.stdout
    assert "Traceback" not in result.stdout + result.stderr


def test_a_robot_of_the_same_name_is_refused(endpoint: str) -> None:
    with robo("up", "--robot-name", "r1", "--listen", endpoint) as robot:
        robot.wait_for("r1 is ready")
        second = run_robo("up", "--robot-name", "r1", "--listen", endpoint)
        assert second.returncode == 1
        assert "r1 runs already (process " in second.stdout
        assert "safety_monitor" not in second.stdout  # not even for a moment
        assert robot.process.poll() is None


def test_one_node_alone(endpoint: str) -> None:
    words = (
        "run",
        "robo_services.position_tracker",
        "--robot-name",
        "r1",
        "-p",
        "log_rate:=20",
        "-r",
        "odom:=robot/odom",
    )
    with robo(*words, "--listen", endpoint) as node, client(endpoint) as plain:
        positions = Inbox(plain, "r1/current_position")

        def answered() -> bool:
            plain.put("r1/robot/odom", msgpack.packb({"pose": {"pose": {"position": {"x": 1.0}}}}))
            return bool(positions.messages)

        node.wait_for(f"runs as /r1/position_tracker, at {endpoint}; Ctrl-C stops")
        eventually(answered, "it tracks")
        node.wait_for("position (1.000, 0.000)")
        assert not node.children()
        node.interrupt()
        assert node.wait() == 0


DAEMON = """\
import os, sys, time
if os.fork() == 0:
    os.setsid()
    if os.fork() == 0:
        open(sys.argv[1], "w").write(str(os.getpid()))
        time.sleep(600)
    os._exit(0)
print("started", flush=True)
time.sleep(600)
"""


@pytest.mark.parametrize("killed", [True, False])
def test_nothing_outlives_the_launch(killed: bool, endpoint: str, tmp_path: Path) -> None:
    """Neither nodes nor what daemonised itself, not even after kill -9 of the supervisor."""
    (tmp_path / "daemon.py").write_text(DAEMON)
    (tmp_path / "m.yaml").write_text(
        "groups:\n  g:\n    nodes:\n"
        "      tracker: {service: robo_services.position_tracker}\n"
        f"      daemon: {{run: [python, {tmp_path}/daemon.py, {tmp_path}/pid], ready: {{log: started}}}}\n"
    )
    with robo("up", "m.yaml", "--listen", endpoint, cwd=str(tmp_path)) as launch:
        launch.wait_for("is ready: 2 nodes")
        eventually(lambda: (tmp_path / "pid").exists() and (tmp_path / "pid").read_text() != "", "the daemon runs")
        processes = [*launch.children(), psutil.Process(int((tmp_path / "pid").read_text()))]
        if killed:
            launch.process.send_signal(signal.SIGKILL)
        else:
            launch.interrupt()
            assert launch.wait() == 130
            assert "which a node had left behind" in launch.output
        _, alive = psutil.wait_procs(processes, timeout=40)
        assert not [p for p in alive if p.status() != psutil.STATUS_ZOMBIE]
