"""Somebody types `robo bag play`, and presses keys while it goes on; the terminal is as it was afterwards."""

import json
import re
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest
import zenoh

import robo_messages
from robo import bag
from robo.bag.forms.from_carmen import Setting, from_carmen
from robo.bag.types import topic_of
from robo.interfaces import cdr
from robo.samples.publishing import Sender
from robo.testing import Launch
from robo_messages import LaserScan, String, Twist
from tests import bags
from tests.bags import MS, START
from tests.e2e.test_teleop import ALONE
from tests.plain import hear, samples
from tests.support import INTERRUPTED, PATIENCE, eventually, robo, run_robo
from tests.typist import Typist

pytestmark = pytest.mark.timeout(180)


def values(found: list[zenoh.Sample]) -> list[float]:
    return [robo_messages.decode(sample.payload.to_bytes(), Twist).linear.x for sample in found]


def commands(path: Path, count: int, chunk_size: int = 2**20) -> Path:
    """A command each 10 ms."""
    with bag.Recording(path, bag.Options(compression="none", sync=False, chunk_size=chunk_size)) as recording:
        number = recording.topic(topic_of("r1/cmd_vel", Twist))
        for at in range(count):
            recording.write(number, bags.twist(at), START + at * 10 * MS, START + at * 10 * MS, at + 1)
    return path


def damage(path: Path, chunk: int) -> int:
    """Change a byte of a chunk. Returns where that begins."""
    data = bytearray(path.read_bytes())
    chunks = [at for kind, at, _ in bags.records_of(bytes(data)) if kind == 6]
    data[chunks[chunk] + 200] ^= 0xFF
    path.write_bytes(data)
    return chunks[chunk]


def test_a_recording_is_played_and_told_of(session: zenoh.Session, endpoint: str, tmp_path: Path) -> None:
    path = commands(tmp_path / "drive.mcap", 20)
    heard = hear(session, "**")
    result = run_robo("bag", "play", str(path), "--connect", endpoint)
    assert result.returncode == 0, result.stderr
    assert "1 topic, 0.0 to 0.2 s; /r1/bag_player" in result.stdout
    assert "played 20 messages in 0." in result.stdout
    found = samples(heard, 20)
    assert {str(sample.key_expr) for sample in found} == {"r1/cmd_vel"}
    assert values(found) == list(range(20))


