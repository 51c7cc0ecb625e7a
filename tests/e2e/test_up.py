"""Robots as users start them: real processes, a terminal's signals, plain Zenoh clients."""

import re
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgpack
import psutil
import pytest
import zenoh

from robo.testing import Launch, Robot
from robo.wire.network import Network
from robo.wire.session import close_session, open_session
from tests.plain import hear, samples, sent
from tests.support import eventually, robo, run_robo

pytestmark = pytest.mark.timeout(120)


@contextmanager
def client(endpoint: str) -> Iterator[zenoh.Session]:
    """A plain client, which waits for the robot's router."""
    session = open_session(Network(mode="client", connect=(endpoint,)))
    try:
        yield session
    finally:
        close_session(session)


@pytest.fixture(scope="module")
def standing(module_launch: Launch) -> Robot:
    """The reference robot, for tests that only look."""
    return module_launch("robot.yaml", demo="arc")


def test_the_reference_robot_comes_alive_and_stops_cleanly(endpoint: str, tmp_path: Path) -> None:
    with robo("up", "--robot-name", "r1", "--listen", endpoint, cwd=str(tmp_path)) as robot:
        robot.wait_for("r1 is ready: 6 nodes")
        children = robot.children()
        assert len(children) == 9  # six nodes, the router, the template of both, and the watchdog
        robot.interrupt()
        assert robot.wait() == 130
        assert "SIGKILL" not in robot.output, "all have ended by themselves"
        assert not [p for p in children if p.is_running() and p.status() != psutil.STATUS_ZOMBIE]
        assert "Traceback" not in robot.output
        assert "safety_monitor" in robot.output


@pytest.mark.parametrize(
    ("topic", "type_name", "fields"),
    [
        ("cmd_vel", "geometry/Twist", {"linear", "angular"}),
        ("odom", "nav/Odometry", {"header", "child_frame_id", "pose", "twist"}),
        ("scan", "sensor/LaserScan", {"header", "angle_min", "ranges", "range_max"}),
        ("current_position", "geometry/Point", {"x", "y", "z"}),
    ],
)
def test_a_plain_client_reads_what_a_robot_says(standing: Robot, topic: str, type_name: str, fields: set[str]) -> None:
    heard = hear(standing.session, f"r1/{topic}")
    (sample,) = samples(heard)
    heard.undeclare()
    assert fields <= set(msgpack.unpackb(sample.payload.to_bytes()))
    assert str(sample.encoding) == f"application/msgpack;{type_name}"
    standing.wait_for("current_position", lambda position: position.z > 0.1)  # it drives


def test_a_real_log_is_tracked_to_the_millimetre(launch: Launch, intel_log: Path) -> None:
    replay = launch("replay.yaml", log=intel_log, rate=250)  # at full speed a listener on a busy machine may miss some
    assert replay.wait_until_over(60.0) == 0
    positions, odometry = (replay.wait_for_count(topic, 13_700) for topic in ("current_position", "odom"))
    last = positions[-1]
    assert last.z == pytest.approx(534.082, abs=0.01)
    assert (last.x, last.y) == pytest.approx((-0.322783, -0.0967671))
    assert len(positions) == len(odometry) == 13_700
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
            one, two = hear(plain, "r1/odom"), hear(plain, "r2/odom")
            samples(one, 3)
            samples(two, 3)
            first.interrupt()
            assert first.wait() == 130
            begin = time.time_ns()
            eventually(lambda: sent(samples(two)[0]) > begin, "it comes through the second robot's router")
            samples(two, 3)
            result = run_robo("topic", "list", "--connect", endpoint)
            assert "r2/odom" in result.stdout
            assert "r1/scan" not in result.stdout
            assert second.process.poll() is None
            assert "Traceback" not in second.output


def test_a_killed_controller_leaves_a_robot_that_others_can_drive(launch: Launch) -> None:
    robot = launch("robot.yaml", demo="arc")
    robot.kill("velocity_controller")
    robot.wait_for_line("velocity_controller was killed by SIGKILL")
    before = robot.wait_for("odom", lambda odometry: odometry.twist.twist.linear.x == 0.0, new=True).pose.pose.position

    def moved() -> bool:
        robot.session.put("r1/cmd_vel_key", '{"linear": {"x": 0.3}}')
        here = robot.messages("odom")[-1].pose.pose.position
        return bool(abs(here.x - before.x) + abs(here.y - before.y) > 0.05)

    robot.clear()
    robot.wait_for("odom")
    eventually(moved, "JSON commands move it")
    for key in ("r1/odom", "r1/scan", "r1/cmd_vel_key", "r1/cmd_vel_raw", "r1/cmd_vel"):
        for _ in range(50):
            robot.session.put(key, b"\xc1garbage")
    robot.wait_for_line("dropped a malformed message on r1/cmd_vel ")
    robot.clear()
    before = robot.wait_for("odom").pose.pose.position
    eventually(moved, "it still obeys")
    lines = [line for line in robot.output.splitlines() if "malformed message on r1/cmd_vel " in line]
    assert len(lines) == 1


def test_a_killed_base_makes_the_monitor_stop(launch: Launch) -> None:
    robot = launch("robot.yaml", demo="arc")
    robot.wait_for("cmd_vel", lambda twist: twist.linear.x > 0.4)
    robot.kill("diff_drive_sim")
    robot.clear()
    robot.wait_for("cmd_vel", lambda twist: twist.linear.x == 0.0)


def test_the_router_comes_back_and_data_flow_on(endpoint: str) -> None:
    with robo("up", "--robot-name", "r1", "--listen", endpoint) as robot, client(endpoint) as plain:
        positions = hear(plain, "r1/current_position")
        robot.wait_for("r1 is ready")
        samples(positions)
        robot.child("robo.process.router").kill()
        robot.wait_for("starting it again")
        begin = time.time_ns()
        eventually(lambda: sent(samples(positions)[0]) > begin, "it comes through the router that was started again")
        samples(positions, 3)


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
        positions = hear(plain, "r1/current_position")

        def answered() -> bool:
            plain.put("r1/robot/odom", msgpack.packb({"pose": {"pose": {"position": {"x": 1.0}}}}))
            return positions.try_recv() is not None

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
            assert re.search(r"ended process \d+, which daemon had left behind: .*daemon.py", launch.output)
        _, alive = psutil.wait_procs(processes, timeout=40)
        assert not [p for p in alive if p.status() != psutil.STATUS_ZOMBIE]
