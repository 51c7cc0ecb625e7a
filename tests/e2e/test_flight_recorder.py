"""The flight recorder of the reference robot, whose nodes are killed while it drives."""

import json
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from robo import bag
from robo.bag.mcap.scan import index_of
from robo.bag.mcap.source import Source
from robo.bag.read.reader import Bag
from robo.errors import BagError
from robo.testing import Launch, Robot
from robo_messages import TakeSnapshot
from tests.support import Running, eventually, plain_environment, run_robo

pytestmark = pytest.mark.timeout(180)

SECOND = 1_000_000_000


def folders_within(folder: Path) -> list[str]:
    """The options by which a flight recorder keeps all that it writes in a folder."""
    return ["-p", f"flight_recorder.folder:={folder}", "-p", f"flight_recorder.ring_folder:={folder / 'ring'}"]


def recorded(
    launch: Launch, folder: Path, manifest: str = "robot.yaml", may_die: Sequence[str] = (), **more: Any
) -> Robot:
    """The reference robot with a flight recorder, once it drives."""
    options = folders_within(folder)
    robot = launch(manifest, demo="arc", flight_recorder=True, may_die=may_die, options=options, **more)
    robot.wait_for("odom", lambda odometry: odometry.twist.twist.linear.x > 0.4, new=True)
    return robot


def with_override(folder: Path, override: str) -> Path:
    """A manifest of the reference robot that says something else of a node."""
    path = folder / "other.yaml"
    path.write_text(
        f"include:\n  file: robot.yaml\n  args: {{demo: arc, flight_recorder: true}}\n  override: {{{override}}}\n"
    )
    return path


def drive_for(robot: Robot, seconds: float) -> None:
    """Wait until so much has been said of where it is, at 50 Hz."""
    robot.wait_for_count("odom", len(robot.messages("odom")) + round(50 * seconds), timeout=10 * seconds)


def with_one_that_stays_dead(launch: Launch, folder: Path) -> Robot:
    """The reference robot with a flight recorder that is not started again."""
    manifest = with_override(folder, "flight_recorder: {restart: never}")
    return launch(manifest, may_die=["flight_recorder"], options=folders_within(folder))


def kept(ring: Path) -> int:
    """Messages that are left if the recorder is killed now."""
    count = 0
    for path in ring.rglob("*.mcap"):
        with suppress(BagError, OSError), Source(path) as source:  # it is just being begun
            count += sum(index_of(source).counts.values())
    return count


def only_file(folder: Path) -> Path:
    eventually(lambda: len(list(folder.glob("*.mcap"))) > 0, "a file")
    (found,) = folder.glob("*.mcap")
    return found


def ask(robot: Robot) -> Bag:
    answer = robot.call("flight_recorder/snapshot", TakeSnapshot.Request("test"), timeout=30.0)
    assert answer.success, answer.message
    return bag.open(answer.snapshot.file)


def test_the_kill_of_the_safety_monitor_is_in_a_file_that_why_names(launch: Launch, tmp_path: Path) -> None:
    robot = recorded(launch, tmp_path, may_die=["safety_monitor"])
    drive_for(robot, 12.0)
    killed = time.time_ns()
    robot.kill("safety_monitor")
    path = only_file(tmp_path)
    # 3 s where nothing else runs: benchmarks/FLIGHT_RECORDER.md
    assert path.stat().st_mtime_ns - killed < 10 * SECOND
    assert path.name.startswith("r1_")
    assert path.name.endswith("_safety_monitor_died.mcap")
    with bag.open(path) as found:
        assert found.faults == []
        assert found.begin < killed - 10 * SECOND
        assert found.end > killed + SECOND
        odometry = found.times("r1/odom")
        assert sum(1 for at in odometry if at < killed) > 400, "of 50 a second, on a machine that may be busy"
        assert found.topics["r1/safety_state"].qos.latched
        logs = found.attachment("logs.txt").decode()
        assert "robo: WARN safety_monitor was killed by SIGKILL" in logs
        assert "safety_monitor: INFO clear" in logs
        assert found.attachment("why.txt").decode().startswith("/r1/safety_monitor is ")
        assert "killed by SIGKILL" in found.attachment("why.txt").decode()
        states = {one["node"]: one for one in json.loads(found.attachment("processes.json"))}
        assert states["/r1/safety_monitor"]["restarts"] == 1
        assert states["/r1/diff_drive_sim"]["state"] == "ready"
        parameters = found.attachment("parameters.yaml").decode()
        assert parameters.index("/r1/safety_monitor") < parameters.index("min_distance")
        assert b'"alarm":"died"' in found.attachment("events.jsonl")
    robot.wait_for_line(f"wrote {path}")
    why = run_robo("why", "safety_monitor", "--robot-name", "r1", "--connect", robot.endpoint)
    assert str(path) in why.stdout
    other = run_robo("why", "twist_mux", "--robot-name", "r1", "--connect", robot.endpoint)
    assert str(path) not in other.stdout