def test_in_json_lines(session: zenoh.Session, endpoint: str, tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    bags.drive(path)
    heard = hear(session, "r2/**")
    words = ["--json", "--robot-name", "r2", "--rate", "0", "--exclude", "tf_*", "--remap", "odom:=odom_before"]
    result = run_robo("bag", "play", str(path), "--connect", endpoint, *words)
    assert result.returncode == 0, result.stderr
    begin, end = map(json.loads, result.stdout.splitlines())
    assert begin["event"] == "begin"
    assert {one["key"] for one in begin["topics"]} == {"r2/cmd_vel", "r2/odom_before", "r2/scan"}
    assert end["complete"]
    assert end["topics"] == {"r2/cmd_vel": 100, "r2/odom_before": 10, "r2/scan": 10}
    assert len(samples(heard, 120)) == 120


@pytest.mark.parametrize(
    ("words", "code", "text"),
    [
        (["missing.mcap"], 1, "missing.mcap: "),
        (["empty.mcap"], 1, "it is empty: there is no topic in it"),
        (["text.mcap"], 1, "it is no MCAP file"),
        (["drive.mcap", "--topics", "odm"], 2, "--topics odm: no topic matches; did you mean"),
        (["drive.mcap", "--exclude", "**"], 2, "no topic is left"),
        (["drive.mcap", "--exclude", "odm"], 2, "--exclude odm: no topic matches; did you mean"),
        (["drive.mcap", "--remap", "odom"], 2, "write OLD:=NEW"),
        (["drive.mcap", "--start", "5"], 2, "nothing is there after --start 5: it begins "),
        (["drive.mcap", "--end", "soon"], 2, "--end 'soon' is no time: write seconds from the beginning"),
        (["drive.mcap", "--rate", "nan"], 2, "rate"),
        (["drive.mcap", "--rate", "1e-320"], 2, "1e-06 to 1e+06"),
        (["drive.mcap", "--delay", "nan"], 2, "--delay nan: use 0 to 86400 s"),
        (["drive.mcap", "--clock-rate", "nan"], 2, "use 0.1 to 1000 Hz"),
        (["drive.mcap", "--start", "0.5", "--end", "0.2"], 2, "--end 0.2 is not after --start 0.5"),
        (
            ["drive.mcap", "--topics", "odom", "--start", "0.51", "--end", "0.6"],
            1,
            "no message of r1/odom is between 0.51 and 0.6 s",
        ),
        (["damaged.mcap", "--order", "sent"], 1, "a chunk has another checksum"),
    ],
)
def test_a_mistake_is_told(
    session: zenoh.Session, endpoint: str, tmp_path: Path, words: list[str], code: int, text: str
) -> None:
    del session
    bags.drive(tmp_path / "drive.mcap")
    bag.Recording(tmp_path / "empty.mcap", bag.Options(compression="none", sync=False)).close()
    (tmp_path / "text.mcap").write_text("hello, this is no recording")
    damage(commands(tmp_path / "damaged.mcap", 200, chunk_size=4_000), chunk=2)
    result = run_robo("bag", "play", *words, "--connect", endpoint, cwd=str(tmp_path))
    assert (result.returncode, "Traceback" in result.stderr) == (code, False), result.stderr
    assert text in result.stderr


def test_it_waits_for_who_listens(session: zenoh.Session, endpoint: str, tmp_path: Path) -> None:
    path = commands(tmp_path / "drive.mcap", 20)
    with robo("bag", "play", str(path), "--wait-for-subscribers", "--rate", "0", "--connect", endpoint) as player:
        player.wait_for("playing")
        heard = hear(session, "r1/cmd_vel")
        assert player.wait() == 0
        assert "played 20 messages" in player.output
        assert values(samples(heard, 20)) == list(range(20))


def test_what_nodes_say_of_themselves_is_played_where_it_is_named(
    session: zenoh.Session, endpoint: str, tmp_path: Path
) -> None:
    path = tmp_path / "robot.mcap"
    text = cdr.encoder(String)(String("said"))
    with bag.Recording(path, bag.Options(compression="none", sync=False)) as recording:
        for name in ("a", "log", "z"):
            number = recording.topic(topic_of(f"r-1/{name}", String))
            recording.write(number, text, START, START, 1)
    heard = hear(session, "r-1/*")
    result = run_robo("bag", "play", str(path), "--connect", endpoint)
    assert result.returncode == 0, result.stderr
    assert "not played, for nodes that run say it of themselves: r-1/log; --topics" in result.stderr
    assert "; /bag_player" in result.stdout, "nodes may not be called as this robot is"
    assert [str(sample.key_expr) for sample in samples(heard, 2)] == ["r-1/a", "r-1/z"]
    assert run_robo("bag", "play", str(path), "--topics", "log", "--connect", endpoint).returncode == 0
    assert str(samples(heard)[0].key_expr) == "r-1/log"


def test_bytes_go_where_nobody_knows_them_as_something_else(
    session: zenoh.Session, other: zenoh.Session, endpoint: str, tmp_path: Path
) -> None:
    path = tmp_path / "grip.mcap"
    with bag.Recording(path, bag.Options(compression="none", sync=False)) as recording:
        grip = bag.TopicInFile("r1/grip", "arm_msgs/msg/Grip", "float64 width\n")
        recording.write(recording.topic(grip), bytes(12), START, START, 1)
    heard = hear(session, "r1/*")
    result = run_robo("bag", "play", str(path), "--connect", endpoint)
    assert result.returncode == 0, result.stderr
    told = "r1/grip is published as application/cdr;arm_msgs/msg/Grip: robo has no type 'arm_msgs/msg/Grip'"
    assert told in result.stderr
    assert str(samples(heard)[0].encoding) == "application/cdr;arm_msgs/msg/Grip"
    reader = Sender(other, "r1/grip", "std/String", node="/r1/hand")
    eventually(lambda: "r1/grip" in run_robo("topic", "list", "--connect", endpoint).stdout, "it is announced")
    refused = run_robo("bag", "play", str(path), "--beside", "--connect", endpoint)
    assert refused.returncode == 1
    assert "r1/grip is no arm_msgs/msg/Grip: /r1/hand know it as std/String; --force" in refused.stderr
    reader.close()


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_a_receiver_that_hangs_does_not_keep_it_from_ending(
    how: signal.Signals, session: zenoh.Session, other: zenoh.Session, endpoint: str, tmp_path: Path
) -> None:
    del session
    path = tmp_path / "scans.mcap"
    scan = cdr.encoder(LaserScan)(LaserScan(ranges=[1.0] * 2_000))
    with bag.Recording(path, bag.Options(compression="none", sync=False)) as recording:
        number = recording.topic(topic_of("r1/scan", LaserScan))
        for at in range(3_000):
            recording.write(number, scan, START + at, START + at, at + 1)
    hanging = other.declare_subscriber("r1/scan", zenoh.handlers.FifoChannel(1))
    with robo("bag", "play", str(path), "--wait-for-subscribers", "--rate", "0", "--connect", endpoint) as player:
        player.wait_for("playing")
        process = psutil.Process(player.process.pid)
        eventually(lambda: process.cpu_percent(0.3) < 1.0, "it waits")
        assert player.process.poll() is None
        player.process.send_signal(how)
        assert player.wait(30.0) in (*INTERRUPTED, 128 + signal.SIGTERM)
        assert "stopped: " in player.output
        assert "Traceback" not in player.output, player.output
    hanging.undeclare()


def test_a_topic_that_somebody_publishes_is_left_to_him(session: zenoh.Session, endpoint: str, tmp_path: Path) -> None:
    path = commands(tmp_path / "drive.mcap", 20)
    heard = hear(session, "r1/cmd_vel")
    with robo("bag", "play", str(path), "--start-paused", "--connect", endpoint) as first:
        first.wait_for("playing")
        second = ["bag", "play", str(path), "--connect", endpoint]
        refused = run_robo(*second)
        assert refused.returncode == 1
        assert "/r1/bag_player publishes r1/cmd_vel already" in refused.stderr
        assert "--exclude" in refused.stderr
        played = run_robo(*second, "--beside")
        assert played.returncode == 0, played.stderr
        assert "/r1/bag_player_2" in played.stdout
        assert len(samples(heard, 20)) == 20
        other = run_robo("service", "call", "r1/bag_player/step", "--connect", endpoint)
        assert other.returncode == 0, other.stderr + other.stdout
        samples(heard, 1)
        first.interrupt()
        assert first.wait() in INTERRUPTED
        assert "stopped: 1 messages" in first.output
        assert "Traceback" not in first.output


def test_a_cut_recording_is_played_as_far_as_it_goes(session: zenoh.Session, endpoint: str, tmp_path: Path) -> None:
    whole, cut = tmp_path / "whole.mcap", tmp_path / "cut.mcap"
    bags.drive(whole, bag.Options(compression="none", sync=False, chunk_size=1_000))
    data = whole.read_bytes()
    cut.write_bytes(data[: len(data) // 2])
    heard = hear(session, "r2/**")
    words = ["--connect", endpoint, "--rate", "0", "--robot-name", "r2"]
    result = run_robo("bag", "play", str(cut), *words)
    assert result.returncode == 1
    assert "the file is cut" in result.stderr
    assert "what can be read is played" in result.stderr
    assert "Traceback" not in result.stderr
    count = int(re.findall(r"played (\d+) messages", result.stdout)[0])
    assert 10 < count < 122
    assert len(samples(heard, count)) == count


class Listener(Typist):
    """Somebody at a terminal in which a recording is played."""

    def __init__(self, *words: str) -> None:
        super().__init__(["-m", "robo", "bag", "play", *words], ALONE, columns=140)

    @property
    def line(self) -> str:
        """What stands in the line that is drawn anew."""
        return self.output.rpartition("\x1b[K")[2]

    def sees(self, pattern: str) -> None:
        self.wait_until(lambda: re.search(pattern, self.line))


@contextmanager
def typist(*words: str) -> Iterator[Listener]:
    made = Listener(*words)
    try:
        yield made
    finally:
        made.close()


def test_keys_steer_it_and_the_terminal_is_given_back(session: zenoh.Session, endpoint: str, tmp_path: Path) -> None:
    path = commands(tmp_path / "long.mcap", 30_000)  # 300 s
    heard = hear(session, "r1/cmd_vel")
    with typist(str(path), "--start-paused", "--connect", endpoint) as person:
        person.sees(r"paused +0\.00 of 299\.99 s  x1  0 messages")
        assert not person.has_its_mode_back()
        person.type(b".")
        assert values(samples(heard)) == [0.0]
        person.type(b"\x1b[C")
        assert values(samples(heard)) == [1.0], "an arrow is a step while it stands"
        person.type(b"\x1b[5~.")
        assert values(samples(heard)) == [6001.0]
        person.type(b"\x1b[")
        person.type(b"D.")
        assert values(samples(heard)) == [5501.0], "5 s back"
        person.type(b"+")
        person.sees("x2 ")
        person.type(b"--")
        person.sees(r"x0\.5 ")
        person.type(b" ")
        person.sees("playing")
        assert values(samples(heard, 3)) == [5502.0, 5503.0, 5504.0]
        person.type(b"q")
        assert person.shell.wait(PATIENCE) == 0
        assert person.has_its_mode_back()
        assert "stopped: " in person.output


def test_nobody_waits_for_days_where_a_clock_was_set(session: zenoh.Session, endpoint: str, tmp_path: Path) -> None:
    path = tmp_path / "set.mcap"
    with bag.Recording(path, bag.Options(compression="none", sync=False)) as recording:
        number = recording.topic(topic_of("r1/cmd_vel", Twist))
        for count, at in enumerate((START, START + 19_675 * 86_400 * 1000 * MS)):
            recording.write(number, bags.twist(count), at, at, count + 1)
    heard = hear(session, "r1/cmd_vel")
    with typist(str(path), "--connect", endpoint) as person:
        told = "nothing for 19,675 days of the recording: its clock was set there; n goes to the next message"
        eventually(lambda: told in person.output, "it is told")
        person.type(b"n")
        assert person.shell.wait(PATIENCE) == 0
        assert "played 2 messages" in person.output
    assert values(samples(heard, 2)) == [0.0, 1.0]


@pytest.mark.parametrize("how", ["Ctrl-C", "SIGTERM", "Ctrl-Z"])
def test_however_it_is_left_the_terminal_is_as_it_was(
    how: str, session: zenoh.Session, endpoint: str, tmp_path: Path
) -> None:
    del session
    path = commands(tmp_path / "long.mcap", 30_000)
    with typist(str(path), "--connect", endpoint) as person:
        person.sees("playing +0\\.[1-9]")
        player = person.program
        if how == "Ctrl-C":
            person.type(b"\x03")
            assert person.shell.wait(PATIENCE) == 130
        elif how == "SIGTERM":
            player.send_signal(signal.SIGTERM)
            assert person.shell.wait(PATIENCE) == 128 + signal.SIGTERM
        else:
            person.type(b"\x1a")
            eventually(lambda: player.status() == psutil.STATUS_STOPPED, "it is stopped")
            assert person.has_its_mode_back()
            player.send_signal(signal.SIGCONT)
            person.sees("playing")
            eventually(lambda: not person.has_its_mode_back(), "keys are its own again")
            person.type(b"q")
            assert person.shell.wait(PATIENCE) == 0
        assert person.has_its_mode_back()
        assert "Traceback" not in person.output


def test_where_a_part_is_damaged_the_terminal_is_given_back_too(
    session: zenoh.Session, endpoint: str, tmp_path: Path
) -> None:
    path = commands(tmp_path / "damaged.mcap", 200, chunk_size=4_000)
    place = damage(path, chunk=2)
    heard = hear(session, "r1/cmd_vel")
    with typist(str(path), "--connect", endpoint) as person:
        assert person.shell.wait(PATIENCE) == 1
        eventually(person.has_its_mode_back, "the terminal is as it was")
        eventually(lambda: f"byte {place:,}: a chunk has another checksum" in person.output, "the error is told")
        assert "`robo bag recover`" in person.output
        assert "Traceback" not in person.output
    count = int(re.findall(r"stopped: (\d+) messages", person.output)[0])
    assert values(samples(heard, count)) == list(range(count))


def test_a_terminal_that_goes_takes_the_player_along(session: zenoh.Session, endpoint: str, tmp_path: Path) -> None:
    del session
    path = commands(tmp_path / "long.mcap", 30_000)
    with typist(str(path), "--connect", endpoint) as person:
        person.sees("playing +0\\.[1-9]")
        player = person.program
        player.send_signal(signal.SIGHUP)
        player.wait(PATIENCE)
        assert "stopped: " in person.output


def test_a_real_log_is_tracked_to_the_millimetre_through_a_recording(
    launch: Launch, intel_log: Path, tmp_path: Path
) -> None:
    path = tmp_path / "intel.mcap"
    made = from_carmen(
        intel_log, path, Setting(namespace="my_robot"), "none", wanted=lambda name: name.endswith("/odom")
    )
    assert made.messages == 13_700
    (tmp_path / "tracker.yaml").write_text(
        "groups:\n  tracking:\n    namespace: my_robot\n"
        "    nodes: {position_tracker: {service: robo_services.position_tracker}}\n"
    )
    robot = launch("tracker.yaml", folder=tmp_path)
    heard = hear(robot.session, "my_robot/current_position")
    result = run_robo("bag", "play", str(path), "--rate", "0", "--connect", robot.endpoint)
    assert result.returncode == 0, result.stderr
    assert "played 13,700 messages" in result.stdout
    positions = samples(heard, 13_700)
    last = robo_messages.decode(positions[-1].payload.to_bytes(), robo_messages.Point)
    assert last.z == pytest.approx(534.082, abs=0.01)
    assert (last.x, last.y) == pytest.approx((-0.322783, -0.0967671), abs=1e-6)
