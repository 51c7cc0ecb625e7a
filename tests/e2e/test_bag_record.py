"""`robo bag record`: a robot that runs, into a file that others open; however it ends, the file is whole or mended."""

import json
import shlex
import signal
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from robo import bag
from robo.bag.look.inspection import FATAL, Kind
from robo.testing import Launch, Robot
from tests import bags
from tests.support import Running, eventually, plain_environment, robo, run_robo

COMPRESSION = "zstd" if bags.readable("zstd") else "none"


@pytest.fixture(scope="module")
def robot(module_launch: Launch) -> Robot:
    """The reference robot, driving."""
    return module_launch("robot.yaml", demo="arc")


@contextmanager
def recording(robot: Robot, path: Path, *words: str) -> Iterator[Running]:
    """`robo bag record`, from when it has written something."""
    with robo(
        "bag", "record", *words, "-o", str(path), "--compression", COMPRESSION, "--connect", robot.endpoint
    ) as command:
        command.wait_for("recording")
        eventually(lambda: path.exists() and path.stat().st_size > 60_000, "it has written something")
        yield command


def counts(path: Path) -> dict[str, int]:
    with bag.open(path) as opened:
        return {topic.name: topic.count for topic in opened.topics.values()}


def test_a_robot_is_recorded_until_ctrl_c(robot: Robot, tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    with recording(robot, path, "--all", "--robot-name", "r1") as command:
        command.interrupt()
        assert command.wait() == 0, command.output
    assert "0     0" in command.wait_for("r1/odom")
    assert "lost" not in command.wait_for(f"{path}: ")
    found = counts(path)
    assert found["r1/odom"] > 10
    assert found["r1/scan"] > 2
    assert found["r1/tf_static"] >= 1
    assert found["r1/tf"] > 10
    assert not any(name.startswith("@") for name in found)
    with bag.open(path) as opened:
        first = next(iter(opened.messages()))
        assert first.topic.qos.latched
        assert opened.metadata["robo.about"]["robots"] == "r1"
        assert b"/r1/diff_drive_sim" in opened.attachment("parameters.yaml")
    _others_read_the_same(path)


def _others_read_the_same(path: Path) -> None:
    """Where they are installed: every message is read, and has the values that robo reads."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of its own parts
        rosbags: Any = pytest.importorskip("rosbags.highlevel", reason="rosbags is not installed")
    with bag.open(path) as opened:
        ours: Any = [one.value for one in opened.messages("r1/odom")]
        total = opened.count
    with rosbags.AnyReader([path]) as reader:
        theirs = [(one.topic, reader.deserialize(data, one.msgtype)) for one, _, data in reader.messages()]
    assert len(theirs) == total
    odometry = [value for topic, value in theirs if topic == "/r1/odom"]
    assert [one.pose.pose.position.x for one in odometry] == [one.pose.pose.position.x for one in ours]
    reading = pytest.importorskip("mcap.reader", reason="mcap is not installed")
    decoding = pytest.importorskip("mcap_ros2.decoder", reason="mcap-ros2-support is not installed")
    with path.open("rb") as file:
        found = list(reading.make_reader(file, decoder_factories=[decoding.DecoderFactory()]).iter_decoded_messages())
    assert len(found) == total
    poses = [one.decoded_message.pose.pose.position.x for one in found if one.channel.topic == "/r1/odom"]
    assert poses == [one.pose.pose.position.x for one in ours]


def test_sigterm_ends_it_too_and_what_never_came_is_told(robot: Robot, tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    with recording(robot, path, "odom", "scan", "odum", "--robot-name", "r1") as command:
        command.wait_for("nothing has come on r1/odum yet: nobody publishes it so far; did you mean r1/odom?")
        for number in (signal.SIGHUP, signal.SIGTERM, signal.SIGTERM):  # as where a terminal is closed
            command.process.send_signal(number)
        assert command.wait() == 1, command.output
    command.wait_for("nothing came on r1/odum")
    assert set(counts(path)) == {"r1/odom", "r1/scan", "r1/tf_static", "r1/tf"}  # nobody tells tf what is not recorded
    assert all(one.kind is Kind.HOLE for one in bag.check(path).findings)  # of a machine that is busy


def test_one_that_is_killed_is_mended(robot: Robot, tmp_path: Path) -> None:
    path, whole = tmp_path / "cut.mcap", tmp_path / "whole.mcap"
    with recording(robot, path, "--all") as command:
        command.process.kill()
        command.wait()
    recovered = bag.recover(path, whole)
    assert all(fault.cut for fault in recovered.faults)
    assert counts(whole)["r1/odom"] > 10
    assert not any(one.kind in FATAL for one in bag.check(whole).findings)


def test_for_programs_there_is_an_object(robot: Robot, tmp_path: Path) -> None:
    path = tmp_path / "run"
    words = f"bag record r1/odom r1/scan --duration 3 --split-duration 1 --json --compression {COMPRESSION}"
    result = run_robo(*shlex.split(words), "-o", str(path), "--connect", robot.endpoint)
    assert result.returncode == 0, result.stderr
    said = json.loads(result.stdout)
    assert [Path(file).name for file in said["files"]] == sorted(file.name for file in path.glob("*.mcap"))
    assert len(said["files"]) > 1
    odometry = next(topic for topic in said["topics"] if topic["topic"] == "r1/odom")
    assert odometry["received"] == counts(path)["r1/odom"]
    assert (odometry["lost"], odometry["malformed"], said["missing"]) == (0, 0, [])


def test_on_a_terminal_it_is_seen_while_it_goes_on(robot: Robot, tmp_path: Path) -> None:
    words = ["bag", "record", "r1/odom", "--no-tf", "--compression", "none", "--connect", robot.endpoint]
    environment = plain_environment() | {"TERM": "xterm", "COLUMNS": "120", "LINES": "30"}
    command = Running([sys.executable, "-m", "robo", *words], cwd=str(tmp_path), env=environment, terminal=True)
    try:
        command.wait_for("MALFORMED")
        command.wait_for("nav_msgs/msg/Odometry")
        command.interrupt()
        assert command.wait() == 0, command.output
    finally:
        command.close()
    (path,) = tmp_path.glob("robo_*.mcap")  # a name of date and time
    assert list(counts(path)) == ["r1/odom"]


def test_mistakes_are_said_in_a_line(robot: Robot, tmp_path: Path) -> None:
    (tmp_path / "there.mcap").touch()
    at = ["--connect", robot.endpoint]
    for words, code, text in (
        ("bag record", 2, "say which topics are to be recorded"),
        ("bag record -a r1/odom", 2, "--all has r1/odom too"),
        ("bag record -a --split-size 5x", 2, "use a size such as 500MB"),
        ("bag record -a --keep 3", 2, "say what splits them"),
        ("bag record '@robo/**'", 2, "is no topic"),
        ("bag record -a --max-bag-size 100", 2, "--split-size"),
        ("bag record -a --max-cache-size 100", 2, "up to 256 MB wait"),
        ("bag record odom --exclude odom", 2, "all that is asked for is excluded"),
        (f"bag record -a -o {tmp_path}/there.mcap --compression none", 1, "it is there already"),
        (f"bag record -a -o {tmp_path}/a.mcap --compression none --least-free 900TB --duration 20", 1, "the disk has"),
    ):
        result = run_robo(*shlex.split(words), *at, cwd=str(tmp_path))
        assert (result.returncode, "Traceback" in result.stderr) == (code, False), (words, result.stderr)
        assert text in result.stderr, (words, result.stderr)
    assert counts(tmp_path / "a.mcap") is not None  # whole