def test_the_ring_outlives_the_recorder(launch: Launch, tmp_path: Path) -> None:
    robot = recorded(launch, tmp_path, may_die=["flight_recorder"])
    drive_for(robot, 4.0)
    killed = time.time_ns()
    before = robot.process("flight_recorder").pid
    robot.kill("flight_recorder")
    robot.wait_until("flight_recorder", lambda one: one.pid not in (None, before) and one.state == "ready")
    drive_for(robot, 1.0)
    with ask(robot) as found:
        times = found.times("r1/odom")
        assert sum(1 for at in times if at < killed - SECOND) > 50
        assert sum(1 for at in times if at > killed) > 10
        assert [message.value for message in found.messages("r1/tf_static")]


def test_a_recorder_that_is_killed_before_it_has_written_is_replaced_by_one_that_does(
    launch: Launch, tmp_path: Path
) -> None:
    robot = recorded(launch, tmp_path, may_die=["flight_recorder", "position_tracker"])
    eventually(lambda: kept(tmp_path / "ring") > 200, "what a kill leaves")
    robot.kill("position_tracker")
    robot.kill("flight_recorder")
    path = only_file(tmp_path)
    assert path.name.endswith("_position_tracker_died.mcap")
    with bag.open(path) as found:
        assert sum(1 for _ in found.times("r1/odom")) > 20
        assert "position_tracker was killed by SIGKILL" in found.attachment("logs.txt").decode()


def test_what_ends_a_run_is_in_a_file_that_why_names_when_the_run_is_over(
    launch: Launch, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    options = ["-p", f"flight_recorder.ring_folder:={tmp_path / 'ring'}"]
    manifest = with_override(tmp_path, "position_tracker: {required: true, restart: never}")
    robot = launch(manifest, may_die=["position_tracker"], options=options)
    drive_for(robot, 1.0)
    robot.kill("position_tracker")
    assert robot.wait_until_over() == 1
    path = Path(robot.wait_for_line("wrote ").partition("wrote ")[2].partition(".mcap")[0] + ".mcap")
    assert path.name.endswith("_position_tracker_died.mcap")
    with bag.open(path) as found:
        assert found.count > 50
        assert "position_tracker was killed by SIGKILL" in found.attachment("logs.txt").decode()
    assert not list((tmp_path / "ring").rglob("*.mcap")), "nothing else is left"
    monkeypatch.setenv("ROBO_LOG_DIR", str(path.parents[2]))
    why = run_robo("why", "position_tracker", "--robot-name", "r1", "--connect", robot.endpoint)
    assert why.returncode == 0, why.stderr
    assert f": {path}" in why.stdout
    assert "position_tracker was killed by SIGKILL" in why.stdout


def test_a_run_that_is_killed_leaves_its_last_seconds_to_the_next_one(launch: Launch, tmp_path: Path) -> None:
    robot = with_one_that_stays_dead(launch, tmp_path)
    drive_for(robot, 4.0)
    robot.kill("flight_recorder")
    assert run_robo("down", "--robot-name", "r1", "--connect", robot.endpoint).returncode == 0
    robot.wait_until_over()
    assert list((tmp_path / "ring").rglob("*.mcap"))
    recorded(launch, tmp_path)
    path = only_file(tmp_path)
    assert path.name.endswith("_run_ended.mcap")
    with bag.open(path) as found:
        assert found.topic("r1/odom").count > 50


@contextmanager
def asked(robot: Robot) -> Iterator[Running]:
    """`robo bag snapshot`, once it waits for a file."""
    command = [sys.executable, "-m", "robo", "bag", "snapshot", "--connect", robot.endpoint]
    with closing(Running(command, env=plain_environment(), terminal=True)) as tool:
        tool.wait_for("/r1/flight_recorder records a few seconds more")
        drive_for(robot, 0.3)
        yield tool


def test_a_tool_that_is_held_up_gets_its_file_all_the_same(launch: Launch, tmp_path: Path) -> None:
    """Its link to the robot is cut after 2 s, and with it the question."""
    robot = recorded(launch, tmp_path)
    with asked(robot) as tool:
        tool.process.send_signal(signal.SIGSTOP)
        drive_for(robot, 3.0)
        tool.process.send_signal(signal.SIGCONT)
        assert tool.wait() == 0, tool.output
        assert Path(tool.wait_for("_asked.mcap")).is_file()


def test_a_recorder_that_dies_meanwhile_is_told(launch: Launch, tmp_path: Path) -> None:
    robot = with_one_that_stays_dead(launch, tmp_path)
    drive_for(robot, 1.0)
    with asked(robot) as tool:
        robot.kill("flight_recorder")
        assert tool.wait() == 1
        tool.wait_for("error: /r1/flight_recorder has gone, and has not told of a file")


def test_robo_bag_snapshot(launch: Launch, tmp_path: Path) -> None:
    robot = recorded(launch, tmp_path)
    done = run_robo("bag", "snapshot", "--reason", "it turned left", "--connect", robot.endpoint)
    assert done.returncode == 0, done.stderr
    path = Path(done.stdout.strip())
    assert path.name.endswith("_it_turned_left.mcap")
    assert path.is_file()
    done = run_robo("bag", "snapshot", "--json", "--robot-name", "r1", "--connect", robot.endpoint)
    told = json.loads(done.stdout)
    assert Path(told["file"]).stat().st_size == told["size"]
    done = run_robo("bag", "snapshot", "--robot-name", "r2", "--connect", robot.endpoint)
    assert done.returncode == 1
    assert "robot r2 has no flight recorder; there is /r1/flight_recorder" in done.stderr
    assert "robo_services.flight_recorder" in done.stderr
